from __future__ import annotations

from importlib import metadata

import numpy as np
import pytest

from easyhecpp.errors import InputError, MissingExtraError
from easyhecpp.sim import robots
from easyhecpp.sim.robots import ROBOTS, load_robot, named_robot, robot_names


@pytest.mark.parametrize("name", ["xarm7", "ur5", "kinova_gen2", "so100"])
def test_named_robots_load_and_their_wrist_link_is_a_frame(name):
    robot = load_robot(name)
    assert robot.n_joints >= 6
    assert robot.n_faces > 1000
    assert named_robot(name).ee_link in robot.frame_names


def test_every_urdf_is_where_the_table_says():
    folder = robots.data_folder() / robots.PACKAGE / "robots"
    assert [entry.urdf for entry in ROBOTS.values() if not (folder / entry.urdf).is_file()] == []


def test_spelling_is_forgiven():
    assert named_robot("XArm 7") is ROBOTS["xarm7"]
    assert named_robot("franka") is ROBOTS["panda"]
    assert named_robot("kinova-gen2") is ROBOTS["kinova_gen2"]


def test_an_unknown_name_lists_all_names():
    with pytest.raises(InputError) as error:
        load_robot("hal9000")
    assert all(name in str(error.value) for name in robot_names())


def test_the_missing_wheel_is_named_with_its_extra(monkeypatch):
    def absent(name: str) -> None:
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr(robots.metadata, "files", absent)
    robots.data_folder.cache_clear()
    try:
        with pytest.raises(MissingExtraError, match=r"easyhecpp\[sim\]"):
            robots.data_folder()
    finally:
        robots.data_folder.cache_clear()


def test_baxter_stands_on_the_floor_below_its_base_frame():
    robot = load_robot("baxter")
    assert robot.base_link == "base"
    poses = robot.link_poses(robot.neutral)
    lowest = min(
        (m.vertices @ T[2, :3] + T[2, 3]).min() for m, T in zip(robot.meshes, poses, strict=True)
    )
    assert -1.2 < lowest < -0.7
    assert np.isfinite(robot.reach)
