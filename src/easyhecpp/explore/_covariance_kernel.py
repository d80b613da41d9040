"""The covariance of contour pieces (compiled); the time of a prediction is spent here."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from easyhecpp.render._jit import jit

F64 = NDArray[np.float64]

_FAR = 8.0


@jit
def correlated_errors(points: F64, normals: F64, variances: F64, lengths: F64) -> F64:
    """``sum_k variances_k exp(-|p_i - p_j| / lengths_k) (1 + n_i . n_j) / 2``.

    Args:
        points: ``(N, 2)`` pixels.
        normals: ``(N, 2)`` unit.
        variances: ``(K,)`` px^2; ``lengths`` ``(K,)`` px, the longest last.

    Returns:
        ``(N, N)``; only the lower triangle and the diagonal are filled. What lies over eight
        times the longest length apart (0.03 % correlation) is zero.
    """
    n = len(points)
    C = np.zeros((n, n))
    longest = _FAR * lengths[-1]
    for i in range(n):
        for j in range(i + 1):
            dx, dy = points[i, 0] - points[j, 0], points[i, 1] - points[j, 1]
            square = dx * dx + dy * dy
            if square > longest * longest:
                continue
            distance = np.sqrt(square)
            total = 0.0
            for k in range(len(variances)):
                total += variances[k] * np.exp(-distance / lengths[k])
            facing = normals[i, 0] * normals[j, 0] + normals[i, 1] * normals[j, 1]
            C[i, j] = 0.5 * (1.0 + facing) * total
    return C
