"""A small simulated calibration, solved, for the tests of the report."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from small_arm import observe, scene

from easyhecpp.capture import Capture, View
from easyhecpp.formats.result_blocks import RobotBlock, ViewResult
from easyhecpp.formats.result_file import ResultFile
from easyhecpp.rig import Rig
from easyhecpp.solve import PoseEstimate, solve_pose

REASON = "Left out: 0002. Retake them with the arm at rest."


@dataclass(frozen=True)
class Case:
    """What `write_report` takes, and the true pose."""

    result: ResultFile
    capture: Capture
    estimate: PoseEstimate | None
    masks: dict[str, np.ndarray]
    T_base_cam: np.ndarray

    @property
    def arguments(self) -> tuple[Any, ...]:
        return self.result, self.capture, self.estimate, self.masks


@cache
def solved() -> Case:
    """Four views of the small arm, exact masks, pictures of noise with a bright arm."""
    truth = scene(3)
    rng = np.random.default_rng(1)
    views = []
    for i, (q, mask) in enumerate(zip(truth.joints, truth.masks, strict=True)):
        grey = rng.integers(30, 90, mask.shape) + 120 * mask
        views.append(View(f"{i:04d}", q, np.repeat(grey[..., None], 3, 2).astype(np.uint8), mask))
    capture = Capture("small", None, "eye-to-hand", truth.robot, truth.camera, tuple(views))
    observations = [replace(o, id=f"{int(o.id):04d}") for o in observe(truth)]
    estimate = solve_pose(Rig(truth.robot), truth.camera, observations, truth.T_base_cam)
    return Case(
        result=result_of(capture, estimate),
        capture=capture,
        estimate=estimate,
        masks={v.id: v.mask for v in views},
        T_base_cam=truth.T_base_cam,
    )


def result_of(capture: Capture, estimate: PoseEstimate, **changes: Any) -> ResultFile:
    """The result of an estimate; ``changes`` go to `ResultFile.build`."""
    robot = capture.robot
    middle = estimate.T_mount_cam @ np.append(estimate.centre_cam, 1.0)
    return ResultFile.build(
        **{
            "setup": capture.setup,
            "robot": RobotBlock(
                name=robot.name, base_link=robot.base_link, ee_link=capture.ee_link
            ),
            "camera": capture.camera,
            "verdict": "ok",
            "T_mount_cam": estimate.T_mount_cam,
            "covariance": estimate.covariance,
            "workspace_point": middle[:3].tolist(),
            "views": [
                ViewResult(id=v.id, weight=v.weight, rms_px=v.rms_px, iou=v.iou, flags=v.flags)
                for v in estimate.views
            ],
            "segmenter": "given",
            "command": "easyhecpp calibrate small",
            "timings_s": {"masks": 0.1, "first pose": 1.5, "solve": 0.4},
            "config": {"segmenter": "given"},
            **changes,
        }
    )


@cache
def without_pose() -> Case:
    """A calibration that failed before there was a pose."""
    case = solved()
    assert case.estimate is not None
    result = result_of(
        case.capture,
        case.estimate,
        verdict="failed",
        T_mount_cam=None,
        covariance=None,
        views=[],
        reasons=["The masks are empty. Check the folder masks/."],
    )
    return replace(case, result=result, estimate=None)
