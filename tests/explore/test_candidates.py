"""Joint poses to choose from, and limits that mean nothing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from small_arm import URDF, small_arm

from easyhecpp.errors import InputError
from easyhecpp.explore import draw_candidates
from easyhecpp.explore.candidates import joint_ranges
from easyhecpp.robot import Robot

FINGER = """
  <link name="finger"><visual><geometry><box size="0.01 0.01 0.01"/></geometry></visual></link>
  <joint name="grip" type="prismatic"><parent link="hand"/><child link="finger"/>
    <axis xyz="0 1 0"/><limit lower="0" upper="0.04" effort="1" velocity="1"/></joint>
</robot>"""


def arm(tmp_path: Path, text: str) -> Robot:
    path = tmp_path / "robot.urdf"
    path.write_text(text)
    return Robot.from_urdf(path)


def test_candidates_fill_the_limits_evenly() -> None:
    robot = small_arm()
    q = draw_candidates(robot, 4000, np.random.default_rng(0))
    span = robot.upper - robot.lower
    assert np.all(q > robot.lower)
    assert np.all(q < robot.upper)
    assert np.all(np.abs(q.mean(axis=0) - (robot.lower + robot.upper) / 2) < 0.03 * span)
    assert np.all(np.abs(q.std(axis=0) - span / np.sqrt(12.0)) < 0.03 * span)


def test_turning_joints_keep_to_one_turn(tmp_path: Path) -> None:
    robot = arm(tmp_path, URDF.replace('lower="-2.8" upper="2.8"', 'lower="-6" upper="8"'))
    q = draw_candidates(robot, 500, np.random.default_rng(0))[:, 0]
    assert q.min() > 1.0 - np.pi - 1e-9
    assert q.max() < 1.0 + np.pi + 1e-9
    assert np.ptp(q) > 6.0


def test_near_given_poses() -> None:
    robot = small_arm()
    around = np.array([robot.neutral, robot.neutral + 0.5])
    q = draw_candidates(robot, 40, np.random.default_rng(0), around=around, spread=0.01)
    assert np.abs(q[0::2] - around[0]).max() < 0.3
    assert np.abs(q[1::2] - around[1]).max() < 0.3


def test_a_joint_that_moves_next_to_nothing_is_held(tmp_path: Path) -> None:
    robot = arm(tmp_path, URDF.replace("</robot>", FINGER))
    q = draw_candidates(robot, 50, np.random.default_rng(0))
    assert np.all(q[:, 4] == robot.neutral[4])
    hold = np.array([0.0, 0.0, 0.0, 0.0, 0.013])
    q = draw_candidates(robot, 50, np.random.default_rng(0), around=q, hold=hold)
    assert np.all(q[:, 4] == 0.013)
    assert np.all(np.ptp(q[:, :4], axis=0) > 1.0)


def test_joints_without_limits_are_all_named(tmp_path: Path) -> None:
    text = URDF.replace('lower="-2.8" upper="2.8" ', "").replace(
        'lower="-1.5" upper="1.5"', 'lower="0.3" upper="0.3"'
    )
    with pytest.raises(InputError) as caught:
        joint_ranges(arm(tmp_path, text))
    said = str(caught.value)
    assert "yaw [0, 0], elbow [0.3, 0.3]" in said
    assert "pitch" not in said
    assert "lopsided" in said
    assert "<limit" in said


def test_an_arm_that_cannot_move(tmp_path: Path) -> None:
    text = URDF.replace('type="revolute"', 'type="fixed"')
    with pytest.raises(InputError, match="No joint moves the arm"):
        joint_ranges(arm(tmp_path, text))
