"""The camera's uncertainty with views that are not taken yet."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from easyhecpp.camera import Camera
from easyhecpp.explore.information import ViewPredictor
from easyhecpp.explore.knowledge import Knowledge
from easyhecpp.geometry import (
    adjoint,
    inverse,
    pose_covariance_from_centred,
    transform_points,
    translation_matrix,
)
from easyhecpp.rig import Rig
from easyhecpp.solve.correlated import COVARIANCE_INFLATION

F64 = NDArray[np.float64]

_LARGEST_SCALE = 100.0


@dataclass(frozen=True, eq=False)
class Forecast:
    """What the known views say, and what a further one would add.

    Attributes:
        predictor: Of the information of views.
        Ts_mount_cam: ``(H, 4, 4)`` poses that the camera may have; the first is the estimate.
        centre_mount: ``(3,)`` point that all information refers to.
        known: ``(7, 7)`` information of the known views and of the dilation's prior.
        scale: Factor on predicted information: what the known views turned out to be worth,
            against what would have been predicted for them. So better or worse masks, or edges
            instead of masks, need no setting.
        inflation: Factor by which the optimiser states covariances larger than it computes them.
    """

    predictor: ViewPredictor
    Ts_mount_cam: F64
    centre_mount: F64
    known: F64
    scale: float
    inflation: float

    @classmethod
    def of(
        cls,
        rig: Rig,
        camera: Camera,
        known: Knowledge,
        hypotheses: int,
        rng: np.random.Generator,
    ) -> Forecast:
        """Set up from what is known.

        Args:
            rig: Robot and set-up.
            camera: Intrinsics.
            known: The camera as far as it is known.
            hypotheses: Number of poses that the camera may have, with the estimate itself.
            rng: Draws the others.
        """
        predictor = ViewPredictor(rig, camera)
        T = known.T_mount_cam
        centre_mount = _middle(rig, known)
        centre_cam = transform_points(inverse(T), centre_mount)
        own, inflation = _own_information(known, centre_cam)
        expected = predictor.information(T[None], known.joints, centre_mount)[:, 0].sum(axis=0)
        prior = np.zeros((7, 7))
        prior[6, 6] = 1.0 / predictor.noise.dilation_prior_px**2
        return cls(
            predictor=predictor,
            Ts_mount_cam=np.concatenate([T[None], known.hypotheses(hypotheses - 1, rng)]),
            centre_mount=centre_mount,
            known=own + prior,
            scale=_ratio(own, expected),
            inflation=inflation,
        )

    def information(self, joints: F64, hypotheses: int | None = None) -> F64:
        """Information ``(N, H, 7, 7)`` of views at ``(N, n)``, under the first hypotheses."""
        Ts = self.Ts_mount_cam[:hypotheses]
        return self.scale * self.predictor.information(Ts, joints, self.centre_mount)

    def covariances(self, joints: F64, hypotheses: int | None = None) -> F64:
        """Covariance ``(N, H, 6, 6)`` of the camera's tangent with each view added."""
        found = self.known + self.information(joints, hypotheses)
        J = self._to_camera(hypotheses)
        return self.inflation * (J @ np.linalg.inv(found)[..., :6, :6] @ np.swapaxes(J, -1, -2))

    def mean_squares(self, joints: F64, hypotheses: int | None = None) -> F64:
        """Expected square ``(N,)`` of the camera's error with each view added, m^2.

        That of the position, plus that of the orientation times the distance to the arm: by so
        much it displaces what the camera sees there.
        """
        C = self.covariances(joints, hypotheses)
        distance = float(np.linalg.norm(self.Ts_mount_cam[0, :3, 3] - self.centre_mount))
        lengths = np.array([1.0, 1.0, 1.0, distance, distance, distance])
        return (np.diagonal(C, axis1=-2, axis2=-1) @ lengths**2).mean(axis=1)

    def expected(self, joints: F64) -> tuple[float, float]:
        """Standard deviation of position, mm, and orientation, deg, with one view ``(n,)``."""
        return sigmas(self.covariances(joints[None])[0].mean(axis=0))

    def present(self) -> tuple[float, float]:
        """Standard deviation of position, mm, and orientation, deg, as it is."""
        J = self._to_camera(1)[0]
        return sigmas(self.inflation * (J @ np.linalg.inv(self.known)[:6, :6] @ J.T))

    def with_view(self, joints: F64) -> Forecast:
        """As if the view ``(n,)`` had been taken and had turned out as expected."""
        gained = self.information(joints[None])[0].mean(axis=0)
        return replace(self, known=self.known + gained)

    def _to_camera(self, hypotheses: int | None) -> F64:
        """``(H, 6, 6)``: from motion about the arm's middle to motion of the camera."""
        Ts = self.Ts_mount_cam[:hypotheses]
        return -adjoint(translation_matrix(transform_points(inverse(Ts), self.centre_mount)))


def sigmas(covariance: F64) -> tuple[float, float]:
    """Standard deviation of position, mm, and orientation, deg, of a ``(6, 6)`` covariance."""
    variances = np.diag(covariance)
    return (
        1e3 * float(np.sqrt(variances[:3].sum())),
        float(np.rad2deg(np.sqrt(variances[3:].sum()))),
    )


def _middle(rig: Rig, known: Knowledge) -> F64:
    """The point that the known information refers to, mount frame."""
    if known.centre_cam is not None:
        return transform_points(known.T_mount_cam, known.centre_cam)
    joints = known.joints if len(known.joints) else rig.robot.neutral[None]
    T_mount_base = inverse(rig.robot.frame_pose(joints, rig.mount))
    return transform_points(T_mount_base, rig.robot.centre(joints)[:, None])[:, 0].mean(axis=0)


def _own_information(known: Knowledge, centre_cam: F64) -> tuple[F64, float]:
    """Information ``(7, 7)`` of the known views, and the covariance's inflation."""
    if known.information is not None:
        own = known.information.sum(axis=0)
        with np.errstate(all="ignore"):
            stated = pose_covariance_from_centred(_inverse(own), centre_cam)
        inflation = float(np.trace(known.covariance[:3, :3]) / np.trace(stated[:3, :3]))
        if np.isfinite(inflation) and inflation > 0.0:
            return own, inflation
    back = pose_covariance_from_centred(known.covariance, -centre_cam)
    own = np.zeros((7, 7))
    own[:6, :6] = COVARIANCE_INFLATION * np.linalg.inv(back)
    return own, COVARIANCE_INFLATION


def _inverse(information: F64) -> F64:
    """Covariance ``(6, 6)`` of the pose; not a number where it is not determined."""
    N = information.copy()
    N[6, 6] += 4.0
    try:
        return np.linalg.inv(N)[:6, :6]
    except np.linalg.LinAlgError:
        return np.full((6, 6), np.nan)


def _ratio(own: F64, expected: F64) -> float:
    """By how much the known views are worth more than predicted; 1 where it cannot be told."""
    sign, log_expected = np.linalg.slogdet(expected[:6, :6])
    if sign <= 0.0:
        return 1.0
    log_own = np.linalg.slogdet(own[:6, :6])[1]
    ratio = float(np.exp((log_own - log_expected) / 6.0))
    return float(np.clip(ratio, 1.0 / _LARGEST_SCALE, _LARGEST_SCALE))
