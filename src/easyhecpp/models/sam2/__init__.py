"""Segment Anything 2 and 2.1 (Ravi et al. 2024) on single images."""

from easyhecpp.models.sam2.adapter import SAM2, load_sam2

__all__ = ["SAM2", "load_sam2"]
