"""Grounding DINO, sizes tiny and base, through ``transformers.GroundingDinoForObjectDetection``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from easyhecpp.models.checkpoint import WeightsSpec, preprocessor_settings
from easyhecpp.models.loading import load
from easyhecpp.models.pixels import Preprocessing
from easyhecpp.models.runtime import Runtime, inference, to_float64
from easyhecpp.segment.protocols import ScoredBoxes

GROUNDING_DINO = WeightsSpec(
    "Grounding DINO",
    "IDEA-Research/grounding-dino-base",
    ("grounding-dino",),
    option="--text-weights",
    tokenizer=True,
)

_PREPROCESSING = Preprocessing("shortest", size=800, longest=1333)


class GroundingDino:
    """Grounding DINO as a ``TextDetector``.

    Args:
        weights: folder or name on the hub; None for the base model.
        runtime: device and precision.
        threshold: score below which a box is dropped. Low, because the kinematics choose among
            what is left.
        at_most: how many boxes of an image are kept, best first.
        duplicate_iou: of two boxes that overlap more than this, the better one is kept.

    Raises:
        InputError: see ``loading.load``.
        MissingExtraError: torch or transformers is not installed.
    """

    def __init__(
        self,
        weights: str | Path | None = None,
        runtime: Runtime | None = None,
        threshold: float = 0.25,
        at_most: int = 6,
        duplicate_iou: float = 0.8,
    ) -> None:
        self.runtime = runtime or Runtime()
        self.threshold, self.at_most, self.duplicate_iou = threshold, at_most, duplicate_iou
        # The custom kernels are fetched from the hub at run time, which an offline cell cannot do.
        loaded = load(
            "GroundingDinoForObjectDetection",
            GROUNDING_DINO,
            weights,
            self.runtime,
            disable_custom_kernels=True,
        )
        self._name, self.model, self.device = loaded.name, loaded.model, loaded.device
        self.tokenizer = loaded.tokenizer
        self._run_backbone_in_chosen_precision()
        self.preprocessing = _PREPROCESSING.with_settings(preprocessor_settings(loaded.folder))

    @property
    def name(self) -> str:
        """The model and its weights."""
        return self._name

    def detect(self, image: NDArray[np.uint8], text: str) -> ScoredBoxes:
        """Boxes of ``text``, best first."""
        pixels, _ = self.preprocessing.tensor(image)
        tokens = self.tokenizer(
            as_caption(text),
            return_tensors="pt",
            truncation=True,
            max_length=self.model.config.max_text_len,
        ).to(self.device)
        with inference(self.name):
            output = self.model(pixel_values=pixels.to(self.device), **tokens)
        # A query's score is that of the text token that it fits best.
        scores = to_float64(output.logits[0].sigmoid().amax(dim=-1))
        boxes = to_pixels(to_float64(output.pred_boxes[0]), image.shape[:2])
        keep = np.flatnonzero(scores > self.threshold)
        keep = keep[np.argsort(-scores[keep], kind="stable")]
        keep = keep[without_duplicates(boxes[keep], self.duplicate_iou)][: self.at_most]
        return ScoredBoxes(boxes[keep], scores[keep])

    def _run_backbone_in_chosen_precision(self) -> None:
        """Put the image encoder alone under autocast; boxes are made and corrected in float32."""
        backbone = self.model.model.backbone.conv_encoder.model
        forward = backbone.forward

        def in_chosen_precision(*args: Any, **kwargs: Any) -> Any:
            with self.runtime.encoding(self.device):
                output = forward(*args, **kwargs)
            output.feature_maps = tuple(level.float() for level in output.feature_maps)
            return output

        backbone.forward = in_chosen_precision


def as_caption(text: str) -> str:
    """The form in which the model was taught its labels: lower case, ended by a full stop."""
    caption = text.strip().lower()
    return caption if caption.endswith(".") else f"{caption}."


def to_pixels(boxes: NDArray[np.float64], image_size: tuple[int, int]) -> NDArray[np.float64]:
    """Relative boxes (N, 4) ``cx cy w h``, measured from the image's edge, to ``x0 y0 x1 y1``.

    The result counts pixel centres and names the outermost pixels inside; it is clipped to the
    image.
    """
    height, width = image_size
    centre, half = boxes[:, :2], boxes[:, 2:] / 2
    size = np.array([width, height])
    low = np.clip((centre - half) * size, 0, size - 1)
    high = np.clip((centre + half) * size - 1, low, size - 1)
    return np.concatenate([low, high], axis=1)


def without_duplicates(boxes: NDArray[np.float64], max_iou: float) -> NDArray[np.intp]:
    """Indices of boxes (N, 4), best first, that overlap no better one by more than ``max_iou``."""
    kept: list[int] = []
    areas = np.prod(boxes[:, 2:] - boxes[:, :2] + 1, axis=1)
    for i, box in enumerate(boxes):
        others = boxes[kept]
        low = np.maximum(box[:2], others[:, :2])
        high = np.minimum(box[2:], others[:, 2:])
        shared = np.prod(np.clip(high - low + 1, 0, None), axis=1)
        if not np.any(shared > max_iou * (areas[i] + areas[kept] - shared)):
            kept.append(i)
    return np.array(kept, dtype=np.intp)
