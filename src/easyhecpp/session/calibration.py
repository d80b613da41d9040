"""A whole calibration of a capture: masks, first pose, optimisation, verdict, result."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from easyhecpp.capture import Capture
from easyhecpp.formats.result_blocks import RobotBlock, ViewResult
from easyhecpp.formats.result_file import ResultFile
from easyhecpp.geometry import inverse, log_se3
from easyhecpp.initialise import SamplingConfig, sample_initial_pose
from easyhecpp.segment.protocols import CaptureMasks, PoseBelief
from easyhecpp.session.masks import ChosenSource, choose_source
from easyhecpp.session.stages import Progress, Stages
from easyhecpp.session.verdict import Verdict, judge
from easyhecpp.solve import Observation, PoseEstimate, SolveConfig
from easyhecpp.solve.consistency import Findings, solve_consistent

F64 = NDArray[np.float64]

_MAX_ROUNDS = 3
"""Masks are made anew at the latest pose at most so often."""

_STILL = 0.3
"""Poses that differ by less than this share of their standard deviations count as the same."""


@dataclass(frozen=True)
class CalibrationConfig:
    """Settings of a calibration.

    Attributes:
        segmenter: Where the masks come from: ``auto``, ``given``, ``classical``, or the name of a
            pretrained segmenter.
        first_pose: ``sphere`` searches all around the arm; ``paper`` the paper's grid at 1 m.
        text_weights: Folder or hub name in place of the text model's own weights.
        box_weights: The same for the box model.
        device: Where pretrained models run; None lets them choose.
        solve: Settings of the pose optimisation.
    """

    segmenter: str = "auto"
    first_pose: Literal["sphere", "paper"] = "sphere"
    text_weights: str | None = None
    box_weights: str | None = None
    device: str | None = None
    solve: SolveConfig = field(default_factory=SolveConfig)


@dataclass(frozen=True)
class Calibration:
    """What a calibration found.

    Attributes:
        result: Everything that is written to ``result.json``.
        capture: What it was computed from.
        estimate: The optimiser's own account.
        findings: How the views agree.
        masks: The masks used, by view id.
        notes: What the user should know about how it was done.
    """

    result: ResultFile
    capture: Capture
    estimate: PoseEstimate
    findings: Findings
    masks: dict[str, NDArray[np.generic]]
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
    with stages.stage("masks", "choosing where masks come from"):
        chosen = choose_source(
            config.segmenter,
            capture,
            text_weights=config.text_weights,
            box_weights=config.box_weights,
            device=config.device,
        )
    run = _Run(capture, config, chosen, stages)
    masks = run.first_masks()
    margin, starts = run.first_poses(masks)
    estimate, findings = run.solve(masks, starts)
    for _ in range(_MAX_ROUNDS if chosen.refines else 0):
        before = estimate
        masks = run.masks_at(estimate)
        estimate, findings = run.solve(masks, [estimate.T_mount_cam])
        if _same(before, estimate):
            break
    verdict = judge(estimate, findings, capture.rig, capture.camera, margin=margin)
    return Calibration(
        result=_result(capture, config, chosen, estimate, findings, verdict, stages, command),
        capture=capture,
        estimate=estimate,
        findings=findings,
        masks={v.view_id: v.mask for v in masks.views if v.mask is not None},
        notes=(f"masks: {chosen.why}", *masks.notes),
    )


@dataclass(frozen=True)
class _Run:
    """The stages of one calibration."""

    capture: Capture
    config: CalibrationConfig
    chosen: ChosenSource
    stages: Stages

    def first_masks(self) -> CaptureMasks:
        with self.stages.stage("masks", f"masks: {self.chosen.why}"):
            return self.chosen.source.masks(self.capture, None)

    def masks_at(self, estimate: PoseEstimate) -> CaptureMasks:
        with self.stages.stage("masks", "masks at the latest pose"):
            belief = PoseBelief(estimate.T_mount_cam, estimate.covariance)
            return self.chosen.source.masks(self.capture, belief)

    def first_poses(self, masks: CaptureMasks) -> tuple[float, list[F64]]:
        """Margin of the best basin, and the poses to start from."""
        if masks.belief is not None:
            return 1.0, [masks.belief.T_mount_cam]
        observations = self.observations(masks)
        with self.stages.stage("first pose", f"first pose from {len(observations)} views"):
            first = sample_initial_pose(
                self.capture.rig,
                self.capture.camera,
                observations,
                SamplingConfig(self.config.first_pose),
            )
        return first.margin, [first.T_mount_cam]

    def solve(self, masks: CaptureMasks, starts: Sequence[F64]) -> tuple[PoseEstimate, Findings]:
        with self.stages.stage("solve", "optimising the pose"):
            return solve_consistent(
                self.capture.rig,
                self.capture.camera,
                self.observations(masks),
                starts,
                self.config.solve,
            )

    def observations(self, masks: CaptureMasks) -> list[Observation]:
        joints = {view.id: view.joints for view in self.capture.views}
        return [
            Observation(joints[v.view_id], v.mask, v.ignore, id=v.view_id)
            for v in masks.views
            if v.mask is not None
        ]


def _same(a: PoseEstimate, b: PoseEstimate) -> bool:
    """Whether two estimates differ by much less than they are sure of."""
    step = log_se3(inverse(a.T_mount_cam) @ b.T_mount_cam)
    return bool(step @ np.linalg.solve(b.covariance, step) < 6.0 * _STILL**2)


def _result(
    capture: Capture,
    config: CalibrationConfig,
    chosen: ChosenSource,
    estimate: PoseEstimate,
    findings: Findings,
    verdict: Verdict,
    stages: Stages,
    command: str | None,
) -> ResultFile:
    middle = estimate.T_mount_cam @ np.append(estimate.centre_cam, 1.0)
    flags = {v.id: v.flags for v in findings.views}
    return ResultFile.build(
        setup=capture.setup,
        robot=RobotBlock(
            name=capture.robot.name, base_link=capture.robot.base_link, ee_link=capture.ee_link
        ),
        camera=capture.camera,
        verdict=verdict.verdict,
        reasons=verdict.reasons,
        T_mount_cam=estimate.T_mount_cam,
        covariance=estimate.covariance,
        workspace_point=middle[:3].tolist(),
        views=[
            ViewResult(
                id=v.id,
                weight=v.weight,
                rms_px=v.rms_px,
                iou=min(1.0, v.iou),
                flags=tuple(dict.fromkeys((*v.flags, *flags.get(v.id, ())))),
            )
            for v in estimate.views
        ],
        segmenter=chosen.name,
        command=command,
        timings_s={k: round(s, 4) for k, s in stages.timings_s.items()},
        config=config,
    )
