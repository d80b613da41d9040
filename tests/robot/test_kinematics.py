"""Forward kinematics against pinocchio, and against poses known by hand."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from easyhecpp.errors import InputError
from easyhecpp.robot import Robot

from .urdf_text import BOX, joint

pinocchio = pytest.importorskip("pinocchio", reason="pinocchio is the independent truth here")
pytestmark = pytest.mark.filterwarnings("ignore:the matrix subclass:PendingDeprecationWarning")

ROBOTS = {
    "xarm7": ("xarm_description/urdf/xarm7.urdf", "link_base", 7),
    "panda": ("panda_description/urdf/panda.urdf", "panda_link0", 8),
    "ur5": ("ur_description/urdf/ur5_robot.urdf", "base_link", 6),
    "baxter": ("baxter_description/urdf/baxter.urdf", "torso", 17),
    "so100": ("so_arm_description/urdf/so100.urdf", "base", 6),
    "kinova": ("kinova_description/robots/kinova.urdf", "j2s6s200_link_base", 6),
}


def pinocchio_poses(path: Path, robot: Robot, q: np.ndarray) -> dict[str, np.ndarray]:
    """T_base_frame of every link by pinocchio, mimic joints included."""
    model = pinocchio.buildModelFromUrdf(str(path), True)
    data = model.createData()
    configuration = pinocchio.neutral(model)
    for name, value in zip(robot.joint_names, q, strict=True):
        moving = model.joints[model.getJointId(name)]
        if moving.nq == 2:  # pinocchio keeps a continuous joint as a point on the circle
            configuration[moving.idx_q : moving.idx_q + 2] = np.cos(value), np.sin(value)
        else:
            configuration[moving.idx_q] = value
    pinocchio.framesForwardKinematics(model, data, configuration)

    def T_world(name: str) -> np.ndarray:
        return data.oMf[model.getFrameId(name, pinocchio.FrameType.BODY)].homogeneous

    T_base_world = np.linalg.inv(T_world(robot.base_link))
    return {name: T_base_world @ T_world(name) for name in robot.frame_names}


@pytest.mark.parametrize("name", ROBOTS)
def test_every_frame_agrees_with_pinocchio(name: str, robots_folder: Path) -> None:
    file, base_link, n_joints = ROBOTS[name]
    robot = Robot.from_urdf(robots_folder / file)
    assert robot.base_link == base_link
    assert robot.n_joints == n_joints
    rng = np.random.default_rng(1)
    q = rng.uniform(robot.lower, robot.upper, size=(3, n_joints))
    link_poses = robot.link_poses(q)
    frame_poses = {frame: robot.frame_pose(q, frame) for frame in robot.frame_names}
    for i in range(len(q)):
        truth = pinocchio_poses(robots_folder / file, robot, q[i])
        for frame in robot.frame_names:
            np.testing.assert_allclose(frame_poses[frame][i], truth[frame], atol=1e-12)
        for k, link in enumerate(robot.link_names):
            np.testing.assert_allclose(link_poses[i, k], truth[link], atol=1e-12)


def test_limits_agree_with_pinocchio(robots_folder: Path) -> None:
    path = robots_folder / ROBOTS["panda"][0]
    robot = Robot.from_urdf(path)
    model = pinocchio.buildModelFromUrdf(str(path), True)
    for name, lower, upper in zip(robot.joint_names, robot.lower, robot.upper, strict=True):
        index = model.joints[model.getJointId(name)].idx_q
        assert lower == model.lowerPositionLimit[index]
        assert upper == model.upperPositionLimit[index]


def test_batches_of_any_shape_give_what_single_poses_give(robots_folder: Path) -> None:
    robot = Robot.from_urdf(robots_folder / ROBOTS["kinova"][0])
    q = np.random.default_rng(2).uniform(robot.lower, robot.upper, size=(2, 3, robot.n_joints))
    poses = robot.link_poses(q)
    assert poses.shape == (2, 3, len(robot.link_names), 4, 4)
    assert robot.frame_pose(q, robot.frame_names[-1]).shape == (2, 3, 4, 4)
    assert robot.centre(q).shape == (2, 3, 3)
    np.testing.assert_allclose(poses[1, 2], robot.link_poses(q[1, 2]), atol=1e-15)
    np.testing.assert_allclose(robot.centre(q)[0, 1], robot.centre(q[0, 1]), atol=1e-15)
    assert robot.link_poses(q[:0]).shape == (0, 3, len(robot.link_names), 4, 4)


def test_turns_and_slides_known_by_hand(write_urdf: Callable[[str], Path]) -> None:
    robot = Robot.from_urdf(
        write_urdf(
            f'<link name="a">{BOX}</link><link name="b">{BOX}</link><link name="c">{BOX}</link>'
            + joint("turn", "a", "b", inside='<origin xyz="0 0 1"/><axis xyz="0 0 2"/>')
            + joint("slide", "b", "c", "prismatic", '<origin xyz="1 0 0"/><axis xyz="0 3 4"/>')
        )
    )
    T_base_c = robot.frame_pose([np.pi / 2, 0.5], "c")
    # Turned a quarter about Z, c stands at (0, 1) and slides along -X and Z; axes are normalised.
    np.testing.assert_allclose(T_base_c[:3, 3], [-0.3, 1.0, 1.4], atol=1e-12)
    np.testing.assert_allclose(T_base_c[:3, :3], [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-12)


def test_roll_pitch_yaw_turn_about_fixed_axes(write_urdf: Callable[[str], Path]) -> None:
    origin = '<origin rpy="1.5707963267948966 0 1.5707963267948966"/>'
    robot = Robot.from_urdf(
        write_urdf(
            f'<link name="a">{BOX}</link><link name="b"/>' + joint("j", "a", "b", "fixed", origin)
        )
    )
    # Roll first: Y becomes Z; then yaw: X becomes Y, Z stays.
    expected = [[0, 0, 1], [1, 0, 0], [0, 1, 0]]
    np.testing.assert_allclose(robot.frame_pose([], "b")[:3, :3], expected, atol=1e-12)


def chain(*rules: str) -> str:
    """Links l0, l1, ...; each prismatic joint j1, j2, ... along X with a mimic rule or none."""
    links = "".join(f'<link name="l{i}">{BOX}</link>' for i in range(len(rules) + 1))
    return links + "".join(
        joint(f"j{i + 1}", f"l{i}", f"l{i + 1}", "prismatic", rule) for i, rule in enumerate(rules)
    )


def test_mimic_rules_chain(write_urdf: Callable[[str], Path]) -> None:
    robot = Robot.from_urdf(
        write_urdf(
            chain(
                '<mimic joint="j2" multiplier="3" offset="0.5"/>',
                '<mimic joint="j3" multiplier="-2" offset="0.1"/>',
                "",
            )
        )
    )
    assert robot.joint_names == ("j3",)
    j3 = 0.2
    j2 = -2 * j3 + 0.1
    j1 = 3 * j2 + 0.5
    assert robot.frame_pose([j3], "l3")[0, 3] == pytest.approx(j1 + j2 + j3, abs=1e-14)


def test_mimic_rules_that_go_nowhere(write_urdf: Callable[[str], Path]) -> None:
    circle = chain('<mimic joint="j2"/>', '<mimic joint="j1"/>')
    with pytest.raises(InputError, match="j1 -> j2 -> j1 mimic each other in a circle"):
        Robot.from_urdf(write_urdf(circle))
    unknown = chain('<mimic joint="hand"/>', "")
    with pytest.raises(InputError, match="'j1' mimics the joint 'hand', which does not exist"):
        Robot.from_urdf(write_urdf(unknown))


def test_a_base_inside_the_tree_moves_with_its_joints(robots_folder: Path) -> None:
    path = robots_folder / ROBOTS["xarm7"][0]
    q = [0.3, -0.2, 0.5, 1.0, 0.1, 0.7, -0.4]
    usual = Robot.from_urdf(path)
    moved = Robot.from_urdf(path, base_link="link3")
    expected = np.linalg.inv(usual.frame_pose(q, "link3")) @ usual.frame_pose(q, "link_base")
    np.testing.assert_allclose(moved.frame_pose(q, "link_base"), expected, atol=1e-12)


def test_joint_vectors_of_the_wrong_length_or_not_finite(robots_folder: Path) -> None:
    robot = Robot.from_urdf(robots_folder / ROBOTS["xarm7"][0])
    with pytest.raises(InputError, match=r"shape \(6,\).*joint1, joint2"):
        robot.link_poses(np.zeros(6))
    with pytest.raises(InputError, match="not finite"):
        robot.link_poses(np.full(7, np.nan))
    with pytest.raises(InputError, match=r"No link is called 'tool'.*link_base"):
        robot.frame_pose(np.zeros(7), "tool")


# Robots with COLLADA, STL and mirrored meshes; the flying arm claims that Y is up.
MESHED = ["panda", "ur5", "baxter", "so100", "kinova"]


@pytest.mark.parametrize(
    "file",
    [*(ROBOTS[name][0] for name in MESHED), "hextilt_description/urdf/hextilt_flying_arm_5.urdf"],
)
def test_link_meshes_stand_where_pinocchio_puts_them(file: str, robots_folder: Path) -> None:
    path = robots_folder / file
    model = pinocchio.buildModelFromUrdf(str(path))
    shapes = pinocchio.buildGeomFromUrdf(
        model, str(path), pinocchio.GeometryType.VISUAL, None, [str(robots_folder.parents[1])]
    )
    truth: dict[str, list[np.ndarray]] = {}
    for shape in shapes.geometryObjects:
        frame = model.frames[shape.parentFrame]
        T_link_shape = (frame.placement.inverse() * shape.placement).homogeneous
        if hasattr(shape.geometry, "vertices"):
            vertices = np.array(shape.geometry.vertices())
            placed = vertices @ T_link_shape[:3, :3].T + T_link_shape[:3, 3]
            truth.setdefault(frame.name, []).extend([placed.min(axis=0), placed.max(axis=0)])
    robot = Robot.from_urdf(path)
    compared = [k for k, name in enumerate(robot.link_names) if name in truth]
    assert len(compared) >= 7
    for k in compared:
        corners = np.array(truth[robot.link_names[k]])
        vertices = robot.meshes[k].vertices
        np.testing.assert_allclose(vertices.min(axis=0), corners.min(axis=0), atol=1e-7)
        np.testing.assert_allclose(vertices.max(axis=0), corners.max(axis=0), atol=1e-7)
