"""SAM 2 through ``transformers.Sam2Model``.

The processor in transformers needs torchvision; its resize to a square and its normalisation are
done in ``models.pixels`` instead.
"""

from __future__ import annotations

from pathlib import Path

from easyhecpp.models.checkpoint import WeightsSpec
from easyhecpp.models.pixels import Preprocessing
from easyhecpp.models.prompted import Family, PromptedSegmenter
from easyhecpp.models.runtime import Runtime

SAM2 = Family(
    # The published checkpoints carry the video model's configuration; the image model is in it.
    weights=WeightsSpec("SAM 2", "facebook/sam2.1-hiera-large", ("sam2", "sam2_video")),
    class_name="Sam2Model",
    preprocessing=Preprocessing("stretch", size=1024),
)


def load_sam2(
    weights: str | Path | None = None, runtime: Runtime | None = None
) -> PromptedSegmenter:
    """SAM 2 with its default weights (2.1 large), others from the hub, or those in a folder."""
    return PromptedSegmenter(SAM2, weights, runtime)
