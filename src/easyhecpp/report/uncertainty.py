"""The pose's covariance as lengths and directions that people can picture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from easyhecpp.formats.result_file import ResultFile
from easyhecpp.geometry import hat, inverse

F64 = NDArray[np.float64]

SIGMAS_95 = 2.795
"""Half axes, in standard deviations, of the ellipsoid that holds 95 % of a 3-D Gaussian."""

_AXES = ("sideways", "up and down", "along the viewing direction")


@dataclass(frozen=True)
class Uncertainty:
    """Covariances of two positions along the camera's axes (right, down, forward), square metres.

    Attributes:
        camera: ``(3, 3)`` of the camera's centre.
        workspace: ``(3, 3)`` of a point at the arm that is measured through the camera, or None.
        distance: From the camera to that point along the viewing direction, metres, or None.
    """

    camera: F64
    workspace: F64 | None
    distance: float | None

    @classmethod
    def of(cls, result: ResultFile) -> Uncertainty | None:
        """Of a result; None when it has no covariance."""
        if result.covariance is None or result.T_mount_cam is None:
            return None
        covariance = result.covariance.array
        sigma = result.sigma
        if sigma is None or sigma.workspace_point_m is None:
            return cls(covariance[:3, :3], None, None)
        point = np.append(sigma.workspace_point_m, 1.0)
        p_cam = (inverse(result.T_mount_cam.array) @ point)[:3]
        J = np.hstack([np.eye(3), -hat(p_cam)])
        return cls(covariance[:3, :3], J @ covariance @ J.T, float(p_cam[2]))

    def half_axes_mm(self) -> F64:
        """Half axes of the camera's 95 % ellipsoid, longest first, millimetres."""
        variances = np.linalg.eigvalsh(self.camera)[::-1]
        return 1e3 * SIGMAS_95 * np.sqrt(np.maximum(variances, 0.0))

    def longest_direction(self) -> str:
        """Where the longest half axis points, in words."""
        _, vectors = np.linalg.eigh(self.camera)
        share = np.abs(vectors[:, -1])
        if share.max() < 0.8:
            return "at a slant to the viewing direction"
        return _AXES[int(np.argmax(share))]
