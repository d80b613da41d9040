"""What a robot knows about itself, and that nothing about it can be changed."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from easyhecpp.errors import InputError
from easyhecpp.robot import Robot

from .urdf_text import BOX, joint

Write = Callable[[str], Path]


@pytest.fixture(scope="module")
def xarm(robots_folder: Path) -> Robot:
    return Robot.from_urdf(robots_folder / "xarm_description/urdf/xarm7.urdf")


def test_nothing_can_be_changed(xarm: Robot) -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        xarm.name = "other"  # type: ignore[misc]
    for array in (xarm.lower, xarm.upper, xarm.neutral, xarm.tree.axes, xarm.tree.Ts_parent_joint):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
    assert isinstance(xarm.meshes, tuple)
    poses = xarm.link_poses(xarm.neutral)
    poses[:] = 0
    assert xarm.link_poses(xarm.neutral).any()


def test_neutral_is_the_middle_of_the_range_within_a_turn(write_urdf: Write) -> None:
    limits = {"j1": (-6.3, 6.3), "j2": (-3.0, -1.0), "j3": (0.0, 6.0), "j4": (4.0, 6.0)}
    body = '<link name="l0"/>' + "".join(f'<link name="l{i}">{BOX}</link>' for i in range(1, 7))
    for i, (name, (lower, upper)) in enumerate(limits.items()):
        inside = f'<limit lower="{lower}" upper="{upper}"/>'
        body += joint(name, f"l{i}", f"l{i + 1}", inside=inside)
    body += joint("j5", "l4", "l5", "prismatic", '<limit lower="0" upper="9"/>')
    body += joint("j6", "l5", "l6", "continuous")
    robot = Robot.from_urdf(write_urdf(body))
    np.testing.assert_allclose(robot.neutral, [0, -2, np.pi / 2, 5, 4.5, 0])
    assert (robot.lower <= robot.neutral).all()
    assert (robot.neutral <= robot.upper).all()


def test_reach_of_a_two_link_arm_is_its_length(write_urdf: Write) -> None:
    stick = '<visual><origin xyz="0.5 0 0"/><geometry><box size="1 0.02 0.02"/></geometry></visual>'
    body = f'<link name="a">{BOX}</link><link name="b">{stick}</link><link name="c">{stick}</link>'
    body += joint("j", "a", "b", inside='<axis xyz="0 0 1"/><limit lower="-3" upper="3"/>')
    bent = '<axis xyz="0 0 1"/><origin xyz="1 0 0"/><limit lower="-3" upper="3"/>'
    robot = Robot.from_urdf(write_urdf(body + joint("k", "b", "c", inside=bent)))
    assert robot.reach == pytest.approx(2.0, abs=2e-3)
    assert (
        robot.reach == Robot.from_urdf(write_urdf(body + joint("k", "b", "c", inside=bent))).reach
    )


def test_reach_is_not_beaten_by_random_poses(xarm: Robot) -> None:
    q = np.random.default_rng(5).uniform(xarm.lower, xarm.upper, size=(400, 7))
    poses = xarm.link_poses(q)
    for k, mesh in enumerate(xarm.meshes):
        vertices = mesh.vertices[::17]
        points = poses[:, k, None, :3, :3] @ vertices[..., None]
        distances = np.linalg.norm(points[..., 0] + poses[:, k, None, :3, 3], axis=-1)
        assert distances.max() <= xarm.reach


def test_centre_is_the_centroid_of_all_surfaces(write_urdf: Write) -> None:
    big = '<visual><geometry><box size="2 2 2"/></geometry></visual>'
    body = f'<link name="a">{BOX}</link><link name="b">{big}</link>'
    path = write_urdf(body + joint("j", "a", "b", "prismatic", '<origin xyz="0 0 5"/>'))
    # Areas 6 and 24: four fifths of the way to the second box.
    np.testing.assert_allclose(Robot.from_urdf(path).centre([0.5]), [0.4, 0, 4.0], atol=1e-12)


def test_links_can_be_left_out(xarm: Robot) -> None:
    fewer = xarm.without_links(["link7", "world"])
    assert fewer.link_names == xarm.link_names[:-1]
    assert fewer.joint_names == xarm.joint_names
    assert fewer.n_faces == xarm.n_faces - len(xarm.meshes[-1].faces)
    q = xarm.neutral
    np.testing.assert_allclose(fewer.link_poses(q), xarm.link_poses(q)[:-1], atol=1e-15)
    assert fewer.base_link == "link_base"
    with pytest.raises(InputError, match=r"No link is called 'gripper'.*link_base, link1"):
        xarm.without_links(["gripper"])
    with pytest.raises(InputError, match="No link with geometry is left"):
        xarm.without_links(xarm.link_names)


def test_a_robot_without_joints(write_urdf: Write) -> None:
    robot = Robot.from_urdf(write_urdf(f'<link name="a">{BOX}</link>'))
    assert robot.n_joints == 0
    assert robot.link_poses(np.zeros((5, 0))).shape == (5, 1, 4, 4)
    assert robot.reach == pytest.approx(np.sqrt(3) / 2)


def test_parents_skip_links_without_geometry(write_urdf: Write) -> None:
    body = f'<link name="a">{BOX}</link><link name="b"/><link name="c">{BOX}</link>'
    body += f'<link name="d">{BOX}</link>'
    body += joint("j", "a", "b") + joint("k", "b", "c", "fixed") + joint("l", "a", "d")
    assert Robot.from_urdf(write_urdf(body)).link_parents == (-1, 0, 0)
