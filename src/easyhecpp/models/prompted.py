"""What the members of the SAM family share: encode an image once, then answer prompts."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from easyhecpp._optional import require
from easyhecpp.models.checkpoint import WeightsSpec, preprocessor_settings
from easyhecpp.models.loading import load
from easyhecpp.models.pixels import Frame, Preprocessing
from easyhecpp.models.runtime import Runtime, inference, to_float64
from easyhecpp.segment.protocols import Prompts, ScoredMasks

if TYPE_CHECKING:
    import torch

# A prompt costs the mask decoder some 50 MB with the published models; more at once gains nothing.
PROMPTS_AT_ONCE = 16


@dataclass(frozen=True)
class Family:
    """One member of the SAM family.

    Attributes:
        weights: default weights and what may replace them.
        class_name: the model's class in transformers.
        preprocessing: how it wants its images; the size is read from the checkpoint.
    """

    weights: WeightsSpec
    class_name: str
    preprocessing: Preprocessing


class PromptedSegmenter:
    """A model of the SAM family as a ``PromptableSegmenter``.

    Args:
        family: which member.
        weights: folder or name on the hub; None for the family's default.
        runtime: device and precision.
        prompts_at_once: how many prompts go through the mask decoder together; bounds the memory.

    Raises:
        InputError: see ``loading.load``.
        MissingExtraError: torch or transformers is not installed.
    """

    def __init__(
        self,
        family: Family,
        weights: str | Path | None = None,
        runtime: Runtime | None = None,
        prompts_at_once: int = PROMPTS_AT_ONCE,
    ) -> None:
        self.runtime = runtime or Runtime()
        self.prompts_at_once = prompts_at_once
        loaded = load(family.class_name, family.weights, weights, self.runtime)
        self._name, self.model, self.device = loaded.name, loaded.model, loaded.device
        size = _side(self.model.prompt_encoder.input_image_size)
        self.preprocessing = replace(family.preprocessing, size=size).with_settings(
            preprocessor_settings(loaded.folder)
        )

    @property
    def name(self) -> str:
        """The model and its weights."""
        return self._name

    def encode(self, image: NDArray[np.uint8]) -> PromptedImage:
        """Encode an (H, W, 3) uint8 RGB image."""
        pixels, frame = self.preprocessing.tensor(image)
        with inference(self.name), self.runtime.encoding(self.device):
            embedding = self.embed(pixels.to(self.device))
        return PromptedImage(self, frame, embedding)

    def embed(self, pixels: torch.Tensor) -> dict[str, Any]:
        """The image's embedding, as the arguments under which ``forward`` takes it, float32."""
        return {"image_embeddings": to_float32(self.model.get_image_embeddings(pixels))}

    def decode(
        self, embedding: dict[str, Any], **prompts: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Candidate mask logits (N, M, h, w) and their scores (N, M) of N prompts."""
        output = self.model(**embedding, **prompts, multimask_output=True)
        return output.pred_masks[0], output.iou_scores[0]


@dataclass(frozen=True)
class PromptedImage:
    """An image that a model of the SAM family has encoded."""

    segmenter: PromptedSegmenter
    frame: Frame
    embedding: dict[str, Any]

    @property
    def size(self) -> tuple[int, int]:
        """(height, width) of the image."""
        return self.frame.image_size

    def predict(self, prompts: Prompts) -> ScoredMasks:
        """One mask per prompt: of the model's candidates the one that it scores best."""
        masks = np.zeros((len(prompts), *self.size), dtype=bool)
        scores = np.zeros(len(prompts))
        step = self.segmenter.prompts_at_once
        for start in range(0, len(prompts), step):
            part = prompts.chunk(start, start + step)
            masks[start : start + step], scores[start : start + step] = self._predict(part)
        return ScoredMasks(masks, scores)

    def _predict(self, prompts: Prompts) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
        torch = require("torch", "models", self.segmenter.name)
        tensors = _prompt_tensors(prompts, self.frame, self.segmenter.device)
        with inference(self.segmenter.name):
            logits, scores = self.segmenter.decode(self.embedding, **tensors)
            best_score, best = scores.float().max(dim=1)
            best_logits = logits[torch.arange(len(best), device=best.device), best]
            masks = self.frame.logits_to_image(best_logits) > 0
        return masks.cpu().numpy(), to_float64(best_score)


def _prompt_tensors(prompts: Prompts, frame: Frame, device: torch.device) -> dict[str, Any]:
    """Prompts in model coordinates, as a batch of one image."""
    torch = require("torch", "models", "A pretrained segmenter")
    tensors: dict[str, Any] = {}
    if prompts.boxes is not None:
        boxes = torch.from_numpy(frame.boxes_to_model(prompts.boxes))
        tensors["input_boxes"] = boxes.float()[None].to(device)
    if prompts.points is not None:
        on_object = prompts.on_object
        if on_object is None:
            on_object = np.ones(prompts.points.shape[:2], dtype=bool)
        points = torch.from_numpy(frame.to_model(prompts.points))
        tensors["input_points"] = points.float()[None].to(device)
        tensors["input_labels"] = torch.from_numpy(on_object).int()[None].to(device)
    return tensors


def to_float32(value: Any) -> Any:
    """The same nest of lists and tensors, every tensor in float32."""
    if isinstance(value, (list, tuple)):
        return [to_float32(item) for item in value]
    return value.float()


def _side(size: Any) -> int:
    return int(size[0]) if isinstance(size, (list, tuple)) else int(size)
