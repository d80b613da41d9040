"""A whole calibration of a capture: masks, first pose, optimisation, verdict, result."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from easyhecpp.capture import Capture
from easyhecpp.capture.decode import check_decodable
from easyhecpp.formats.result_blocks import RefinedParameter, RobotBlock, ViewResult
from easyhecpp.formats.result_file import ResultFile
from easyhecpp.segment.classical.segmenter import FEWEST_VIEWS
from easyhecpp.session.from_images import calibrate_classically, refine_on_edges
from easyhecpp.session.from_masks import calibrate_from_masks
from easyhecpp.session.mask_notes import mask_results, short_mask_notes
from easyhecpp.session.masks import (
    GIVEN,
    ChosenSource,
    PretrainedConfig,
    choose_source,
    inverted,
)
from easyhecpp.session.outcome import Outcome, joint_notes, with_final_views
from easyhecpp.session.refinement import (
    Refined,
    joint_offset_notes,
    lens_notes,
    refine,
    refine_asked,
)
from easyhecpp.session.screening import Screening, restored, screen_for_edges, screen_for_masks
from easyhecpp.session.stages import Progress, Stages
from easyhecpp.session.verdict import Verdict, judge
from easyhecpp.solve import PoseEstimate, SolveConfig
from easyhecpp.solve.consistency import Findings
from easyhecpp.solve.nuisance import read_priors
from easyhecpp.solve.strains import Strain

F64 = NDArray[np.float64]

_UNITS: dict[str, Literal["relative", "px", "coefficient"]] = {
    "focal": "relative",
    "cx": "px",
    "cy": "px",
    "k1": "coefficient",
    "k2": "coefficient",
}


@dataclass(frozen=True)
class CalibrationConfig:
    """Settings of a calibration.

    Attributes:
        segmenter: Where the masks come from: ``auto``, ``given``, ``classical``, or the name of a
            pretrained segmenter.
        first_pose: ``sphere`` searches all around the arm; ``paper`` the paper's grid at 1 m.
        edges: Whether the outline is fitted to the image's own edges after the masks.
        pretrained: Settings of pretrained segmenters, where one of them makes the masks.
        refine: Intrinsics and joint zeros to refine with the pose, see
            `easyhecpp.solve.nuisance.read_priors`; none unless asked for.
        solve: Settings of the pose optimisation.
    """

    segmenter: str = "auto"
    first_pose: Literal["sphere", "paper"] = "sphere"
    edges: bool = True
    pretrained: PretrainedConfig = field(default_factory=PretrainedConfig)
    refine: tuple[str, ...] = ()
    solve: SolveConfig = field(default_factory=SolveConfig)


@dataclass(frozen=True)
class Calibration:
    """What a calibration found.

    Attributes:
        result: Everything that is written to ``result.json``.
        capture: What it was computed from, with refined intrinsics and joints if any were.
        estimate: The optimiser's own account.
        findings: How the views agree.
        masks: The masks used, by view id.
        before_edges: The optimiser's account before the edge stage; None where that was left out.
        notes: What the user should know about how it was done.
    """

    result: ResultFile
    capture: Capture
    estimate: PoseEstimate
    findings: Findings
    masks: dict[str, NDArray[np.generic]]
    before_edges: PoseEstimate | None = None
    notes: tuple[str, ...] = ()

    @property
    def T_mount_cam(self) -> F64:
        """``(4, 4)`` pose of the camera in its mount: the base for eye-to-hand."""
        return self.estimate.T_mount_cam


def calibrate(
    capture: Capture | str | Path,
    config: CalibrationConfig | None = None,
    *,
    progress: Progress | None = None,
    command: str | None = None,
) -> Calibration:
    """Find the camera of a capture.

    Args:
        capture: A capture, or the folder of one.
        config: Settings.
        progress: Told what is being done.
        command: The command line, for the record.

    Raises:
        InputError: The capture cannot be used.
        CalibrationError: The computation could not go on.
    """
    config = config or CalibrationConfig()
    stages = Stages(progress)
    if not isinstance(capture, Capture):
        with stages.stage("load", "reading the capture"):
            capture = Capture.load(capture)
    read_priors(config.refine, capture.robot.joint_names)  # misspelt: say it before any work
    with stages.stage("pictures", "reading the pictures"):
        check_decodable(capture)
    with stages.stage("masks", "choosing where masks come from"):
        chosen = choose_source(config.segmenter, capture, config.pretrained)
    screening = _screening(capture, chosen, config, stages)
    whole = capture
    if chosen.name != GIVEN:
        capture = screening.usable(capture, 1 if chosen.source is not None else FEWEST_VIEWS)
    with screening.explaining():
        if chosen.source is None:
            state = calibrate_classically(capture, stages, config=config.solve, edges=config.edges)
        else:
            outcome = calibrate_from_masks(
                capture, chosen, stages, first_pose=config.first_pose, config=config.solve
            )
            state = Refined(capture, outcome)
        state = refine(state, config.refine, stages, config.solve)
    # The classical way ends with the edges itself, unless its pose was changed since.
    if config.edges and (chosen.source is not None or config.refine):
        state = refine_on_edges(state, stages, config=config.solve, without=screening.unusable)
    if chosen.source is not None and state.outcome.before_edges is None:
        state = refine_asked(state, stages, config.solve)
    capture, outcome = state.capture, state.with_doubt()
    if outcome.before_edges is not None:
        outcome = with_final_views(capture, outcome)
    verdict = judge(
        outcome.estimate,
        outcome.findings,
        capture.rig,
        capture.camera,
        margin=outcome.margin,
        doubts=(*outcome.doubts, *screening.doubts),
    )
    verdict = replace(verdict, reasons=(*verdict.reasons, *screening.sentences))
    notes = (
        f"masks: {chosen.why}",
        *screening.notes,
        *outcome.notes,
        *short_mask_notes(outcome.masks, outcome.quality),
        *joint_notes(outcome.estimate),
        *joint_offset_notes(state.corrections, config.refine),
        *lens_notes(whole.camera, capture.camera, outcome.estimate),
    )
    views = screening.with_left_out(whole, _view_results(outcome))
    result = _result(
        capture, config, chosen, outcome, verdict, notes, views, stages, command,
        state.corrections,
    )  # fmt: skip
    return Calibration(
        result=result,
        capture=restored(whole, capture),
        estimate=outcome.estimate,
        findings=outcome.findings,
        masks={v.view_id: v.mask for v in outcome.masks.views if v.mask is not None},
        before_edges=outcome.before_edges,
        notes=notes,
    )


def _screening(
    capture: Capture, chosen: ChosenSource, config: CalibrationConfig, stages: Stages
) -> Screening:
    """What the pictures, and given masks, are fit for; nothing is said of what is not used."""
    with stages.stage("screening", "looking at the pictures"):
        if chosen.name != GIVEN:
            return screen_for_masks(capture)
        found = screen_for_edges(capture) if config.edges else Screening()
        return replace(found, notes=(*inverted(capture), *found.notes))


def _view_results(outcome: Outcome) -> list[ViewResult]:
    """How each view took part."""
    flags = {v.id: v.flags for v in outcome.findings.views}
    return [
        ViewResult(
            id=v.id,
            weight=v.weight,
            rms_px=v.rms_px,
            iou=min(1.0, v.iou) if np.isfinite(v.iou) else None,
            prediction_px=v.prediction_px,
            flags=tuple(dict.fromkeys((*v.flags, *flags.get(v.id, ())))),
        )
        for v in outcome.estimate.views
    ]


def robot_block(capture: Capture) -> RobotBlock:
    """The arm as the result file names it."""
    return RobotBlock(
        name=capture.robot.name, base_link=capture.robot.base_link, ee_link=capture.ee_link
    )


def _result(
    capture: Capture,
    config: CalibrationConfig,
    chosen: ChosenSource,
    outcome: Outcome,
    verdict: Verdict,
    notes: tuple[str, ...],
    views: Sequence[ViewResult],
    stages: Stages,
    command: str | None,
    corrections: tuple[Strain, ...],
) -> ResultFile:
    estimate = outcome.estimate
    middle = estimate.T_mount_cam @ np.append(estimate.centre_cam, 1.0)
    return ResultFile.build(
        setup=capture.setup,
        robot=robot_block(capture),
        camera=capture.camera,
        verdict=verdict.verdict,
        reasons=verdict.reasons,
        notes=notes,
        T_mount_cam=estimate.T_mount_cam,
        covariance=estimate.covariance,
        workspace_point=middle[:3].tolist(),
        views=views,
        masks=mask_results(outcome.masks, outcome.quality),
        refined=[
            RefinedParameter(
                name=c.name,
                correction=c.value,
                sigma=c.sigma,
                unit=_UNITS.get(c.name, "rad or m"),
            )
            for c in corrections
        ],
        segmenter=chosen.name,
        command=command,
        timings_s={k: round(s, 4) for k, s in stages.timings_s.items()},
        config=config,
    )
