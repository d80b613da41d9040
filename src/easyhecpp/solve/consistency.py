"""Which views belong together, and the pose on those alone.

The robust joint solution shrugs off a bad minority: views far from it are left out, named, and the
pose is solved again. When so many views disagree that it must be an average of contradictions, the
poses of single views and pairs are tried instead, and the one that most views agree with wins.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from easyhecpp.camera import Camera
from easyhecpp.geometry import inverse
from easyhecpp.rig import Rig
from easyhecpp.solve.agreement import Agreement, agreement, pixel_unit, subproblem
from easyhecpp.solve.leave_out import Prediction, leave_one_out
from easyhecpp.solve.lens import LensStrain
from easyhecpp.solve.optimise import solve_prepared
from easyhecpp.solve.problem import PoseProblem
from easyhecpp.solve.reasons import FEW_CONTOUR, FEW_CONTOUR_PX, reason_for
from easyhecpp.solve.strains import Strain, strains
from easyhecpp.solve.subsets import largest_consistent_set
from easyhecpp.solve.types import Observation, PoseEstimate, SolveConfig

F64 = NDArray[np.float64]

Flags = NDArray[np.bool_]

_GROSS_PX, _GROSS_RATIO = 2.5, 3.0
_GROSS_MISMATCH, _MISMATCH_RATIO = 0.05, 2.0
_TYPICAL_PX, _TYPICAL_MISMATCH = 3.0, 0.1
_SURPRISE, _SURPRISE_PX = 60.0, 2.0
_ROUNDS = 3


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
            searched for, and is what the pose rests on.
        contradictory: True when no two views agree, so that the pose is an average at best.
        strains: What the residuals say about intrinsics and joint zeros taken as known.
        lens: What they say about the lens; None where no view tells anything.
        sag_asked: Whether they ask for the arm's sag.
    """

    views: tuple[ViewFinding, ...]
    searched: bool = False
    contradictory: bool = False
    strains: tuple[Strain, ...] = ()
    lens: LensStrain | None = None
    sag_asked: bool = False

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
    config = config or SolveConfig()
    near = replace(config, start_error_px=min(config.start_error_px, 8.0))
    starts = list(np.asarray(T_mount_cam_init, np.float64).reshape(-1, 4, 4))
    problem = PoseProblem(rig, camera, observations)
    estimate = solve_prepared(problem, starts[0], config)
    everything = np.ones(len(observations), bool)
    kept = everything
    searched = contradictory = False
    seen = agreement(problem, inverse(estimate.T_mount_cam))
    if _is_an_average(problem, seen):
        found = largest_consistent_set(
            problem, [inverse(estimate.T_mount_cam), *(inverse(T) for T in starts[:1])]
        )
        if found is None:
            contradictory = True
        elif not found.views.all():
            kept, searched = found.views, True
            estimate = _solve_on(kept, problem, inverse(found.T_cam_mount), near)
    for _ in range(_ROUNDS if not contradictory else 0):
        seen = agreement(problem, inverse(estimate.T_mount_cam))
        now = _kept(problem, seen, leave_one_out(estimate), kept)
        if (now == kept).all() or now.sum() < min(2, len(now)):
            break
        kept = now
        estimate = _solve_on(kept, problem, estimate.T_mount_cam, near)
    return _named(problem, estimate, kept, searched, contradictory)


def _solve_on(
    kept: Flags, problem: PoseProblem, T_mount_cam: F64, config: SolveConfig
) -> PoseEstimate:
    weighted = [
        o if keep else replace(o, weight=0.0)
        for o, keep in zip(problem.observations, kept, strict=True)
    ]
    some = PoseProblem(problem.rig, problem.camera, weighted, problem.masks)
    return solve_prepared(some, T_mount_cam, config)


def _is_an_average(problem: PoseProblem, seen: Agreement) -> bool:
    """Whether the views look as if the pose were a compromise between them."""
    if len(problem) < 2:
        return False
    typical_px = float(np.median(seen.distance_px))
    typical_mismatch = float(np.median(seen.mismatch))
    return bool(
        typical_px > _TYPICAL_PX * pixel_unit(problem)
        or typical_mismatch > _TYPICAL_MISMATCH
        or np.mean(_gross(problem, seen, np.ones(len(problem), bool))) > 1.0 / 3.0
    )


