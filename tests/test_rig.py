"""The one model of both set-ups, against kinematics written out a second time from the URDF."""

from __future__ import annotations

import ast
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from easyhecpp.errors import InputError
from easyhecpp.rig import Rig, check_setup, mount_frame, mount_link
from easyhecpp.robot import Robot

SOURCE = Path(__file__).resolve().parents[1] / "src" / "easyhecpp"

URDF = """<robot name="arm">
  <link name="world"/>
  <link name="base"><visual><geometry><box size="0.2 0.2 0.1"/></geometry></visual></link>
  <link name="upper"><visual><geometry><box size="0.1 0.1 0.4"/></geometry></visual></link>
  <link name="slide"><visual><geometry><box size="0.3 0.1 0.1"/></geometry></visual></link>
  <link name="flange"><visual><geometry><box size="0.1 0.1 0.1"/></geometry></visual></link>
  <link name="camera_mount"/>
  <joint name="stand" type="fixed"><parent link="world"/><child link="base"/>
    <origin xyz="1 2 3" rpy="0.1 0.2 0.3"/></joint>
  <joint name="a" type="revolute"><parent link="base"/><child link="upper"/>
    <origin xyz="0 0.1 0.2" rpy="0.4 0 -0.5"/><axis xyz="0 0 1"/>
    <limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
  <joint name="b" type="prismatic"><parent link="upper"/><child link="slide"/>
    <origin xyz="0 0 0.4" rpy="0 0.7 0"/><axis xyz="1 0 0"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <joint name="c" type="revolute"><parent link="slide"/><child link="flange"/>
    <origin xyz="0.3 0 0"/><axis xyz="0 0.6 0.8"/>
    <limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
  <joint name="mount" type="fixed"><parent link="flange"/><child link="camera_mount"/>
    <origin xyz="0.05 -0.02 0.1" rpy="-0.3 0.1 1.2"/></joint>
</robot>"""

BOXES = ("base", "upper", "slide", "flange")


@pytest.fixture(scope="module")
def robot(tmp_path_factory) -> Robot:
    path = tmp_path_factory.mktemp("rig") / "arm.urdf"
    path.write_text(URDF)
    return Robot.from_urdf(path)


def pose_in_world(link: str, q: dict[str, float]) -> np.ndarray:
    """T_world_link, walking up from the link; scipy does the rotations."""
    joints = {j.find("child").get("link"): j for j in ET.fromstring(URDF).findall("joint")}
    T = np.eye(4)
    while link in joints:
        joint = joints[link]
        origin, axis = joint.find("origin"), joint.find("axis")
        step = np.eye(4)
        step[:3, 3] = [float(x) for x in origin.get("xyz").split()]
        rpy = [float(x) for x in origin.get("rpy", "0 0 0").split()]
        step[:3, :3] = Rotation.from_euler("xyz", rpy).as_matrix()
        motion = np.eye(4)
        if axis is not None:
            along = np.array([float(x) for x in axis.get("xyz").split()]) * q[joint.get("name")]
            if joint.get("type") == "prismatic":
                motion[:3, 3] = along
            else:
                motion[:3, :3] = Rotation.from_rotvec(along).as_matrix()
        T = step @ motion @ T
        link = joint.find("parent").get("link")
    return T


def random_pose(rng: np.random.Generator) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3] = Rotation.random(random_state=rng).as_matrix()
    T[:3, 3] = rng.normal(size=3)
    return T


