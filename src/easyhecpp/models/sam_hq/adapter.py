"""SAM-HQ through ``transformers.SamHQModel``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from easyhecpp.models.checkpoint import WeightsSpec
from easyhecpp.models.pixels import Preprocessing
from easyhecpp.models.prompted import Family, PromptedSegmenter, to_float32
from easyhecpp.models.runtime import Runtime

if TYPE_CHECKING:
    import torch

SAM_HQ = Family(
    weights=WeightsSpec("SAM-HQ", "syscv-community/sam-hq-vit-huge", ("sam_hq",)),
    class_name="SamHQModel",
    preprocessing=Preprocessing("longest", size=1024),
)


class SamHQSegmenter(PromptedSegmenter):
    """SAM-HQ, whose mask decoder also looks at an early layer of the image encoder."""

    def embed(self, pixels: torch.Tensor) -> dict[str, Any]:
        """The image's final embedding and that of an early layer."""
        final, intermediate = self.model.get_image_embeddings(pixels)
        return {
            "image_embeddings": to_float32(final),
            # The decoder reads the first of them only, and each is five times the final one.
            "intermediate_embeddings": to_float32(intermediate[:1]),
        }


def load_sam_hq(
    weights: str | Path | None = None, runtime: Runtime | None = None
) -> SamHQSegmenter:
    """SAM-HQ with its default weights (ViT-H), another size, or those in a folder."""
    return SamHQSegmenter(SAM_HQ, weights, runtime)