def _gross(problem: PoseProblem, seen: Agreement, kept: Flags) -> Flags:
    """Views much farther off than is typical of those kept."""
    typical_px = float(np.median(seen.distance_px[kept]))
    typical_mismatch = float(np.median(seen.mismatch[kept]))
    return (seen.distance_px > max(_GROSS_PX * pixel_unit(problem), _GROSS_RATIO * typical_px)) | (
        seen.mismatch > _MISMATCH_RATIO * typical_mismatch + _GROSS_MISMATCH
    )


def _kept(
    problem: PoseProblem, seen: Agreement, predictions: Sequence[Prediction], kept: Flags
) -> Flags:
    gross = _gross(problem, seen, kept)
    apart = np.array(
        [
            p.surprise > _SURPRISE and p.moved_px > _SURPRISE_PX * pixel_unit(problem)
            for p in predictions
        ]
    )
    # One wrong view makes its neighbours look wrong: take the most surprising of them at a time.
    if apart.any() and not gross[kept].any():
        worst = int(
            np.argmax([p.surprise if a else -1.0 for p, a in zip(predictions, apart, strict=True)])
        )
        gross = gross.copy()
        gross[worst] = kept.sum() > 2
    # A view once left out comes back only when it is well within the limits.
    back = seen.distance_px < 0.6 * _GROSS_PX * pixel_unit(problem)
    return ~gross & (kept | back)


def _named(
    problem: PoseProblem,
    estimate: PoseEstimate,
    kept: Flags,
    searched: bool,
    contradictory: bool,
) -> tuple[PoseEstimate, Findings]:
    """Write the findings, and flag the views of the estimate."""
    T_cam_mount = inverse(estimate.T_mount_cam)
    seen = agreement(problem, T_cam_mount)
    typical = float(np.median(seen.mismatch[kept]))
    findings, views = [], []
    for i, (view, p) in enumerate(zip(estimate.views, leave_one_out(estimate), strict=True)):
        flags: tuple[str, ...] = ()
        sentence = ""
        if not kept[i]:
            word, sentence = reason_for(problem, i, T_cam_mount, seen, typical)
            flags = (word,)
        elif view.contour_px < FEW_CONTOUR_PX * pixel_unit(problem):
            flags = (FEW_CONTOUR,)
            sentence = f"View {view.id} shows hardly any outline of the arm and says little."
        findings.append(ViewFinding(view.id, bool(kept[i]), flags, sentence))
        views.append(replace(view, flags=flags, prediction_px=p.rms_px))
    found = Findings(tuple(findings), searched, contradictory)
    return replace(estimate, views=tuple(views)), _tested(found, problem, T_cam_mount)


def retested(
    findings: Findings,
    rig: Rig,
    camera: Camera,
    observations: Sequence[Observation],
    T_mount_cam: F64,
) -> Findings:
    """The findings with intrinsics and joint zeros tested through another camera.

    Which views agree is taken over: a better camera makes none of them disagree.

    Args:
        findings: Of these views, by their names, and maybe of others.
        rig: Robot and set-up.
        camera: Intrinsics to be tested.
        observations: The views with their masks.
        T_mount_cam: ``(4, 4)`` pose that goes with the camera, within a few pixels of the masks.
    """
    return _tested(findings, PoseProblem(rig, camera, observations), inverse(T_mount_cam))


def _tested(findings: Findings, problem: PoseProblem, T_cam_mount: F64) -> Findings:
    """The findings with the strains of the views that agree."""
    agree = {view.id for view in findings.views if view.consistent}
    some = [i for i, o in enumerate(problem.observations) if (o.id or str(i)) in agree]
    if not some:
        return findings
    said = strains(subproblem(problem, some), T_cam_mount)
    return replace(findings, strains=said.parameters, lens=said.lens, sag_asked=said.sag_asked)
