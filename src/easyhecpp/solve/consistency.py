"""Which views belong together, and the pose on those alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from easyhecpp.camera import Camera
from easyhecpp.rig import Rig
from easyhecpp.solve.optimise import solve_pose
from easyhecpp.solve.types import Observation, PoseEstimate, SolveConfig

F64 = NDArray[np.float64]

_GROSS_PX, _GROSS_RATIO = 4.0, 6.0


@dataclass(frozen=True)
class ViewFinding:
    """What was found out about one view.

    Attributes:
        id: Name of the view.
        consistent: Whether it agrees with the pose; a view that does not took no part in it.
        flags: Reasons, one word each: ``moving``, ``mask``, ``camera-moved``, ``hidden``,
            ``few-contour``.
        sentence: The same for people, with what to do; empty when there is nothing to say.
    """

    id: str
    consistent: bool
    flags: tuple[str, ...] = ()
    sentence: str = ""


@dataclass(frozen=True)
class Findings:
    """How the views of a calibration agree with each other.

    Attributes:
        views: One entry per observation, in their order.
        searched: True when so many views disagreed that the largest consistent set had to be
            searched for.
    """

    views: tuple[ViewFinding, ...]
    searched: bool = False

    @property
    def inconsistent(self) -> tuple[str, ...]:
        """Names of the views that took no part in the pose."""
        return tuple(v.id for v in self.views if not v.consistent)


def solve_consistent(
    rig: Rig,
    camera: Camera,
    observations: Sequence[Observation],
    T_mount_cam_init: F64 | Sequence[F64],
    config: SolveConfig | None = None,
) -> tuple[PoseEstimate, Findings]:
    """Optimise the pose on the views that agree with each other, and name the others.

    Args:
        rig: Robot and set-up.
        camera: Intrinsics.
        observations: The views with their masks.
        T_mount_cam_init: ``(4, 4)`` start, or several, best first.
        config: Settings.

    Raises:
        InputError: No view, or sizes that do not fit.
        CalibrationError: The arm is in no view at the start.
    """
    start = np.asarray(T_mount_cam_init, np.float64).reshape(-1, 4, 4)[0]
    estimate = solve_pose(rig, camera, observations, start, config)
    typical = float(np.median([v.outlier_px for v in estimate.views]))
    wrong = [v.outlier_px > max(_GROSS_PX, _GROSS_RATIO * typical) for v in estimate.views]
    if any(wrong):
        kept = [
            replace(o, weight=0.0) if bad else o for o, bad in zip(observations, wrong, strict=True)
        ]
        estimate = solve_pose(rig, camera, kept, estimate.T_mount_cam, config)
    findings = tuple(
        ViewFinding(
            v.id,
            not bad,
            ("mask",) if bad else (),
            f"View {v.id}: its mask does not agree with the other views." if bad else "",
        )
        for v, bad in zip(estimate.views, wrong, strict=True)
    )
    views = tuple(replace(v, flags=f.flags) for v, f in zip(estimate.views, findings, strict=True))
    return replace(estimate, views=views), Findings(findings)
