"""Area, centroid and overlap of a rendered and an observed mask in one pass (compiled)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from easyhecpp.render._jit import jit

F32 = NDArray[np.float32]


@jit
def overlap(rendered: F32, observed: F32) -> tuple[float, float, float, float, float]:
    """Returns area, centroid x and y of ``rendered``, the intersection and the union's area."""
    area = 0.0
    mx = 0.0
    my = 0.0
    both = 0.0
    either = 0.0
    for y in range(rendered.shape[0]):
        row_area = 0.0
        row_x = 0.0
        for x in range(rendered.shape[1]):
            a = rendered[y, x]
            b = observed[y, x]
            row_area += a
            row_x += a * x
            both += min(a, b)
            either += max(a, b)
        area += row_area
        mx += row_x
        my += row_area * y
    if area > 0.0:
        mx /= area
        my /= area
    return area, mx, my, both, either
