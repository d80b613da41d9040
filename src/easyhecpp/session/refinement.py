"""Intrinsics and joint zeros refined together with the pose.

What the user names, and unasked, where the outlines show it, the lens of a camera_info without
distortion, the arm's sag and the zeros of its joints.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from easyhecpp.camera import Camera
from easyhecpp.capture import Capture
from easyhecpp.errors import CalibrationError
from easyhecpp.formats.result_file import ResultFile
from easyhecpp.segment.edges import EdgeRefinement
from easyhecpp.session.outcome import Outcome, observations_of
from easyhecpp.session.stages import Stages
from easyhecpp.solve import PoseEstimate, SolveConfig
from easyhecpp.solve.all_unknowns import INTRINSICS
from easyhecpp.solve.consistency import solve_consistent
from easyhecpp.solve.joint_offsets import SAG, joints_as_they_stand
from easyhecpp.solve.nuisance import read_priors, refine_nuisances
from easyhecpp.solve.strains import Strain

F64 = NDArray[np.float64]

_SURE_OF_OFFSET = 2.5
"""Standard deviations from which sag or a joint's zero is worth a word."""


@dataclass(frozen=True)
class Refined:
    """A calibration's state, with what was refined beside the pose so far.

    Attributes:
        capture: With the refined intrinsics and joints.
        outcome: The pose that goes with them.
        corrections: What was refined, by how much.
        pose_covariance: ``(6, 6)`` that the doubt about the parameters adds to the pose's, where
            the outcome does not count it yet.
    """

    capture: Capture
    outcome: Outcome
    corrections: tuple[Strain, ...] = ()
    pose_covariance: F64 | None = None

    def with_doubt(self) -> Outcome:
        """The outcome with the doubt about the parameters in its error bar."""
        if self.pose_covariance is None:
            return self.outcome
        estimate = self.outcome.estimate
        covariance = estimate.covariance + self.pose_covariance
        return replace(self.outcome, estimate=replace(estimate, covariance=covariance))


def refine(state: Refined, words: tuple[str, ...], stages: Stages, config: SolveConfig) -> Refined:
    """Refine what the words name, and the pose with it, on the masks.

    Args:
        state: The views, and the pose so far.
        words: See `read_priors`; nothing is done when there are none.
        stages: Keeps the times.
        config: Settings of the optimiser.

    Returns:
        The refined state. Where the data cannot tell a parameter from the pose, nothing is refined
        and the reason is among the outcome's doubts.

    Raises:
        InputError: A word that names nothing.
    """
    priors = read_priors(words, state.capture.robot.joint_names)
    if not priors:
        return state
    try:
        return _refined(state, priors, stages, config)
    except CalibrationError as error:
        doubts = (*state.outcome.doubts, str(error))
        return replace(state, outcome=replace(state.outcome, doubts=doubts))


def refine_asked(state: Refined, stages: Stages, config: SolveConfig) -> Refined:
    """Refine what the masks ask for: a lens that is stated without distortion, the arm's sag.

    What the data cannot tell from the pose after all stays as it is.

    Args:
        state: The views, and the pose from their masks.
        stages: Keeps the times.
        config: Settings of the optimiser.
    """
    findings, lens = state.outcome.findings, state.outcome.findings.lens
    asked = []
    if lens is not None and lens.asked and not state.capture.camera.is_distorted:
        asked.append("lens")
    if findings.sag_asked and SAG not in {strain.name for strain in state.corrections}:
        asked.append(SAG)
    # Both together; where the views cannot tell that many, the first alone.
    for some in dict.fromkeys((tuple(asked), tuple(asked[:1]))):
        priors = read_priors(some, state.capture.robot.joint_names)
        with suppress(CalibrationError):
            return _refined(state, priors, stages, config) if priors else state
    return state


def _refined(
    state: Refined, priors: dict[str, float], stages: Stages, config: SolveConfig
) -> Refined:
    """Raises CalibrationError where the data cannot tell a parameter from the pose."""
    capture, outcome = state.capture, state.outcome
    out = set(outcome.findings.inconsistent)
    seen = [o for o in observations_of(capture, outcome.masks) if o.id not in out]
    with stages.stage("refine", f"refining {', '.join(priors)} with the pose"):
        found = refine_nuisances(
            capture.rig, capture.camera, seen, outcome.estimate.T_mount_cam, priors
        )
        capture = _corrected(capture, found.camera, found.corrections)
        estimate, findings = solve_consistent(
            capture.rig,
            capture.camera,
            observations_of(capture, outcome.masks),
            [found.T_mount_cam],
            replace(config, start_error_px=min(config.start_error_px, 8.0)),
        )
    before = state.pose_covariance
    return Refined(
        capture,
        replace(outcome, estimate=estimate, findings=findings),
        add_corrections(state.corrections, found.corrections),
        found.pose_covariance if before is None else before + found.pose_covariance,
    )


