"""SAM, sizes ViT-B, L and H, through ``transformers.SamModel``."""

from __future__ import annotations

from pathlib import Path

from easyhecpp.models.checkpoint import WeightsSpec
from easyhecpp.models.pixels import Preprocessing
from easyhecpp.models.prompted import Family, PromptedSegmenter
from easyhecpp.models.runtime import Runtime

SAM = Family(
    weights=WeightsSpec("SAM", "facebook/sam-vit-huge", ("sam",)),
    class_name="SamModel",
    preprocessing=Preprocessing("longest", size=1024),
)


def load_sam(
    weights: str | Path | None = None, runtime: Runtime | None = None
) -> PromptedSegmenter:
    """SAM with its default weights (ViT-H), another size from the hub, or those in a folder."""
    return PromptedSegmenter(SAM, weights, runtime)
