"""The views' pictures, made comparable: each view's exposure and white balance taken out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from easyhecpp._parallel import parallel_map
from easyhecpp.camera import Camera
from easyhecpp.errors import InputError

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]

_FIT_ROUNDS = 6

_TEXTURE = 10.0
"""Grey levels (standard deviation) under which a picture's noise would pass for less contrast."""

_SMALLEST_NOISE = 0.6
"""Lab units; compression and demosaicing leave at least this much."""


@dataclass(frozen=True)
class Pictures:
    """All pictures of one camera at one size.

    Attributes:
        lab: ``(V, H, W, 3)`` float32, CIE L 0..100, a and b about -127..127; see `equalised`.
        noise: Standard deviation per channel of one picture at a place where nothing changed.
        reduction: How many pixels of the camera one pixel here is wide.
    """

    lab: F32
    noise: float
    reduction: int

    def __len__(self) -> int:
        return len(self.lab)

    @property
    def shape(self) -> tuple[int, int]:
        """``(height, width)``."""
        return self.lab.shape[1], self.lab.shape[2]

    @cached_property
    def median(self) -> F32:
        """The median over the views ``(H, W, 3)``: the background wherever the arm rarely is."""
        return np.median(self.lab, axis=0).astype(np.float32)

    def reduced(self, factor: int) -> Pictures:
        """The same pictures, ``factor`` times smaller; averaging lowers the noise."""
        height, width = self.shape
        size = (max(1, round(width / factor)), max(1, round(height / factor)))
        lab = parallel_map(lambda i: cv2.resize(i, size, interpolation=cv2.INTER_AREA), self.lab)
        small = np.stack(lab).astype(np.float32)
        return Pictures(small, measured_noise(small), self.reduction * factor)


def load_pictures(images: Sequence[NDArray[np.uint8]], camera: Camera, reduction: int) -> Pictures:
    """Read, reduce and equalise the views' images.

    Args:
        images: ``(H, W, 3)`` uint8 RGB each, of the camera's size.
        camera: The intrinsics.
        reduction: Size reduction, 1 for none.

    Raises:
        InputError: A size that does not fit, or pictures that all are the same.
    """
    for i, image in enumerate(images):
        if image.shape != (camera.height, camera.width, 3):
            raise InputError(
                f"image {i} has the shape {image.shape}",
                expected=f"({camera.height}, {camera.width}, 3), the size in camera_info",
            )
    rgb = equalised(parallel_map(lambda i: _reduced(i, reduction), images))
    lab = np.stack(parallel_map(_to_lab, rgb))
    return Pictures(lab, measured_noise(lab), reduction)


def _reduced(image: NDArray[np.uint8], reduction: int) -> NDArray[np.uint8]:
    if reduction == 1:
        return image
    height, width = image.shape[:2]
    size = (max(1, round(width / reduction)), max(1, round(height / reduction)))
    return cv2.resize(image, size, interpolation=cv2.INTER_AREA)  # type: ignore[return-value]


def _to_lab(rgb: F32) -> F32:
    return cv2.cvtColor(rgb / np.float32(255.0), cv2.COLOR_RGB2LAB)  # type: ignore[return-value]


def equalised(images: Sequence[NDArray[np.uint8]]) -> F32:
    """The pictures ``(V, H, W, 3)`` float32 in one exposure and one white balance, 0..255 or so.

    Cameras change either from picture to picture, by a factor on each of red, green and blue.
    """
    stack = np.empty((len(images), *images[0].shape), np.float32)
    parallel_map(lambda view: np.copyto(stack[view], images[view]), range(len(images)))
    gain, offset = exposure(stack)
    if not (np.allclose(gain, 1.0, atol=0.004) and np.allclose(offset, 0.0, atol=0.5)):
        stack *= gain[:, None, None].astype(np.float32)
        stack += offset[:, None, None].astype(np.float32)
    return stack


def exposure(pictures: F32) -> tuple[F64, F64]:
    """Gain ``(V, 3)`` and offset ``(V, 3)`` that bring each view to the views' median.

    Fitted robustly to the pixels that did not change, so that the arm has no say.

    Args:
        pictures: ``(V, H, W, 3)`` red, green and blue, 0..255.
    """
    step = max(1, pictures.shape[2] // 80)
    small = pictures[:, ::step, ::step].reshape(len(pictures), -1, 3).astype(np.float64)
    target = np.median(small, axis=0)
    gain, offset = np.ones((len(pictures), 3)), np.zeros((len(pictures), 3))
    for view, values in enumerate(small):
        for channel in range(3):
            fitted = _robust_line(values[:, channel], target[:, channel])
            gain[view, channel], offset[view, channel] = fitted
    return gain, offset


def _robust_line(x: F64, y: F64) -> tuple[float, float]:
    """Line ``y = a x + b`` through most of the points, ``a`` within 0.7..1.4."""
    a, b = 1.0, float(np.median(y - x))
    for _ in range(_FIT_ROUNDS):
        residual = y - a * x - b
        scale = max(0.5, 1.4826 * float(np.median(np.abs(residual))))
        w = 1.0 / np.square(1.0 + np.square(residual / (2.0 * scale)))
        total = w.sum()
        mx, my = (w @ x) / total, (w @ y) / total
        spread = w @ np.square(x - mx)
        if spread > total * _TEXTURE**2:
            a = float(np.clip((w @ ((x - mx) * (y - my))) / spread, 0.7, 1.4))
        b = float(my - a * mx)
    return a, b


def measured_noise(lab: F32) -> float:
    """Standard deviation of one channel of one picture, from unchanged pixels of view pairs."""
    spreads = []
    for i in range(len(lab) - 1):
        difference = (lab[i + 1] - lab[i])[::2, ::2]
        # The lower quartile of |difference| is safe even when the arm changes half of the image.
        spreads.append(np.quantile(np.abs(difference), 0.25) / 0.3186)
    return max(_SMALLEST_NOISE, float(np.median(spreads)) / np.sqrt(2.0))
