"""Segment Anything (Kirillov et al. 2023), the box model of the paper's AutoSAM."""

from easyhecpp.models.sam.adapter import SAM, load_sam

__all__ = ["SAM", "load_sam"]
