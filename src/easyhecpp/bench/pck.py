"""PCK: the share of images in which the end effector is found within a threshold.

As the published Baxter tables define it: one keypoint, the end effector; its predicted place is
carried into the camera's frame, and compared with the measured one in pixels at full resolution and
in space. An error must be smaller than the threshold, not equal.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from easyhecpp.camera import Camera

F64 = NDArray[np.float64]

AUC_2D_PX, AUC_3D_MM = 200, 400
"""The area under the curve is the mean over so many whole thresholds, from 0."""


@dataclass(frozen=True)
class KeypointErrors:
    """Errors of the end effector's place, image by image; infinite where no pose was found.

    Attributes:
        pixels: (N,).
        metres: (N,).
    """

    pixels: F64
    metres: F64

    @classmethod
    def between(
        cls, camera: Camera, points_cam: F64, measured_px: F64, measured_cam: F64
    ) -> KeypointErrors:
        """Compare predicted points (N, 3) with measured ones (N, 2) and (N, 3), camera frame."""
        return cls(
            np.linalg.norm(camera.project(points_cam) - measured_px, axis=-1),
            np.linalg.norm(points_cam - measured_cam, axis=-1),
        )

    @classmethod
    def missing(cls, count: int) -> KeypointErrors:
        """No pose was found for so many images."""
        return cls(np.full(count, np.inf), np.full(count, np.inf))

    @classmethod
    def joined(cls, parts: Sequence[KeypointErrors]) -> KeypointErrors:
        """All images together."""
        return cls(
            np.concatenate([part.pixels for part in parts]),
            np.concatenate([part.metres for part in parts]),
        )

    def pck_2d(self, thresholds_px: Sequence[float]) -> list[float]:
        """Share of images with an error below each threshold."""
        return [float(np.mean(self.pixels < t)) for t in thresholds_px]

    def pck_3d(self, thresholds_cm: Sequence[float]) -> list[float]:
        """Share of images with an error below each threshold."""
        return [float(np.mean(self.metres < t / 100.0)) for t in thresholds_cm]

    @property
    def auc_2d(self) -> float:
        """Mean of the PCK over 0, 1, ..., 199 pixels."""
        return float(np.mean(self.pck_2d(range(AUC_2D_PX))))

    @property
    def auc_3d(self) -> float:
        """Mean of the PCK over 0, 1, ..., 399 millimetres."""
        return float(np.mean(self.pck_3d([t / 10.0 for t in range(AUC_3D_MM)])))
