"""SAM 3 prompted with boxes: its tracker's mask decoder, ``transformers.Sam3TrackerModel``.

Its detector takes boxes too, but as examples of what to find everywhere; one mask for one box comes
from the tracker.
"""

from __future__ import annotations

from pathlib import Path

from easyhecpp.models.checkpoint import WeightsSpec
from easyhecpp.models.pixels import Preprocessing
from easyhecpp.models.prompted import Family, PromptedSegmenter
from easyhecpp.models.runtime import Runtime

SAM3_PREPROCESSING = Preprocessing("stretch", 1008, mean=(0.5, 0.5, 0.5), std=(0.5, 0.5, 0.5))

SAM3_BOXES = Family(
    weights=WeightsSpec("SAM 3", "facebook/sam3", ("sam3_tracker", "sam3_video"), gated=True),
    class_name="Sam3TrackerModel",
    preprocessing=SAM3_PREPROCESSING,
)


def load_sam3(
    weights: str | Path | None = None, runtime: Runtime | None = None
) -> PromptedSegmenter:
    """SAM 3 for boxes, with its default weights or those in a folder."""
    return PromptedSegmenter(SAM3_BOXES, weights, runtime)
