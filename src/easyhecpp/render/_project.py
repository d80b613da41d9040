"""Projection of single points for the compiled kernels.

The same model as :class:`easyhecpp.camera.Camera`, in a form numba compiles; a test compares them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from easyhecpp.render._jit import jit

F64 = NDArray[np.float64]


@jit
def _distort_inside(x: float, y: float, model: int, k: F64) -> tuple[float, float]:
    """Distort a normalised point that lies inside the radius where the model is monotone."""
    if model == 1:
        r2 = x * x + y * y
        top = 1.0 + r2 * (k[0] + r2 * (k[1] + r2 * k[4]))
        bottom = 1.0 + r2 * (k[5] + r2 * (k[6] + r2 * k[7]))
        s = top / bottom
        return (
            x * s + 2.0 * k[2] * x * y + k[3] * (r2 + 2.0 * x * x),
            y * s + k[2] * (r2 + 2.0 * y * y) + 2.0 * k[3] * x * y,
        )
    r = np.sqrt(x * x + y * y)
    if r < 1e-12:
        return x, y
    t = np.arctan(r)
    t2 = t * t
    s = t * (1.0 + t2 * (k[0] + t2 * (k[1] + t2 * (k[2] + t2 * k[3])))) / r
    return x * s, y * s


@jit
def distort(x: float, y: float, model: int, k: F64, valid_radius: float) -> tuple[float, float]:
    """Distort a normalised image point; linear along the ray beyond ``valid_radius``."""
    if model == 0:
        return x, y
    r = np.sqrt(x * x + y * y)
    if r <= valid_radius:
        return _distort_inside(x, y, model, k)
    s = valid_radius / r
    step = 1e-6
    ax, ay = _distort_inside(x * s, y * s, model, k)
    bx, by = _distort_inside(x * s * (1.0 - step), y * s * (1.0 - step), model, k)
    beyond = (r - valid_radius) / (valid_radius * step)
    return ax + (ax - bx) * beyond, ay + (ay - by) * beyond


@jit
def project_row(p: F64, n: F64, fc: F64, model: int, k: F64, valid_radius: float, row: F64) -> None:
    """Write ``n^T d(pixel)/d(p)`` (3 values) for point ``p`` in the camera frame into ``row``."""
    iz = 1.0 / p[2]
    x = p[0] * iz
    y = p[1] * iz
    gx = n[0] * fc[0]
    gy = n[1] * fc[1]
    if model == 0:
        ax, ay = gx, gy
    else:
        h = 1e-6
        x1, y1 = distort(x + h, y, model, k, valid_radius)
        x0, y0 = distort(x - h, y, model, k, valid_radius)
        ax = (gx * (x1 - x0) + gy * (y1 - y0)) / (2.0 * h)
        x1, y1 = distort(x, y + h, model, k, valid_radius)
        x0, y0 = distort(x, y - h, model, k, valid_radius)
        ay = (gx * (x1 - x0) + gy * (y1 - y0)) / (2.0 * h)
    row[0] = ax * iz
    row[1] = ay * iz
    row[2] = -(ax * x + ay * y) * iz
