"""A whole calibration of a capture: masks, first pose, optimisation, verdict, result."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from easyhecpp.capture import Capture
from easyhecpp.errors import InputError
from easyhecpp.formats.result_blocks import RobotBlock, ViewResult
from easyhecpp.formats.result_file import ResultFile
from easyhecpp.initialise import InitialPose, SamplingConfig, sample_initial_pose
from easyhecpp.session.stages import Progress, Stages
from easyhecpp.solve import Observation, PoseEstimate, SolveConfig, solve_pose

F64 = NDArray[np.float64]


@dataclass(frozen=True)
class CalibrationConfig:
    """Settings of a calibration.

    Attributes:
        segmenter: Where the masks come from.
        first_pose: ``sphere`` searches all around the arm; ``paper`` the paper's grid at 1 m.
        solve: Settings of the pose optimisation.
    """

    segmenter: str = "auto"
    first_pose: Literal["sphere", "paper"] = "sphere"
    solve: SolveConfig = field(default_factory=SolveConfig)


@dataclass(frozen=True)
class Calibration:
    """What a calibration found.

    Attributes:
        result: Everything that is written to ``result.json``.
        capture: What it was computed from.
        estimate: The optimiser's own account.
        masks: The masks used, by view id.
    """

    result: ResultFile
    capture: Capture
    estimate: PoseEstimate
    masks: dict[str, NDArray[np.bool_]]

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
    with stages.stage("masks", "reading the masks"):
        observations = _given_masks(capture)
    rig = capture.rig
    with stages.stage("first pose", f"first pose from {len(observations)} views"):
        first = sample_initial_pose(
            rig, capture.camera, observations, SamplingConfig(config.first_pose)
        )
    with stages.stage("solve", "optimising the pose"):
        estimate = solve_pose(rig, capture.camera, observations, first.T_mount_cam, config.solve)
    return Calibration(
        result=_result(capture, config, first, estimate, stages, command),
        capture=capture,
        estimate=estimate,
        masks={o.id: np.asarray(o.mask, bool) for o in observations},
    )


def _given_masks(capture: Capture) -> list[Observation]:
    views = [v for v in capture.views if v.has_mask]
    if not views:
        raise InputError(
            "The capture holds no masks",
            where=capture.name,
            expected="a folder masks/ with one picture per view",
            fix="choose another segmenter",
        )
    observations = []
    for view in views:
        mask = view.mask
        assert mask is not None
        observations.append(Observation(view.joints, mask, id=view.id))
    return observations


def _result(
    capture: Capture,
    config: CalibrationConfig,
    first: InitialPose,
    estimate: PoseEstimate,
    stages: Stages,
    command: str | None,
) -> ResultFile:
    rig = capture.rig
    middle = estimate.T_mount_cam @ np.append(estimate.centre_cam, 1.0)
    return ResultFile.build(
        setup=capture.setup,
        robot=RobotBlock(
            name=capture.robot.name, base_link=capture.robot.base_link, ee_link=capture.ee_link
        ),
        camera=capture.camera,
        verdict="ok",
        T_mount_cam=estimate.T_mount_cam,
        covariance=estimate.covariance,
        workspace_point=middle[:3].tolist(),
        views=[
            ViewResult(id=v.id, weight=v.weight, rms_px=v.rms_px, iou=v.iou, flags=v.flags)
            for v in estimate.views
        ],
        segmenter="given",
        command=command,
        timings_s={k: round(s, 4) for k, s in stages.timings_s.items()},
        config=config,
    )
