from __future__ import annotations

import threading
from types import SimpleNamespace

import numpy as np
import pytest

from easyhecpp.errors import InputError
from easyhecpp.geometry import make_transform
from easyhecpp.sim.cell import Cell
from easyhecpp.sim.devices import SimulatedArm, SimulatedCamera
from easyhecpp.sim.options import CellOptions
from easyhecpp.sim.studio import Quality


@pytest.fixture(scope="module")
def cell() -> Cell:
    options = CellOptions(width=96, height=54, distractor=0.0)
    return Cell.random("xarm7", np.random.default_rng(1), options=options)


def test_the_arm_says_what_it_is(cell):
    arm = SimulatedArm(cell)
    lower, upper = arm.limits
    assert arm.joint_names == cell.robot.joint_names
    assert np.array_equal(lower, cell.robot.lower)
    assert np.array_equal(upper, cell.robot.upper)
    assert np.array_equal(arm.read_joints(), cell.robot.neutral)


def test_moving_ends_at_the_last_waypoint_and_takes_as_long_as_the_speed_says(cell):
    arm = SimulatedArm(cell, np.zeros(7))
    path = np.array([[0.0] * 7, [0.6, 0, 0, 0, 0, 0, 0], [0.6, -0.3, 0, 0.9, 0, 0, 0]])
    assert arm.move_along(path, speed=0.5)
    assert arm.read_joints() == pytest.approx(path[-1])
    assert arm.clock == pytest.approx((0.6 + 0.9) / 0.5)


@pytest.mark.parametrize(
    ("path", "speed", "words"),
    [
        (np.zeros((2, 6)), 1.0, "(2, 6)"),
        (np.full((1, 7), np.nan), 1.0, "not a number"),
        ([[0, 0, 0, 0, 0, 0, 0], [0, 9.0, 0, 0, 0, 0, 0]], 1.0, "Waypoint 1 puts joint2 at 9.0000"),
        (np.zeros((1, 7)), 0.0, "speed is 0.0"),
    ],
)
def test_what_the_arm_cannot_do_is_refused_before_it_moves(cell, path, speed, words):
    arm = SimulatedArm(cell, np.full(7, 0.1))
    with pytest.raises(InputError) as error:
        arm.move_along(path, speed)
    assert words in str(error.value)
    assert np.array_equal(arm.read_joints(), np.full(7, 0.1))


def test_stop_stops_on_the_way(cell):
    arm = SimulatedArm(cell, np.zeros(7), pace=1.0)
    stopper = threading.Timer(0.15, arm.stop)
    stopper.start()
    target = np.array([[2.0, 0, 0, 0, 0, 0, 0]])
    reached = arm.move_along(target, speed=0.5)
    stopper.join()
    assert not reached
    assert 0.0 < arm.read_joints()[0] < 2.0
    arm.stop()
    assert SimulatedArm(cell, np.zeros(7)).move_along(target, speed=10.0)


def test_a_read_pose_is_a_copy(cell):
    arm = SimulatedArm(cell)
    arm.read_joints()[:] = 3.0
    assert np.array_equal(arm.read_joints(), cell.robot.neutral)


def test_the_camera_sees_the_arm_where_it_is_and_stamps_the_picture(cell):
    pytest.importorskip("mitsuba", reason="path-traced pictures need the extra sim")
    arm = SimulatedArm(cell, np.zeros(7))
    camera = SimulatedCamera(cell, arm, quality=Quality(samples=2, depth=1))
    assert camera.intrinsics is cell.camera
    before = camera.capture()
    arm.move_along([[0.8, -0.4, 0, 0.8, 0, 0, 0]], speed=1.0)
    after = camera.capture()
    assert before.stamp == 0.0
    assert after.stamp == pytest.approx(0.8)
    assert after.image.shape == (54, 96, 3)
    masks = [cell.truth(q).mask for q in (np.zeros(7), arm.read_joints())]
    moved = masks[0] != masks[1]
    change = np.abs(after.image.astype(int) - before.image).mean(axis=-1)
    assert change[moved].mean() > 3 * change[~(masks[0] | masks[1])].mean()


def test_the_stamp_is_that_of_the_pose_in_the_picture_while_the_arm_moves_on(cell, monkeypatch):
    arm = SimulatedArm(cell, np.zeros(7))
    camera = SimulatedCamera(cell, arm)
    shown: list[float] = []

    def slow(self: Cell, joints: np.ndarray, **_: object) -> list[SimpleNamespace]:
        shown.append(joints[0])
        arm.move_along([[joints[0] + 0.25, 0, 0, 0, 0, 0, 0]], speed=0.5)
        return [SimpleNamespace(image=np.zeros((54, 96, 3), np.uint8))]

    monkeypatch.setattr(Cell, "capture", slow)
    frames = [camera.capture() for _ in range(3)]
    assert shown == pytest.approx([0.0, 0.25, 0.5])
    assert [frame.stamp for frame in frames] == pytest.approx([0.0, 0.5, 1.0])


def test_a_knocked_camera_stays_where_it_was_knocked_to(cell):
    camera = SimulatedCamera(cell, SimulatedArm(cell))
    T = cell.T_mount_cam @ make_transform(np.eye(3), np.array([0.02, 0.0, 0.0]))
    camera.knock(T)
    assert np.array_equal(camera.cell.T_mount_cam, T)
    assert not np.array_equal(cell.T_mount_cam, T)
