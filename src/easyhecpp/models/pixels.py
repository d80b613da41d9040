"""Between an image's pixels and a model's input: resizing, normalising, and the way back.

The package counts pixel CENTRES: coordinate 0 is the middle of the first pixel. So does the SAM
family, whose prompt encoders add half a pixel to whatever they are given. A resize by ``s`` thus
maps ``x`` to ``(x + 0.5) * s - 0.5``; the models' own processors write ``x * s``, which is off by
up to half a pixel of the model's input.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from easyhecpp._optional import require
from easyhecpp.errors import InputError

if TYPE_CHECKING:
    import torch

IMAGENET_MEAN = (0.485, 0.456, 0.406)
IMAGENET_STD = (0.229, 0.224, 0.225)


@dataclass(frozen=True)
class Frame:
    """Where an image lies in a model's input.

    Attributes:
        image_size: (height, width) of the image.
        resized: (height, width) that the image is resized to.
        padded: (height, width) of the model's input; what is beyond ``resized`` at the right and
            the bottom is zero.
        by_way_of_input: whether masks are resampled to the model's input first, as SAM's are to
            cut the padding off, or straight to the image.
    """

    image_size: tuple[int, int]
    resized: tuple[int, int]
    padded: tuple[int, int]
    by_way_of_input: bool = False

    @property
    def scale_xy(self) -> NDArray[np.float64]:
        """(2,) model pixels per image pixel along x and y."""
        (height, width), (new_height, new_width) = self.image_size, self.resized
        return np.array([new_width / width, new_height / height])

    def to_model(self, xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """Image coordinates (..., 2) in px to model coordinates."""
        return (np.asarray(xy, dtype=np.float64) + 0.5) * self.scale_xy - 0.5

    def boxes_to_model(self, boxes: NDArray[np.float64]) -> NDArray[np.float64]:
        """Boxes (N, 4) ``x0 y0 x1 y1`` in image px to model px."""
        return self.to_model(np.asarray(boxes).reshape(-1, 2, 2)).reshape(-1, 4)

    def logits_to_image(self, logits: torch.Tensor) -> torch.Tensor:
        """Mask logits (N, h, w) over the model's input, resampled to the image: (N, H, W)."""
        functional = require("torch.nn.functional", "models", "A pretrained segmenter")
        planes = logits[None].float()
        if self.by_way_of_input:
            planes = functional.interpolate(planes, self.padded, mode="bilinear")
            planes = planes[..., : self.resized[0], : self.resized[1]]
        return functional.interpolate(planes, self.image_size, mode="bilinear")[0]


@dataclass(frozen=True)
class Preprocessing:
    """How a family of models wants its images.

    Attributes:
        resize: ``stretch`` to ``size`` x ``size``; ``longest`` edge to ``size``, then padded to a
            square; ``shortest`` edge to ``size`` unless the longest would exceed ``longest``.
        size: px.
        longest: px, for ``shortest`` only.
        mean, std: of the channels in [0, 1].
    """

    resize: Literal["stretch", "longest", "shortest"]
    size: int
    longest: int = 0
    mean: tuple[float, ...] = IMAGENET_MEAN
    std: tuple[float, ...] = IMAGENET_STD

    def frame(self, image_size: tuple[int, int]) -> Frame:
        """Where an image of (height, width) ends up."""
        height, width = image_size
        square = (self.size, self.size)
        if self.resize == "stretch":
            return Frame(image_size, square, square)
        if self.resize == "longest":
            scale = self.size / max(height, width)
            resized = (int(height * scale + 0.5), int(width * scale + 0.5))
            return Frame(image_size, resized, square, by_way_of_input=True)
        scale = min(self.size / min(height, width), self.longest / max(height, width))
        resized = (round(height * scale), round(width * scale))
        return Frame(image_size, resized, resized)

    def tensor(self, image: NDArray[np.uint8]) -> tuple[torch.Tensor, Frame]:
        """An (H, W, 3) uint8 RGB image as the model's input (1, 3, h, w) float32."""
        check_image(image)
        torch = require("torch", "models", "A pretrained segmenter")
        frame = self.frame(image.shape[:2])
        scaled = _resize(image, frame.resized).astype(np.float32) / 255.0
        scaled = (scaled - np.array(self.mean, np.float32)) / np.array(self.std, np.float32)
        canvas = np.zeros((*frame.padded, 3), dtype=np.float32)
        canvas[: frame.resized[0], : frame.resized[1]] = scaled
        return torch.from_numpy(np.ascontiguousarray(canvas.transpose(2, 0, 1)))[None], frame

    def with_settings(self, settings: dict[str, Any]) -> Preprocessing:
        """The same, with mean and std as a checkpoint's own preprocessor settings state them."""
        mean = tuple(settings.get("image_mean") or self.mean)
        std = tuple(settings.get("image_std") or self.std)
        return replace(self, mean=mean, std=std)


def check_image(image: NDArray[np.uint8]) -> None:
    """Raises InputError unless the image is (H, W, 3) uint8."""
    if image.ndim == 3 and image.shape[2] == 3 and image.dtype == np.uint8 and image.size:
        return
    raise InputError(
        f"cannot segment an image of shape {image.shape} and type {image.dtype}",
        expected="(height, width, 3) RGB with 8 bits per channel",
        fix="convert grey, 16-bit or transparent images to 8-bit RGB",
    )


def _resize(image: NDArray[np.uint8], size: tuple[int, int]) -> NDArray[np.uint8]:
    # Pillow's bilinear filter widens when it shrinks (antialiasing), as the models were trained.
    resized = Image.fromarray(image).resize((size[1], size[0]), Image.Resampling.BILINEAR)
    return np.asarray(resized)
