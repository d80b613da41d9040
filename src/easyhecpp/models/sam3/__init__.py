"""Segment Anything 3 (Meta 2025): masks from text, and from boxes. Its weights are gated."""

from easyhecpp.models.sam3.boxes import SAM3_BOXES, load_sam3
from easyhecpp.models.sam3.text import SAM3_TEXT, Sam3Text

__all__ = ["SAM3_BOXES", "SAM3_TEXT", "Sam3Text", "load_sam3"]
