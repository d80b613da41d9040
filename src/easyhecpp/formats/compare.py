"""How two calibrations of one camera differ, measured against what they claim to know."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from easyhecpp.errors import InputError
from easyhecpp.formats.result_file import ResultFile
from easyhecpp.geometry import adjoint, inverse, log_se3, pose_error

Array = NDArray[np.float64]

# A p-value below the first says that the results contradict each other, between the two that it is
# hard to say.
_CONTRADICT = 0.01
_AGREE = 0.05

# Nobody knows a camera to a nanometre or a nanoradian; it keeps a covariance that lacks a direction
# invertible.
_FINEST = 1e-9


@dataclass(frozen=True)
class Comparison:
    """The difference of two results a and b.

    Attributes:
        parent: The common parent frame.
        child: The camera frame of a.
        difference_mm: Distance of the two camera centres.
        rotation_deg: Angle between the two orientations.
        workspace_mm: How far apart the results place what a sees at its workspace point, or None
            when a states none.
        delta: ``(6,)`` tangent ``[v, w]`` with ``T_mount_cam_b = T_mount_cam_a @ exp(delta)``,
            metres and radians.
        sigma_mm: Standard deviation that the covariances give to the difference of the centres,
            root of the variances' sum; None without covariances.
        sigma_deg: The same of the angle.
        chi_square: Squared Mahalanobis length of the difference; None without covariances.
        p_value: Probability of a difference at least as large when both results are right about
            their uncertainty (chi-square, 6 degrees of freedom); None without covariances.
        notes: Sentences on what limits the comparison.
    """

    parent: str
    child: str
    difference_mm: float
    rotation_deg: float
    workspace_mm: float | None
    delta: tuple[float, ...]
    sigma_mm: float | None
    sigma_deg: float | None
    chi_square: float | None
    p_value: float | None
    notes: tuple[str, ...]

    @property
    def sentence(self) -> str:
        """The outcome in words."""
        apart = f"The poses differ by {self.difference_mm:.3g} mm and {self.rotation_deg:.3g} deg"
        if self.p_value is None or self.sigma_mm is None or self.sigma_deg is None:
            return f"{apart}. At least one has no covariance, so no uncertainty to judge that by."
        expected = f"{self.sigma_mm:.2g} mm and {self.sigma_deg:.2g} deg are expected"
        if self.p_value >= _AGREE:
            verdict = "they agree within their uncertainty"
        elif self.p_value >= _CONTRADICT:
            verdict = "they agree barely"
        else:
            verdict = (
                "they contradict each other: the camera moved, or at least one pose or its "
                "uncertainty is wrong"
            )
        return (
            f"{apart}, where {expected}: {verdict} (chi-square {self.chi_square:.3g} of 6 degrees "
            f"of freedom, p = {self.p_value:.2g})."
        )


def compare(a: ResultFile, b: ResultFile) -> Comparison:
    """Compare two results of one camera on one mount.

    The errors of the two are taken as independent. Results from the same images share part of
    their errors; they should differ by less than is expected here.

    Raises:
        InputError: One has no pose, or their parent frames are not the same.
    """
    if a.T_mount_cam is None or b.T_mount_cam is None:
        which = "first" if a.T_mount_cam is None else "second"
        raise InputError(f"The {which} result has no pose to compare; its calibration failed")
    if a.T_mount_cam.parent != b.T_mount_cam.parent:
        raise InputError(
            f"The results have different parent frames, {a.T_mount_cam.parent!r} and "
            f"{b.T_mount_cam.parent!r}",
            expected="two poses of the camera in the same frame",
            fix="Calibrate both with the same set-up and base_link (or ee_link)",
        )
    Ta, Tb = a.T_mount_cam.array, b.T_mount_cam.array
    metres, radians = pose_error(Tb, Ta)
    delta = log_se3(inverse(Ta) @ Tb)
    statistics = (None, None, None, None)
    if a.covariance is not None and b.covariance is not None:
        joint = joint_covariance(Ta, a.covariance.array, Tb, b.covariance.array)
        chi = chi_square(delta, joint)
        statistics = (
            1e3 * math.sqrt(np.trace(joint[:3, :3])),
            math.degrees(math.sqrt(np.trace(joint[3:, 3:]))),
            chi,
            p_value(chi),
        )
    return Comparison(
        a.T_mount_cam.parent,
        a.T_mount_cam.child,
        1e3 * metres,
        math.degrees(radians),
        _workspace_mm(a, Ta, Tb),
        tuple(delta.tolist()),
        *statistics,
        _notes(a, b),
    )


def joint_covariance(Ta: ArrayLike, cov_a: ArrayLike, Tb: ArrayLike, cov_b: ArrayLike) -> Array:
    """Covariance of ``delta`` in ``Tb = Ta @ exp(delta)`` where both poses are uncertain.

    With ``D = inv(Ta) Tb``, ``exp(-xa) D exp(xb) = exp(-xa + Ad(D) xb) D`` to first order, so the
    step that would make the two equal has the covariance ``Ca + Ad(D) Cb Ad(D)^T``.

    Args:
        Ta: ``(4, 4)`` pose.
        cov_a: ``(6, 6)`` covariance of ``xa`` in ``Ta @ exp(xa)``, metres and radians.
        Tb: ``(4, 4)`` pose.
        cov_b: The same of ``Tb``.
    """
    Ad = adjoint(inverse(Ta) @ np.asarray(Tb, dtype=np.float64))
    return np.asarray(cov_a, dtype=np.float64) + Ad @ np.asarray(cov_b, dtype=np.float64) @ Ad.T


def chi_square(delta: ArrayLike, covariance: ArrayLike) -> float:
    """Squared Mahalanobis length of ``delta`` ``(6,)`` under ``covariance`` ``(6, 6)``."""
    C = np.asarray(covariance, dtype=np.float64) + _FINEST**2 * np.eye(6)
    delta = np.asarray(delta, dtype=np.float64)
    return float(delta @ np.linalg.solve(C, delta))


def p_value(chi: float) -> float:
    """Probability that a chi-square variable of 6 degrees of freedom is at least ``chi``."""
    half = 0.5 * chi
    return math.exp(-half) * (1.0 + half + 0.5 * half * half)


def _workspace_mm(a: ResultFile, Ta: Array, Tb: Array) -> float | None:
    if a.sigma is None or a.sigma.workspace_point_m is None:
        return None
    point = np.append(a.sigma.workspace_point_m, 1.0)
    moved = Tb @ inverse(Ta) @ point
    return 1e3 * float(np.linalg.norm(moved[:3] - point[:3]))


def _notes(a: ResultFile, b: ResultFile) -> tuple[str, ...]:
    notes = [
        f"The {which} result's verdict is {result.verdict}."
        for which, result in (("first", a), ("second", b))
        if result.verdict != "ok"
    ]
    if a.camera.frame != b.camera.frame:
        notes.append(
            f"The camera frames are called {a.camera.frame!r} and {b.camera.frame!r}; the "
            "comparison means something only if they are the same."
        )
    if a.camera.model_copy(update={"frame": b.camera.frame}) != b.camera:
        notes.append("The results were made with different intrinsics.")
    return tuple(notes)
