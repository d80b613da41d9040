"""Silhouettes of posed link meshes: coverage, derivatives, outer contours, boxes, depth."""

from easyhecpp.render.reference import reference_coverage
from easyhecpp.render.silhouette import Contour, SilhouetteRenderer

__all__ = ["Contour", "SilhouetteRenderer", "reference_coverage"]
