"""The classical way: pose and masks from the arm's own motion, without pretrained weights."""

from __future__ import annotations

from easyhecpp.segment.backgrounds import Backgrounds
from easyhecpp.segment.classical.calibrate import ClassicalResult, calibrate_from_images
from easyhecpp.segment.classical.segmenter import ClassicalConfig, ClassicalSegmenter

__all__ = [
    "Backgrounds",
    "ClassicalConfig",
    "ClassicalResult",
    "ClassicalSegmenter",
    "calibrate_from_images",
]
