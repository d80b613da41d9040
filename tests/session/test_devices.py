"""The simulated cell has the shape that a live calibration expects of devices."""

from __future__ import annotations

import inspect

import numpy as np
import pytest

from easyhecpp.session.devices import Camera, Frame, RobotArm
from easyhecpp.sim import Cell, CellOptions, SimulatedArm, SimulatedCamera


@pytest.fixture(scope="module")
def cell() -> Cell:
    options = CellOptions(
        width=64, height=36, clutter=(0, 0), foreground=0.0, furniture=0, pictures=0, distractor=0.0
    )
    return Cell.random("xarm7", np.random.default_rng(1), options=options)


def test_the_simulated_devices_are_devices(cell: Cell):
    arm = SimulatedArm(cell)
    assert isinstance(arm, RobotArm)
    assert isinstance(SimulatedCamera(cell, arm), Camera)


@pytest.mark.parametrize(
    ("protocol", "device", "methods"),
    [
        (RobotArm, SimulatedArm, ("read_joints", "move_along", "stop")),
        (Camera, SimulatedCamera, ("capture",)),
    ],
)
def test_their_methods_take_the_same_arguments(
    protocol: type, device: type, methods: tuple[str, ...]
):
    for name in methods:
        wanted = inspect.signature(getattr(protocol, name)).parameters
        given = inspect.signature(getattr(device, name)).parameters
        assert list(given) == list(wanted), name


def test_a_session_sees_where_the_arm_is_and_when(cell: Cell):
    pytest.importorskip("mitsuba", reason="the simulated cell takes pictures with mitsuba")
    arm: RobotArm = SimulatedArm(cell)
    camera: Camera = SimulatedCamera(cell, arm)
    first: Frame = camera.capture()
    goal = cell.random_joints(1, np.random.default_rng(0))
    assert arm.move_along(goal, 0.5)
    np.testing.assert_allclose(arm.read_joints(), goal[0])
    second = camera.capture()
    assert second.stamp > first.stamp
    assert second.image.shape == (camera.intrinsics.height, camera.intrinsics.width, 3)
    assert (second.image != first.image).any()


def test_half_a_device_is_none():
    class Half:
        joint_names = ("a",)

        def read_joints(self) -> np.ndarray:
            return np.zeros(1)

    assert not isinstance(Half(), RobotArm)