@pytest.mark.parametrize(
    ("setup", "ee_link", "mount"),
    [
        ("eye-to-hand", None, "base"),
        ("eye-in-hand", "camera_mount", "camera_mount"),
        ("eye-in-hand", "slide", "slide"),
        ("eye-in-hand", "flange", "flange"),
    ],
)
def test_links_seen_from_the_camera(robot, setup, ee_link, mount):
    rng = np.random.default_rng(2)
    rig = Rig(robot, setup, ee_link)
    assert rig.mount == mount
    assert robot.link_names == BOXES
    T_mount_cam = random_pose(rng)
    q = rng.uniform(-1, 1, (2, 3, 3))
    Ts_cam_link = rig.Ts_cam_link(T_mount_cam, q)
    Ts_mount_link = rig.Ts_mount_link(q)
    assert Ts_cam_link.shape == Ts_mount_link.shape == (2, 3, 4, 4, 4)
    for index in np.ndindex(2, 3):
        joints = dict(zip("abc", q[index], strict=True))
        T_world_base = pose_in_world("base", joints)
        T_base_mount = np.linalg.solve(T_world_base, pose_in_world(mount, joints))
        for i, link in enumerate(BOXES):
            T_base_link = np.linalg.solve(T_world_base, pose_in_world(link, joints))
            T_mount_link = np.linalg.inv(T_base_mount) @ T_base_link
            np.testing.assert_allclose(Ts_mount_link[index][i], T_mount_link, atol=1e-12)
            expected = np.linalg.inv(T_mount_cam) @ T_mount_link
            np.testing.assert_allclose(Ts_cam_link[index][i], expected, atol=1e-12)


def test_a_camera_on_the_arm_sees_its_own_link_stand_still(robot):
    rig = Rig(robot, "eye-in-hand", "flange")
    q = np.random.default_rng(3).uniform(-1, 1, (5, 3))
    flange = rig.Ts_mount_link(q)[:, BOXES.index("flange")]
    np.testing.assert_allclose(flange, np.broadcast_to(np.eye(4), (5, 4, 4)), atol=1e-12)
    assert np.ptp(rig.Ts_mount_link(q)[:, 0], axis=0).max() > 0.1


def test_a_fixed_camera_sees_the_base_stand_still(robot):
    Ts = Rig(robot).Ts_mount_link(np.random.default_rng(3).uniform(-1, 1, (5, 3)))
    np.testing.assert_allclose(Ts[:, 0], np.broadcast_to(np.eye(4), (5, 4, 4)), atol=1e-12)


def test_the_ee_link_of_a_fixed_camera_is_not_used(robot):
    assert Rig(robot, "eye-to-hand", "flange").mount == "base"


def test_mounts_by_name():
    assert mount_frame("eye-to-hand") == "base"
    assert mount_frame("eye-in-hand") == "ee"
    assert mount_link("eye-to-hand", "base", "flange") == "base"
    assert mount_link("eye-in-hand", "base", "flange") == "flange"
    assert mount_link("eye-in-hand", "base", None) is None


def test_refusals(robot):
    with pytest.raises(InputError, match=r"needs the link it rides on.*camera_mount"):
        Rig(robot, "eye-in-hand")
    with pytest.raises(InputError, match=r"'arm' has no link 'wrist'.*flange, camera_mount"):
        Rig(robot, "eye-in-hand", "wrist")
    with pytest.raises(InputError, match=r"Unknown set-up 'on-hand'.*eye-to-hand or eye-in-hand"):
        Rig(robot, "on-hand")  # type: ignore[arg-type]
    with pytest.raises(InputError):
        check_setup(None)


def asks_for_the_setup(node: ast.AST) -> bool:
    """Whether a comparison or a match has a set-up among its terms."""
    if isinstance(node, ast.Compare):
        terms = [node.left, *node.comparators]
    elif isinstance(node, ast.Match):
        terms = [node.subject, *(case.pattern for case in node.cases)]
    else:
        return False
    for part in (inner for term in terms for inner in ast.walk(term)):
        if isinstance(part, ast.Attribute) and part.attr == "setup":
            return True
        if isinstance(part, ast.Name) and part.id == "setup":
            return True
        if isinstance(part, ast.Constant) and part.value in ("eye-to-hand", "eye-in-hand"):
            return True
    return False


def test_no_other_module_asks_for_the_setup():
    asking = {
        str(path.relative_to(SOURCE))
        for path in SOURCE.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if asks_for_the_setup(node)
    }
    assert asking == {"rig.py"}, "ask Rig for its mount and its poses instead"


@pytest.mark.parametrize(
    "code",
    [
        "if capture.setup == 'eye-in-hand': pass",
        "x = 1 if setup != other else 2",
        "y = kind in ('eye-to-hand', 'board')",
        "match rig.setup:\n    case 'eye-in-hand': pass",
    ],
)
def test_the_search_for_askers_finds_them(code):
    assert any(asks_for_the_setup(node) for node in ast.walk(ast.parse(code)))
