"""Uncertainty at a point of the workspace."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from easyhecpp.geometry import hat

F64 = NDArray[np.float64]


def point_sigma_mm(covariance: F64, point_cam: F64) -> float:
    """Standard deviation of where a point that the camera sees lies in the mount's frame.

    Args:
        covariance: ``(6, 6)`` of ``[v, w]`` in ``T_mount_cam @ exp([v, w])``, metres and radians.
        point_cam: ``(3,)`` the point in the camera frame, metres.

    Returns:
        Millimetres; the root of the variances' sum over the axes.
    """
    # The point moves by v + w x p in the mount, up to a rotation.
    J = np.hstack([np.eye(3), -hat(point_cam)])
    return 1e3 * float(np.sqrt(max(0.0, float(np.trace(J @ covariance @ J.T)))))
