"""Error bars that honour how much the views contradict each other."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]


def between_views(N: F64, pulls: F64, information: F64, vectors: F64, solution: F64) -> F64:
    """Covariance ``(7, 7)`` that honours how much the views contradict each other.

    The noise along a contour says nothing of errors that a whole view or link shares: joints a
    fraction of a degree off, a clock out of step, a lens not quite as stated. They show in that
    the views pull the common pose apart. Along each direction the spread of the views' pulls is
    compared with what the noise model expects (White's sandwich), drawn towards the expectation
    as if six more views had agreed with it, and never taken below it.

    Args:
        N: ``(7, 7)`` the information of all, with the prior.
        pulls: ``(7, 7)`` the covariance that the noise model expects of the sum of the views' pulls
            and of the prior's; `N` where the weights are those of the whole noise model.
        information: ``(V, 7, 7)`` and ``vectors`` ``(V, 7)`` of the views.
        solution: ``(7,)`` the solution of all.
    """
    # Whitened: the sum of the pulls' squares is the identity where the noise model is right.
    root = np.linalg.cholesky(0.5 * (pulls + pulls.T))
    towards = np.linalg.solve(N, root)
    used = np.einsum("vii->v", information) > 0
    n = int(np.count_nonzero(used))
    if n < 3:
        return towards @ towards.T
    white = np.linalg.solve(root, (vectors - information @ solution)[used].T).T
    spread = white.T @ white * (n / (n - 1.0))
    values, axes = np.linalg.eigh((n * spread + 6.0 * np.eye(7)) / (n + 6.0))
    return (towards @ (axes * np.maximum(values, 1.0)) @ axes.T @ towards.T).astype(np.float64)