def corrected_by(capture: Capture, found: EdgeRefinement) -> Capture:
    """The capture with the lens and the joints that the edge stage ended with."""
    if not found.corrections:
        return capture
    return _corrected(capture, found.camera, found.corrections)


def as_refined(capture: Capture, result: ResultFile) -> Capture:
    """A capture with the intrinsics and joints that a result's pose holds for.

    Args:
        capture: As recorded; of another resolution, it keeps its intrinsics.
        result: Of this arm and camera.
    """
    if not result.refined:
        return capture
    stated, taken = capture.camera, result.camera.to_camera()
    same_size = (stated.width, stated.height) == (taken.width, taken.height)
    corrections = [Strain(p.name, p.correction, p.sigma) for p in result.refined]
    return _corrected(capture, taken if same_size else stated, corrections)


def _corrected(capture: Capture, camera: Camera, corrections: Sequence[Strain]) -> Capture:
    """The capture seen through another camera, its joints where the corrections put them."""
    by = {strain.name: strain.value for strain in corrections}
    views = tuple(
        view.with_joints(joints_as_they_stand(capture.robot, view.joints, by))
        for view in capture.views
    )
    return replace(capture, camera=camera, views=views)


def add_corrections(before: tuple[Strain, ...], more: tuple[Strain, ...]) -> tuple[Strain, ...]:
    """Corrections on top of earlier ones: each parameter once, by its whole correction."""
    known = {strain.name: strain for strain in before}
    for strain in more:
        earlier = known[strain.name].value if strain.name in known else 0.0
        known[strain.name] = replace(strain, value=earlier + strain.value)
    return tuple(known.values())


def joint_offset_notes(
    corrections: tuple[Strain, ...], asked_for: tuple[str, ...]
) -> tuple[str, ...]:
    """What the user should know about joints that were found to be off, unasked, in all views.

    Args:
        corrections: What was refined.
        asked_for: What the user wanted refined, see `read_priors`.
    """
    wanted = {word.partition("=")[0] for word in asked_for}
    sure = [
        c
        for c in corrections
        if c.name not in (*INTRINSICS, *wanted) and abs(c.z) > _SURE_OF_OFFSET
    ]
    notes = [
        f"sag: the outlines show that the arm gives way under its weight, by {_degrees(c)} at the "
        "most loaded joint when it is stretched out. The pose goes with the arm as it hangs: the "
        "tip hangs lower than the recorded joints say."
        for c in sure
        if c.name == SAG
    ]
    zeros = [f"{c.name} {_degrees(c)}" for c in sure if c.name != SAG]
    if zeros:
        notes.append(
            f"joints: the outlines ask for other zeros: {', '.join(zeros)}. The pose goes with "
            "them. Master the joints anew or correct them in the URDF: as long as they are off, "
            "the tip is off by as much, however well the camera is known."
        )
    return tuple(notes)


def _degrees(angle: Strain) -> str:
    return f"{np.degrees(angle.value):+.2f} deg (sigma {np.degrees(angle.sigma):.2f})"


def lens_notes(stated: Camera, refined: Camera, estimate: PoseEstimate) -> tuple[str, ...]:
    """What the user should know about a lens that was refined unasked: nothing, or a sentence.

    Args:
        stated: Intrinsics of the capture.
        refined: Those that the pose goes with.
        estimate: The pose; its outlines say where the lens mattered.
    """
    if stated.is_distorted or not refined.is_distorted:
        return ()
    points = np.concatenate([c.points for c in estimate.contours])
    straight = replace(refined, distortion_model="none", distortion=())
    bends = np.linalg.norm(straight.project(refined.unproject(points)) - points, axis=1)
    k1, k2 = refined.distortion[:2]
    return (
        f"lens: camera_info states no distortion, but the outlines show some: k1 {k1:+.3f}, k2 "
        f"{k2:+.3f}, up to {np.nanmax(bends, initial=0.0):.1f} px where the arm is seen. The pose "
        "goes with it; take this lens into your camera_info (easyhecpp export RESULT camera-info "
        "writes one), or calibrate it.",
    )
