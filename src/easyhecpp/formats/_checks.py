"""Questions that are put to transforms and covariances that came from outside."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from easyhecpp.geometry import matrix_from_quat_wxyz, rotation_angle

# Far above the rounding of any writer with seven digits, far below anything that matters.
ROTATION_TOLERANCE = 1e-6
DISTANCE_TOLERANCE = 1e-6


def rigid_problems(T: ArrayLike) -> list[str]:
    """Say why ``T`` is no rigid transform; empty when it is one.

    Args:
        T: Anything that should be ``(4, 4)``, rotation and translation over ``0 0 0 1``.
    """
    try:
        T = np.asarray(T, dtype=np.float64)
    except (TypeError, ValueError):
        return ["it is not a matrix of numbers"]
    if T.shape != (4, 4):
        return [f"its shape is {T.shape}, not (4, 4)"]
    if not np.isfinite(T).all():
        return ["it holds numbers that are not finite"]
    problems = []
    if not np.array_equal(T[3], [0.0, 0.0, 0.0, 1.0]):
        problems.append(f"its last row is {T[3].tolist()}, not [0, 0, 0, 1]")
    R = T[:3, :3]
    skew = float(np.abs(R @ R.T - np.eye(3)).max())
    if skew > ROTATION_TOLERANCE:
        problems.append(
            "its upper left 3x3 block is not a rotation: the columns are off from perpendicular "
            f"unit vectors by {skew:.2g}"
        )
    elif np.linalg.det(R) < 0.0:
        problems.append("its upper left 3x3 block is a reflection, with determinant -1")
    return problems


def quaternion_problems(quat_wxyz: ArrayLike, R: ArrayLike | None = None) -> list[str]:
    """Say why a quaternion is not of unit length, or not that of the rotation ``R``."""
    q = np.asarray(quat_wxyz, dtype=np.float64)
    length = float(np.linalg.norm(q))
    if abs(length - 1.0) > ROTATION_TOLERANCE:
        return [f"the quaternion's length is {length:.8g}, not 1"]
    if R is None:
        return []
    angle = float(rotation_angle(matrix_from_quat_wxyz(q).T @ np.asarray(R, dtype=np.float64)))
    if angle <= 2.0 * ROTATION_TOLERANCE:
        return []
    hint = ""
    swapped = matrix_from_quat_wxyz(np.roll(q, 1))
    if float(rotation_angle(swapped.T @ np.asarray(R, dtype=np.float64))) < 1e-4:
        hint = "; its entries look like xyzw, and wxyz is meant"
    return [f"the quaternion turns {np.degrees(angle):.4g} deg away from the matrix{hint}"]


def covariance_problems(covariance: ArrayLike) -> list[str]:
    """Say why a ``(6, 6)`` matrix is no covariance; empty when it is one."""
    C = np.asarray(covariance, dtype=np.float64)
    if C.shape != (6, 6):
        return [f"the covariance's shape is {C.shape}, not (6, 6)"]
    if not np.isfinite(C).all():
        return ["the covariance holds numbers that are not finite"]
    variances = np.diag(C)
    if (variances < 0.0).any():
        return ["the covariance has a negative variance on its diagonal"]
    # Metres and radians: compare the entries as correlations.
    scale = np.sqrt(variances)
    scale[scale == 0.0] = 1.0
    correlation = C / np.outer(scale, scale)
    if np.abs(correlation - correlation.T).max() > 1e-6:
        return ["the covariance is not symmetric"]
    if np.linalg.eigvalsh(0.5 * (correlation + correlation.T)).min() < -1e-6:
        return ["the covariance has a negative eigenvalue, so some direction has negative variance"]
    return []
