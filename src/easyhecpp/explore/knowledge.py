"""What is known before a joint pose is chosen, and what is said about the choice."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from easyhecpp.errors import InputError
from easyhecpp.geometry import exp_se3
from easyhecpp.solve import PoseEstimate

F64 = NDArray[np.float64]

Method = Literal["information", "consistency", "random"]
METHODS: tuple[str, ...] = get_args(Method)


@dataclass(frozen=True)
class Knowledge:
    """The camera as far as it is known.

    Attributes:
        T_mount_cam: ``(4, 4)`` present estimate.
        covariance: ``(6, 6)`` of the tangent ``[v, w]`` in ``T_mount_cam @ exp([v, w])``.
        joints: ``(k, n)`` of the views that it rests on.
        information: ``(k, 7, 7)`` of these views on ``[delta, dilation]`` as the optimiser states
            it; None when only the covariance is at hand (from a result file).
        centre_cam: ``(3,)`` point that ``delta`` turns about, camera frame; with `information`.
    """

    T_mount_cam: F64
    covariance: F64
    joints: F64
    information: F64 | None = None
    centre_cam: F64 | None = None

    def __post_init__(self) -> None:
        C = np.asarray(self.covariance)
        if C.shape != (6, 6) or not np.isfinite(C).all() or np.linalg.eigvalsh(C).min() <= 0.0:
            raise InputError(
                "The covariance of the camera's pose is no covariance",
                where="covariance",
                expected="a symmetric positive definite (6, 6) matrix, metres and radians",
            )
        if (self.information is None) != (self.centre_cam is None):
            raise InputError(
                "The information of the views and the point it refers to belong together",
                where="information, centre_cam",
                expected="both, as in a PoseEstimate, or neither",
            )

    @classmethod
    def of(cls, estimate: PoseEstimate, joints: Sequence[F64] | F64) -> Knowledge:
        """Take over an estimate; ``joints`` ``(k, n)`` are those of its views, in order."""
        return cls(
            estimate.T_mount_cam,
            estimate.covariance,
            np.atleast_2d(np.asarray(joints, np.float64)),
            estimate.information,
            estimate.centre_cam,
        )

    def hypotheses(self, count: int, rng: np.random.Generator) -> F64:
        """Poses ``(count, 4, 4)`` that the camera may have, drawn from the covariance."""
        drawn = rng.multivariate_normal(np.zeros(6), self.covariance, count, method="cholesky")
        return self.T_mount_cam @ exp_se3(drawn)


@dataclass(frozen=True)
class Proposal:
    """A joint pose to take the next picture at.

    Attributes:
        joints: ``(n,)`` radians and metres; the best known even when `stop` is set.
        method: How it was chosen.
        score: Of the method, larger is better: for ``information`` the expected error of position
            and orientation together, mm at the arm's distance, negated; for ``consistency`` the
            summed variance in pixels; 0 for ``random``.
        predicted_position_mm: Standard deviation of the camera's position with this view.
        predicted_rotation_deg: The same for its orientation.
        position_mm: Standard deviation of the camera's position without it.
        rotation_deg: The same for its orientation.
        gain: Share of `position_mm` that the view takes away.
        considered: Number of joint poses scored.
        rejected: Number of joint poses dropped before, by reason.
        reason: Why this one, a sentence.
        stop: Whether there is no need for another view.
        stop_reason: Why, a sentence; empty when there is need.
        notes: What the user should know.
    """

    joints: F64
    method: Method
    score: float
    predicted_position_mm: float
    predicted_rotation_deg: float
    position_mm: float
    rotation_deg: float
    gain: float
    considered: int
    rejected: dict[str, int] = field(default_factory=dict)
    reason: str = ""
    stop: bool = False
    stop_reason: str = ""
    notes: tuple[str, ...] = ()
