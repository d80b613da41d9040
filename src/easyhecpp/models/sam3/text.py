"""SAM 3 prompted with text: every instance of what the text names, as masks."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from easyhecpp.models.checkpoint import WeightsSpec, preprocessor_settings
from easyhecpp.models.loading import load
from easyhecpp.models.runtime import Runtime, inference, to_float64
from easyhecpp.models.sam3.boxes import SAM3_PREPROCESSING
from easyhecpp.segment.protocols import ScoredMasks

SAM3_TEXT = WeightsSpec(
    "SAM 3",
    "facebook/sam3",
    ("sam3", "sam3_video"),
    gated=True,
    option="--text-weights",
    tokenizer=True,
)

_TOKENS = 32  # the length that SAM 3's text encoder was trained with


class Sam3Text:
    """SAM 3 as a ``TextSegmenter``.

    Args:
        weights: folder or name on the hub; None for ``facebook/sam3``.
        runtime: device and precision.
        threshold: score below which an instance is dropped.
        at_most: how many instances of an image are kept, best first.

    Raises:
        InputError: see ``loading.load``.
        MissingExtraError: torch or transformers is not installed.
    """

    def __init__(
        self,
        weights: str | Path | None = None,
        runtime: Runtime | None = None,
        threshold: float = 0.3,
        at_most: int = 6,
    ) -> None:
        self.runtime = runtime or Runtime()
        self.threshold, self.at_most = threshold, at_most
        loaded = load("Sam3Model", SAM3_TEXT, weights, self.runtime)
        self._name, self.model, self.device = loaded.name, loaded.model, loaded.device
        self.tokenizer = loaded.tokenizer
        size = int(np.ravel(self.model.config.vision_config.image_size)[0])
        self.preprocessing = replace(SAM3_PREPROCESSING, size=size).with_settings(
            preprocessor_settings(loaded.folder)
        )

    @property
    def name(self) -> str:
        """The model and its weights."""
        return self._name

    def segment(self, image: NDArray[np.uint8], text: str) -> ScoredMasks:
        """Masks of the instances of ``text``, best first."""
        pixels, frame = self.preprocessing.tensor(image)
        tokens = self._tokens(text)
        with inference(self.name):
            with self.runtime.encoding(self.device):
                vision = self.model.get_vision_features(pixels.to(self.device))
            for key in ("fpn_hidden_states", "fpn_position_encoding"):
                setattr(vision, key, tuple(level.float() for level in getattr(vision, key)))
            output = self.model(vision_embeds=vision, **tokens)
            # Whether the thing is in the image at all, times whether an instance is one.
            presence = output.presence_logits[0].float().sigmoid()
            scores = output.pred_logits[0].float().sigmoid() * presence
            order = scores.argsort(descending=True)[: self.at_most]
            order = order[scores[order] > self.threshold]
            if len(order) == 0:
                return ScoredMasks(np.zeros((0, *frame.image_size), dtype=bool), np.zeros(0))
            masks = frame.logits_to_image(output.pred_masks[0][order]) > 0
        return ScoredMasks(masks.cpu().numpy(), to_float64(scores[order]))

    def _tokens(self, text: str) -> dict[str, Any]:
        tokens = self.tokenizer(
            text, padding="max_length", max_length=_TOKENS, truncation=True, return_tensors="pt"
        )
        return {key: tokens[key].to(self.device) for key in ("input_ids", "attention_mask")}
