"""Grounding DINO (Liu et al. 2023): boxes of what a text names; with SAM it is GroundedSAM."""

from easyhecpp.models.grounding_dino.adapter import GROUNDING_DINO, GroundingDino

__all__ = ["GROUNDING_DINO", "GroundingDino"]
