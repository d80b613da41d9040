"""Segment Anything in High Quality (Ke et al. 2023): SAM with sharper outlines."""

from easyhecpp.models.sam_hq.adapter import SAM_HQ, SamHQSegmenter, load_sam_hq

__all__ = ["SAM_HQ", "SamHQSegmenter", "load_sam_hq"]
