"""PCK of the end effector: `easyhecpp bench baxter`, on the published recording or a stand-in.

One camera is calibrated from one, two and three joint poses; the PCK is counted over all pictures.
Without the recording, simulated scenes of the same robot, with the recording's camera and masks at
the paper's IoU, take its place: they show that the whole path works, and are no substitute for it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from easyhecpp.bench.baxter_data import (
    ARM_JOINTS,
    CAMERA,
    BaxterPose,
    arm_to_robot,
    as_capture,
    left_arm,
    read_baxter,
    tip_in_base,
)
from easyhecpp.bench.pck import KeypointErrors
from easyhecpp.bench.plots import curves_plot
from easyhecpp.bench.published import PCK_2D, PCK_2D_PX, PCK_3D, PCK_3D_CM
from easyhecpp.bench.scenes_pool import SCENE_FAILURES, in_order
from easyhecpp.bench.table import Cell, Table, describe_machine, machine_sentence
from easyhecpp.errors import CalibrationError, InputError
from easyhecpp.geometry import inverse, look_at, transform_points
from easyhecpp.initialise import sample_initial_pose
from easyhecpp.rig import Rig
from easyhecpp.robot import Robot
from easyhecpp.session import CalibrationConfig, calibrate
from easyhecpp.session.masks import GIVEN, GivenMasks, check_segmenter
from easyhecpp.sim.masks import Degradation, degrade_masks
from easyhecpp.sim.robots import load_robot
from easyhecpp.sim.scenes import SimScene
from easyhecpp.solve import Observation, solve_pose

F64 = NDArray[np.float64]

VIEWS = (1, 2, 3)
POSES = 20


@dataclass(frozen=True)
class BaxterBench:
    """Errors of the keypoint.

    Attributes:
        origin: What was measured, a sentence.
        views: By number of views: the errors of all pictures.
        notes: What went wrong, and how it was done.
    """

    origin: str
    views: dict[int, KeypointErrors]
    notes: tuple[str, ...] = ()


def run_baxter_recording(folder: Path, segmenter: str = "auto") -> BaxterBench:
    """Calibrate from the recording's first joint poses, and measure on all of its pictures.

    Args:
        folder: The recording, see `baxter_data`.
        segmenter: Where masks come from, see `CalibrationConfig`.

    Raises:
        InputError: The folder is not the recording, or the segmenter is unknown or lacks masks.
            Too few views for the segmenter are a note, and every picture counts as missed.
        MissingExtraError: The robot's data, or the segmenter's packages, are not installed.
    """
    poses = read_baxter(folder)
    robot = load_robot("baxter")
    check_segmenter(segmenter)
    if segmenter == GIVEN:
        GivenMasks().masks(as_capture(poses[: max(VIEWS)], robot))
    found: dict[int, KeypointErrors] = {}
    notes: list[str] = []
    for count in VIEWS:
        capture = as_capture(poses[:count], robot)
        try:
            T_base_cam = calibrate(capture, CalibrationConfig(segmenter=segmenter)).T_mount_cam
            found[count] = KeypointErrors.joined(
                [_recorded_errors(robot, pose, T_base_cam) for pose in poses]
            )
        except (CalibrationError, InputError) as error:
            notes.append(f"{count} view{'s'[: count > 1]}: {error}")
            found[count] = KeypointErrors.missing(sum(len(pose.pictures) for pose in poses))
    pictures = sum(len(pose.pictures) for pose in poses)
    origin = f"the published recording, {len(poses)} joint poses, {pictures} pictures"
    return BaxterBench(origin, found, (*notes, f"Masks: {segmenter}."))


def run_baxter_stand_in(
    *,
    scenes: int,
    seed: int,
    size: tuple[int, int] = (1024, 768),
    workers: int = 1,
    progress: Callable[[int], None] | None = None,
) -> BaxterBench:
    """The same with simulated scenes of 20 joint poses each.

    Args:
        scenes: Number of camera poses.
        seed: Scene k depends on it and on k alone.
        size: Of the masks; pixels are counted at the recording's full size all the same.
        workers: Processes side by side.
        progress: Called with the number of finished scenes.

    Raises:
        InputError: No scenes.
        MissingExtraError: The robot's data are not installed.
    """
    if scenes < 1:
        raise InputError(f"scenes is {scenes}", expected="1 or more")
    load_robot("baxter")
    rows: list[dict[int, KeypointErrors]] = []
    for row in in_order(partial(_stand_in_scene, seed, size), range(scenes), workers):
        rows.append(row)
        if progress is not None:
            progress(len(rows))
    return BaxterBench(
        f"a simulated stand-in, {scenes} scenes of {POSES} joint poses, seed {seed}",
        {count: KeypointErrors.joined([row[count] for row in rows]) for count in VIEWS},
        (
            f"Masks of {size[0]}x{size[1]} at an IoU of 0.982, random joint poses; truth is exact. "
            "The published rows are on real pictures, whose own measured keypoints are off by some "
            "ten pixels and centimetres: the two are not to be compared number by number.",
        ),
    )


def baxter_table(bench: BaxterBench) -> Table:
    """Ours beside the published rows, in pixels and centimetres."""
    lines: list[tuple[Cell, ...]] = [
        (
            f"ours, {count} view{'s'[: count > 1]}",
            *errors.pck_2d(PCK_2D_PX),
            errors.auc_2d,
            *errors.pck_3d(PCK_3D_CM),
            errors.auc_3d,
        )
        for count, errors in bench.views.items()
    ]
    lines += [(f"published {name}", *PCK_2D[name], None, *PCK_3D[name], None) for name in PCK_2D]
    return Table(
        title=f"Baxter's end effector: {bench.origin}",
        columns=(
            "method",
            *(f"{t} px" for t in PCK_2D_PX),
            "AUC 2D",
            *(f"{t} cm" for t in PCK_3D_CM),
            "AUC 3D",
        ),
        rows=tuple(lines),
        notes=(
            "Share of pictures in which the end effector is found within the threshold, pixels at "
            "full resolution; AUC: mean over 0-199 px and 0-399 mm.",
            *bench.notes,
            machine_sentence(describe_machine()),
        ),
    )


def baxter_plot(bench: BaxterBench) -> Figure:
    """PCK over the thresholds."""
    panels = {}
    for label, own, thresholds, published in (
        ("PCK, px", "pck_2d", PCK_2D_PX, PCK_2D),
        ("PCK, cm", "pck_3d", PCK_3D_CM, PCK_3D),
    ):
        curves = {
            f"ours, {count} views": dict(
                zip(map(float, thresholds), getattr(errors, own)(thresholds), strict=True)
            )
            for count, errors in bench.views.items()
        }
        for name in ("EasyHeC++, 3 views", "EasyHeC, 3 views"):
            values = published[name]
            curves[f"published {name}"] = dict(zip(map(float, thresholds), values, strict=True))
        panels[label] = curves
    return curves_plot(panels, title=bench.origin, label="threshold", log=False)


def _recorded_errors(robot: Robot, pose: BaxterPose, T_base_cam: F64) -> KeypointErrors:
    """One error per picture: all pictures of a joint pose have the same keypoint."""
    tip = tip_in_base(robot, arm_to_robot(robot, pose.joints))
    point = transform_points(inverse(T_base_cam), tip)
    return KeypointErrors.between(
        CAMERA,
        np.tile(point, (len(pose.pictures), 1)),
        np.tile(pose.ee_px, (len(pose.pictures), 1)),
        np.tile(pose.ee_cam, (len(pose.pictures), 1)),
    )


def _stand_in_scene(seed: int, size: tuple[int, int], scene: int) -> dict[int, KeypointErrors]:
    robot = load_robot("baxter")
    rng = np.random.default_rng([seed, scene])
    T_base_cam, joints = _stand_in(robot, rng)
    camera = CAMERA.scaled(size[0] / CAMERA.width)
    camera = replace(camera, width=size[0], height=size[1])
    rig = Rig(left_arm(robot))
    sim = SimScene(rig.robot, camera, T_base_cam, joints[: max(VIEWS)], supersample=3)
    masks = degrade_masks(list(sim.coverages), rng, Degradation()).masks
    tips = tip_in_base(robot, joints)
    truth_cam = transform_points(inverse(T_base_cam), tips)
    found = {}
    for count in VIEWS:
        seen = [
            Observation(q, m, id=str(i))
            for i, (q, m) in enumerate(zip(joints[:count], masks[:count], strict=True))
        ]
        try:
            first = sample_initial_pose(rig, camera, seen)
            T = solve_pose(rig, camera, seen, first.T_mount_cam).T_mount_cam
        except SCENE_FAILURES:
            found[count] = KeypointErrors.missing(len(joints))
            continue
        points = transform_points(inverse(T), tips)
        found[count] = KeypointErrors.between(CAMERA, points, CAMERA.project(truth_cam), truth_cam)
    return found


def _stand_in(robot: Robot, rng: np.random.Generator) -> tuple[F64, F64]:
    """A camera (4, 4) before the robot's left arm, and poses (20, n) in which it sees the tip."""
    which = [robot.joint_names.index(name) for name in ARM_JOINTS]
    low, high = robot.lower[which], robot.upper[which]
    wanted: list[F64] = []
    while True:
        eye = np.array([rng.uniform(1.6, 2.1), rng.uniform(-0.4, 0.8), rng.uniform(0.2, 0.9)])
        target = np.array([0.5, 0.5, 0.25]) + rng.normal(0.0, 0.05, 3)
        T_base_cam = look_at(eye, target)
        drawn = arm_to_robot(robot, rng.uniform(low, high, (400, len(which))))
        tips = transform_points(inverse(T_base_cam), tip_in_base(robot, drawn))
        px = CAMERA.project(tips)
        inside = (tips[:, 2] > 0.4) & (px > 100).all(axis=1)
        inside &= (px < np.array([CAMERA.width, CAMERA.height]) - 100).all(axis=1)
        wanted = list(drawn[inside][:POSES])
        if len(wanted) == POSES:
            return T_base_cam, np.array(wanted)
