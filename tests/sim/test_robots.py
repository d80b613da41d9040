from __future__ import annotations

from importlib import metadata

import numpy as np
import pytest
from small_arm import write_urdf

from easyhecpp.errors import InputError, MissingExtraError
from easyhecpp.sim import robots
from easyhecpp.sim.robots import ROBOTS, end_link, load_robot, named_robot, robot_names


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


def test_the_end_of_an_arm_is_the_link_asked_for_the_known_one_or_the_last_of_the_longest_chain(
    tmp_path,
):
    urdf = str(write_urdf(tmp_path))
    assert end_link("xarm7") == "link7"
    assert end_link(urdf) == "hand"
    assert end_link(urdf, "fore") == "fore"
    with pytest.raises(InputError, match=r"No link is called 'tool'.*base, shoulder, upper"):
        end_link(urdf, "tool")
