"""Which joint poses to take pictures at, for somebody who moves the arm by hand."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from easyhecpp._atomic import write_bytes, write_text
from easyhecpp._paths import is_file, obstacle
from easyhecpp.camera import Camera
from easyhecpp.capture import Capture
from easyhecpp.capture.config import JointUnits
from easyhecpp.capture.folder import FolderContents, read_folder
from easyhecpp.capture.joint_table import VIEW_COLUMN
from easyhecpp.capture.problems import joined_error
from easyhecpp.errors import CalibrationError, InputError
from easyhecpp.explore import (
    CollisionChecker,
    ExploreConfig,
    Knowledge,
    Proposal,
    choose_many,
    first_joint_poses,
)
from easyhecpp.formats.result_file import ResultFile
from easyhecpp.planning import best_checker
from easyhecpp.report.overlay import jpeg
from easyhecpp.report.predicted import draw_from_four_sides, draw_predicted_view
from easyhecpp.rig import Rig, rides_on_arm
from easyhecpp.session.calibration import Calibration, calibrate
from easyhecpp.session.stages import Progress, silent

F64 = NDArray[np.float64]

_QUALITY = 90


@dataclass(frozen=True)
class NextPoses:
    """Joint poses to take pictures at.

    Attributes:
        rig: Robot and set-up.
        camera: Intrinsics.
        T_mount_cam: ``(4, 4)`` the camera as far as it is known; None when nothing is.
        joints: ``(count, n)`` radians and metres.
        ids: Names for the new views that go on where the capture's end.
        proposals: Prediction and reason of each; empty when nothing is known of the camera.
        units: Of the turning joints in the capture's own table.
        notes: What the user should know.
    """

    rig: Rig
    camera: Camera
    T_mount_cam: F64 | None
    joints: F64
    ids: tuple[str, ...]
    proposals: tuple[Proposal, ...]
    units: JointUnits
    notes: tuple[str, ...]


def propose(
    folder: Path,
    config: ExploreConfig,
    count: int,
    seed: int,
    *,
    result: Path | None = None,
    progress: Progress | None = None,
) -> NextPoses:
    """Propose joint poses for a capture, which may have no views yet.

    Args:
        folder: The capture.
        config: How they are chosen.
        count: How many.
        seed: Another seed draws other candidates.
        result: A ``result.json`` of the capture; without it the capture is calibrated.
        progress: Told what is being done.

    Raises:
        InputError: The capture or the result cannot be used, or no joint pose suits.
    """
    if count < 1:
        raise InputError(f"{count} joint poses were asked for", expected="one or more")
    tell = progress or silent
    tell("reading the capture")
    contents = read_folder(folder)
    if contents.robot is None or contents.camera is None:
        # Where there are no views yet, their files may be missing too.
        problems = contents.findings.errors if _has_joints(contents) else contents.rig_errors
        raise joined_error(problems, contents.root)
    rig = Rig(contents.robot, contents.config.setup, contents.config.ee_link)
    checker = best_checker(rig.robot)
    known, notes = _knowledge(contents, rig, result, tell)
    ids = [view.id for view in contents.views]
    rng = np.random.default_rng([seed, len(ids)])
    tell("choosing joint poses")
    proposals: list[Proposal] = []
    if known is None:
        joints = _first(rig, contents.camera, count, rng, checker, config)
        notes += (checker.description,)
        if config.method != ExploreConfig.method:
            notes += (f"--method {config.method} was not used: it needs a camera that is known.",)
    else:
        proposals = choose_many(rig, contents.camera, known, config, count, rng, checker=checker)
        joints = np.stack([p.joints for p in proposals])
        notes += proposals[0].notes
    return NextPoses(
        rig=rig,
        camera=contents.camera,
        T_mount_cam=None if known is None else known.T_mount_cam,
        joints=joints,
        ids=_new_ids(ids, count),
        proposals=tuple(proposals),
        units=contents.config.joint_units,
        notes=notes,
    )


def save_next_poses(found: NextPoses, folder: Path) -> list[Path]:
    """Write ``next_joints.csv`` in the layout of ``joints.csv``, and a picture of each view.

    Raises:
        InputError: The folder cannot be written.
    """
    robot = found.rig.robot
    written: list[Path] = []
    for name, joints in zip(found.ids, found.joints, strict=True):
        if found.T_mount_cam is None:
            picture = draw_from_four_sides(robot, joints)
        else:
            Ts_cam_link = found.rig.Ts_cam_link(found.T_mount_cam, joints)
            picture = draw_predicted_view(robot, found.camera, Ts_cam_link)
        written.append(folder / f"{name}.jpg")
        write_bytes(written[-1], jpeg(picture, _QUALITY))
    in_degrees = np.array([found.units == "deg" and t != "prismatic" for t in robot.joint_types])
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([VIEW_COLUMN, *robot.joint_names])
    for name, joints in zip(found.ids, found.joints, strict=True):
        values = np.where(in_degrees, np.rad2deg(joints), joints)
        writer.writerow([name, *(f"{value:.6f}" for value in values)])
    written.append(folder / "next_joints.csv")
    write_text(written[-1], text.getvalue())
    return written


def _knowledge(
    contents: FolderContents, rig: Rig, result: Path | None, tell: Progress
) -> tuple[Knowledge | None, tuple[str, ...]]:
    """What is known of the camera, and what to say about it."""
    if result is not None:
        return _from_result(contents, rig, result), ()
    if not _has_joints(contents):
        return None, ("There are no views yet: these joint poses tell much from any side.",)
    if contents.views and not any(view.has_image or view.has_mask for view in contents.views):
        return None, ("No view has a picture or a mask: nothing is known of the camera yet.",)
    try:
        found = calibrate(Capture.load(contents.root), progress=tell)
    except CalibrationError as error:
        return None, (f"The views so far could not be calibrated: {error}",)
    if found.result.verdict == "failed":
        return None, ("The calibration of the views so far failed, so they are not built upon.",)
    return what_is_known(found), ()


def what_is_known(found: Calibration) -> Knowledge:
    """What a calibration tells of the camera, view by view."""
    joints = {view.id: view.joints for view in found.capture.views}
    return Knowledge.of(found.estimate, [joints[v.id] for v in found.estimate.views])


def _has_joints(contents: FolderContents) -> bool:
    """Whether there is a table of joints, be it one that cannot be read."""
    table = contents.root / contents.config.joints
    return obstacle(table) is not None or is_file(table)


def _from_result(contents: FolderContents, rig: Rig, path: Path) -> Knowledge:
    result = ResultFile.read(path)
    if result.T_mount_cam is None or result.covariance is None:
        raise InputError(
            "The result holds no pose with a covariance",
            where=path,
            expected="one that is not failed",
        )
    if result.T_mount_cam.parent != rig.mount:
        raise InputError(
            f"The result is about a camera on '{result.T_mount_cam.parent}'",
            where=path,
            expected=f"a result of this capture, whose camera is fixed to '{rig.mount}'",
        )
    used = {view.id for view in result.views}
    joints = [view.joints for view in contents.views if view.id in used]
    return Knowledge(
        result.T_mount_cam.array,
        result.covariance.array,
        np.array(joints).reshape(-1, rig.robot.n_joints),
    )


def _first(
    rig: Rig,
    camera: Camera,
    count: int,
    rng: np.random.Generator,
    checker: CollisionChecker,
    config: ExploreConfig,
) -> F64:
    if rides_on_arm(rig.setup):
        raise InputError(
            "Nothing is known of the camera, and it rides on the arm: joint poses cannot be chosen",
            expected="a first calibration, or its result.json",
            fix="Take pictures in which the camera looks back at the arm's foot, calibrate, and "
            "ask again",
        )
    return first_joint_poses(
        rig.robot, camera, count, rng, checker=checker, floor=config.limits.floor
    )


def _new_ids(ids: list[str], count: int) -> tuple[str, ...]:
    """Names that go on after the capture's own."""
    numbers = [int(name) for name in ids if name.isascii() and name.isdigit()]
    width = max((len(name) for name in ids if name.isascii() and name.isdigit()), default=4)
    start = max(numbers, default=-1) + 1
    return tuple(f"{start + i:0{width}d}" for i in range(count))
