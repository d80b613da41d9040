"""The published recording's layout, and its keypoint against an independent chain."""

from __future__ import annotations

import os
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from easyhecpp._atomic import write_image
from easyhecpp.bench.baxter_data import (
    arm_to_robot,
    as_capture,
    left_arm,
    read_baxter,
    tip_in_base,
)
from easyhecpp.errors import InputError
from easyhecpp.sim.robots import load_robot

GOOD = {
    f"pose_{i}": {"joints": [0.1 * i] * 7, "ee_2d": [1000.0 + i, 700.0], "ee_3d": [0.1, 0.2, 1.0]}
    for i in (10, 2, 0)
}


def recording(folder: Path, content: Any) -> Path:
    (folder / "ground_truth_data").write_bytes(pickle.dumps(content))
    for i in (10, 2, 0):
        for k in (1, 0):
            write_image(folder / f"pose_{i}" / f"{k}.png", np.zeros((8, 8, 3), np.uint8))
    return folder


def test_poses_come_in_the_order_of_their_numbers(tmp_path: Path):
    content = {name: {k: np.array(v) for k, v in entry.items()} for name, entry in GOOD.items()}
    write_image(tmp_path / "masks" / "pose_2.png", np.zeros((8, 8), bool))
    poses = read_baxter(recording(tmp_path, content))
    assert [pose.name for pose in poses] == ["pose_0", "pose_2", "pose_10"]
    np.testing.assert_allclose(poses[1].joints, 0.2)
    np.testing.assert_allclose(poses[2].ee_px, [1010.0, 700.0])
    assert [len(pose.pictures) for pose in poses] == [2, 2, 2]
    assert [pose.mask is not None for pose in poses] == [False, True, False]
    capture = as_capture(poses, load_robot("baxter"))
    assert capture.view_ids == ("pose_0", "pose_2", "pose_10")
    assert all(name.startswith("left_") for name in capture.robot.link_names)


class Harmful:
    def __reduce__(self) -> tuple[Any, ...]:
        return (os.mkdir, ("harmed",))


def test_a_pickle_that_runs_something_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    recording(tmp_path, {"pose_0": Harmful()})
    with pytest.raises(InputError, match="mkdir, which no table of numbers needs"):
        read_baxter(tmp_path)
    assert not (tmp_path / "harmed").exists()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ({}, "Holds no table"),
        ([1, 2], "Holds no table"),
        ({"pose_0": 3}, "Is no table"),
        ({"pose_0": {"joints": [0.0] * 7, "ee_2d": [1.0, 2.0]}}, "'ee_3d' is missing"),
        ({"pose_0": {**GOOD["pose_0"], "joints": [0.0] * 6}}, "does not hold 7 numbers"),
        ({"pose_7": GOOD["pose_0"]}, "Holds no picture"),
    ],
)
def test_what_is_no_recording(tmp_path: Path, content: Any, words: str):
    with pytest.raises(InputError, match=words):
        read_baxter(recording(tmp_path, content))


def test_no_file_and_no_pickle(tmp_path: Path):
    with pytest.raises(InputError, match="Cannot be read"):
        read_baxter(tmp_path)
    (tmp_path / "ground_truth_data").write_text("hello")
    with pytest.raises(InputError, match="no pickle"):
        read_baxter(tmp_path)


def link(alpha: float, a: float, d: float, theta: float) -> np.ndarray:
    """Craig's Denavit-Hartenberg matrix."""
    (ca, sa), (ct, st) = ((np.cos(x), np.sin(x)) for x in (alpha, theta))
    return np.array(
        [[ct, -st, 0, a], [st * ca, ct * ca, -sa, -d * sa], [st * sa, ct * sa, ca, d * ca],
         [0, 0, 0, 1]]
    )  # fmt: skip


def test_the_keypoint_is_where_the_published_chain_puts_it():
    robot = load_robot("baxter")
    # The published chain begins at the first joint of the arm.
    T_base_arm = robot.frame_pose(arm_to_robot(robot, np.zeros(7)), "left_upper_shoulder")
    quarter = np.pi / 2
    q = np.random.default_rng(0).uniform(-0.8, 0.8, (4, 7))
    for arm in q:
        T = np.eye(4)
        T[2, 3] = 0.27035
        for alpha, a, d, offset, theta in zip(
            (0, -quarter, quarter, -quarter, quarter, -quarter, quarter),
            (0, 0.069, 0, 0.069, 0, 0.010, 0),
            (0, 0, 0.36435, 0, 0.37429, 0, 0),
            (0, quarter, 0, 0, 0, 0, 0),
            arm,
            strict=True,
        ):
            T = T @ link(alpha, a, d, theta + offset)
        expected = (T @ [0, 0, 0.3683, 1])[:3]
        joints = arm_to_robot(robot, arm)
        tip = T_base_arm[:3, :3].T @ (tip_in_base(robot, joints) - T_base_arm[:3, 3])
        # The URDF and the published chain round differently.
        np.testing.assert_allclose(tip, expected, atol=2e-3)


def test_the_rest_of_the_robot_keeps_its_joints():
    robot = load_robot("baxter")
    joints = arm_to_robot(robot, np.arange(7.0))
    named = dict(zip(robot.joint_names, joints, strict=True))
    assert named["left_s0"] == 0.0
    assert named["left_w2"] == 6.0
    assert named["right_s0"] == robot.neutral[robot.joint_names.index("right_s0")]
    assert left_arm(robot).joint_names == robot.joint_names
