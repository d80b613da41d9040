"""Boxes from text, masks from the boxes: GroundedSAM and its relatives."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from easyhecpp.segment.protocols import PromptableSegmenter, Prompts, ScoredMasks, TextDetector


class GroundedSegmenter:
    """A ``TextSegmenter`` made of a detector that reads text and a segmenter that reads boxes.

    Args:
        detector: finds boxes, say Grounding DINO.
        segmenter: outlines what is in a box, say SAM.
    """

    def __init__(self, detector: TextDetector, segmenter: PromptableSegmenter) -> None:
        self.detector = detector
        self.segmenter = segmenter

    @property
    def name(self) -> str:
        """Both models' names."""
        return f"{self.detector.name} + {self.segmenter.name}"

    def segment(self, image: NDArray[np.uint8], text: str) -> ScoredMasks:
        """Masks of ``text``, best first, with the detector's scores."""
        found = self.detector.detect(image, text)
        if len(found) == 0:
            return ScoredMasks(np.zeros((0, *image.shape[:2]), dtype=bool), np.zeros(0))
        masks = self.segmenter.encode(image).predict(Prompts(boxes=found.boxes)).masks
        return ScoredMasks(masks, found.scores)
