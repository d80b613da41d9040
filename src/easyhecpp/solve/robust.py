"""Which contour samples to believe, from their distance to the observed outline."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from easyhecpp.solve.evidence import Evidence

F64 = NDArray[np.float64]

_SMALLEST_SCALE_PX = 0.7
_FULL_TRUST, _NO_TRUST = 2.5, 6.0


def redescending_weights(distances: F64, scale_px: float) -> F64:
    """Geman-McClure weights: far samples lose their pull; for the approach from afar."""
    return 1.0 / np.square(1.0 + np.square(distances / scale_px))


def inlier_weights(distances: F64, scale_px: float) -> F64:
    """1 up to 2.5 scales, falling linearly to 0 at 6 (Hampel): samples in between are doubtful."""
    ratio = np.abs(distances) / scale_px
    return np.clip((_NO_TRUST - ratio) / (_NO_TRUST - _FULL_TRUST), 0.0, 1.0)


def consistent_scale(views: Sequence[Evidence], trust: F64) -> float:
    """Standard deviation of the inliers' distances, common to all views, pixels.

    The median over the views of each view's robust spread: a view that is wrong as a whole cannot
    raise it and so loses its say.

    Args:
        views: Samples of each view.
        trust: ``(V,)`` weight of each view; one of weight 0 has no say.
    """
    spreads = [
        1.4826 * float(np.median(np.abs(e.distances)))
        for e, weight in zip(views, trust, strict=True)
        if weight > 0.0 and len(e.distances)
    ]
    return max(_SMALLEST_SCALE_PX, float(np.median(spreads))) if spreads else _SMALLEST_SCALE_PX
