"""The published Baxter recording (Lu et al.) as captures and measured keypoints.

As it is distributed::

    FOLDER/ground_truth_data        a pickle: {"pose_0": {"joints", "ee_2d", "ee_3d"}, ...}
    FOLDER/pose_0/*.png             the pictures of each joint pose; pose_1, ...
    FOLDER/masks/pose_0.png         optional: a mask of the arm in the first picture of each pose

A pickle may run any program when it is opened. This one is opened by a reader that builds plain
containers and numpy arrays and refuses anything else.
"""

from __future__ import annotations

import io
import pickle
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from easyhecpp.camera import Camera
from easyhecpp.capture import Capture, View
from easyhecpp.errors import InputError
from easyhecpp.robot import Robot

F64 = NDArray[np.float64]

ARM_JOINTS = ("left_s0", "left_s1", "left_e0", "left_e1", "left_w0", "left_w1", "left_w2")
"""In the recording's order."""

TIP_FROM_WRIST = 0.3683
"""The keypoint lies on the axis of the last joint, so many metres from the wrist's centre."""

CAMERA = Camera(2048, 1536, 960.41357421875, 960.22314453125, 1021.7171020507812, 776.2381591796875)
"""The recording's camera; its distortion is not used by the published evaluation."""

_GROUND_TRUTH = "ground_truth_data"
_ALLOWED = {
    ("numpy", "ndarray"),
    ("numpy", "dtype"),
    ("numpy.core.multiarray", "_reconstruct"),
    ("numpy.core.multiarray", "scalar"),
    ("numpy._core.multiarray", "_reconstruct"),
    ("numpy._core.multiarray", "scalar"),
    ("_codecs", "encode"),
}


@dataclass(frozen=True)
class BaxterPose:
    """One joint pose of the recording.

    Attributes:
        name: ``pose_0``, ...
        joints: (7,) of the left arm.
        ee_px: (2,) the end effector in the picture.
        ee_cam: (3,) the end effector in the camera's frame, metres.
        pictures: Files.
        mask: File, None without one.
    """

    name: str
    joints: F64
    ee_px: F64
    ee_cam: F64
    pictures: tuple[Path, ...]
    mask: Path | None = None


def read_baxter(folder: Path) -> list[BaxterPose]:
    """Read the recording, poses in the order of their numbers.

    Raises:
        InputError: The folder is not laid out like that, or the file holds anything unexpected.
    """
    path = folder / _GROUND_TRUTH
    content = _plain_pickle(path)
    if not isinstance(content, Mapping) or not content:
        raise _refused(path, "Holds no table of joint poses")
    names = sorted((str(name) for name in content), key=_number)
    return [_pose(folder, name, content[name]) for name in names]


def tip_in_base(robot: Robot, joints: F64) -> F64:
    """The keypoint (..., 3) in the base frame at joint values (..., n)."""
    # The frames of the last two joints: the wrist's centre, and the axis through the hand.
    wrist = robot.frame_pose(joints, "left_lower_forearm")[..., :3, 3]
    axis = robot.frame_pose(joints, "left_wrist")[..., :3, 2]
    return wrist + TIP_FROM_WRIST * axis


def arm_to_robot(robot: Robot, arm_joints: F64) -> F64:
    """Joint values (..., n) of the whole robot from those of the left arm (..., 7)."""
    arm_joints = np.asarray(arm_joints, np.float64)
    joints = np.broadcast_to(robot.neutral, (*arm_joints.shape[:-1], robot.n_joints)).copy()
    joints[..., [robot.joint_names.index(name) for name in ARM_JOINTS]] = arm_joints
    return joints


def as_capture(poses: list[BaxterPose], robot: Robot) -> Capture:
    """A capture of the first picture of each pose; the other arm and the head are left out.

    Only the left arm's joints were recorded: where the rest of the robot was is not known.
    """
    views = tuple(
        View(pose.name, arm_to_robot(robot, pose.joints), image=pose.pictures[0], mask=pose.mask)
        for pose in poses
    )
    return Capture("baxter", None, "eye-to-hand", left_arm(robot), CAMERA, views)


def left_arm(robot: Robot) -> Robot:
    """The robot with only the left arm's geometry."""
    return robot.without_links([name for name in robot.link_names if not name.startswith("left_")])


def _pose(folder: Path, name: str, entry: Any) -> BaxterPose:
    where = f"{folder / _GROUND_TRUTH}, {name}"
    if not isinstance(entry, Mapping):
        raise _refused(where, "Is no table")
    values = {}
    for key, size in (("joints", 7), ("ee_2d", 2), ("ee_3d", 3)):
        try:
            value = np.asarray(entry[key], np.float64).ravel()
        except (KeyError, TypeError, ValueError) as error:
            raise _refused(where, f"{key!r} is missing or holds no numbers") from error
        if value.shape != (size,) or not np.isfinite(value).all():
            raise _refused(where, f"{key!r} does not hold {size} numbers")
        values[key] = value
    pictures = tuple(sorted((folder / name).glob("*.png")))
    if not pictures:
        raise _refused(folder / name, "Holds no picture")
    mask = folder / "masks" / f"{name}.png"
    return BaxterPose(
        name, values["joints"], values["ee_2d"], values["ee_3d"], pictures,
        mask if mask.exists() else None,
    )  # fmt: skip


def _number(name: str) -> int:
    found = re.search(r"(\d+)$", name)
    return int(found[1]) if found else -1


def _plain_pickle(path: Path) -> Any:
    try:
        data = path.read_bytes()
    except OSError as error:
        raise _refused(path, "Cannot be read") from error
    try:
        return _PlainUnpickler(io.BytesIO(data)).load()
    except InputError:
        raise
    except Exception as error:
        raise _refused(path, f"Is no pickle of plain numbers ({error})") from error


class _PlainUnpickler(pickle.Unpickler):
    """Builds containers, numbers and numpy arrays, and nothing else."""

    def find_class(self, module: str, name: str) -> Any:
        """Refuse every class and function that arrays do not need."""
        if (module, name) not in _ALLOWED:
            raise InputError(
                f"The pickle asks for {module}.{name}, which no table of numbers needs",
                where=_GROUND_TRUTH,
                fix="Do not open this file with anything else; get it again from its authors",
            )
        return super().find_class(module, name)


def _refused(where: object, what: str) -> InputError:
    return InputError(
        what,
        where=where,
        expected="the published recording: ground_truth_data and pose_0/*.png, pose_1/*.png, ...",
        fix="docs/benchmarks.md says where it is found and how to place it",
    )
