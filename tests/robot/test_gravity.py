"""How an arm gives way under its own weight."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from easyhecpp.robot import Robot
from easyhecpp.robot.gravity import loads
from easyhecpp.robot.link_mesh import LinkMesh

BAR = """<link name="{name}"><visual><origin xyz="{middle} 0 0"/>
<geometry><box size="{length} 0.1 0.1"/></geometry></visual></link>"""


def arm(folder: Path, axes: tuple[str, str] = ("0 1 0", "0 1 0"), kind: str = "revolute") -> Robot:
    """A base and two bars in a row along x, 0.6 and 0.4 m long."""
    joint = """<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>
<origin xyz="{x} 0 0"/><axis xyz="{axis}"/><limit lower="-3" upper="3" effort="1" velocity="1"/>
</joint>"""
    text = "".join(
        [
            '<robot name="bars"><link name="base"><visual><geometry><sphere radius="0.1"/>',
            "</geometry></visual></link>",
            BAR.format(name="upper", middle=0.3, length=0.6),
            BAR.format(name="fore", middle=0.2, length=0.4),
            joint.format(
                name="shoulder", kind="revolute", parent="base", child="upper", x=0, axis=axes[0]
            ),
            joint.format(
                name="elbow", kind=kind, parent="upper", child="fore", x=0.6, axis=axes[1]
            ),
            "</robot>",
        ]
    )
    path = folder / "bars.urdf"
    path.write_text(text)
    return Robot.from_urdf(path)


def test_loads_are_weights_times_levers(tmp_path: Path) -> None:
    robot = arm(tmp_path)
    upper, fore = 0.6 * 0.01, 0.4 * 0.01
    # Turning about +y lowers what points along x: weight pulls the joint to larger values.
    straight = loads(robot, np.zeros(2))
    assert straight == pytest.approx([upper * 0.3 + fore * 0.8, fore * 0.2], rel=1e-6)
    up = loads(robot, np.array([-np.pi / 2.0, 0.0]))
    assert up == pytest.approx([0.0, 0.0], abs=1e-9)
    folded = loads(robot, np.array([[0.0, np.pi]]))
    assert folded[0] == pytest.approx([upper * 0.3 + fore * 0.4, -fore * 0.2], rel=1e-6)


def test_one_unit_of_sag_is_the_most_that_a_joint_gives_way(tmp_path: Path) -> None:
    robot = arm(tmp_path)
    poses = np.random.default_rng(3).uniform(robot.lower, robot.upper, (4000, 2))
    sag = robot.sag(poses)
    assert np.abs(sag).max() == pytest.approx(1.0, abs=0.02)
    assert robot.sag(np.zeros(2)) == pytest.approx([1.0, 0.16], abs=0.02)


def test_what_turns_about_the_vertical_or_slides_does_not_sag(tmp_path: Path) -> None:
    flat = arm(tmp_path, ("0 0 1", "0 0 1"))
    assert flat.sag(np.array([0.4, -1.0])) == pytest.approx([0.0, 0.0], abs=1e-5)
    sliding = arm(tmp_path, ("0 1 0", "1 0 0"), kind="prismatic")
    assert sliding.sag(np.array([0.0, 0.1]))[1] == 0.0


def test_the_hull_of_a_link() -> None:
    corners = np.array([[x, y, z] for x in (0.0, 2.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
    box = LinkMesh.from_triangles(corners, np.array([[0, 1, 2], [1, 3, 7], [4, 5, 6], [0, 4, 6]]))
    assert box.hull_volume == pytest.approx(2.0)
    assert box.hull_centroid == pytest.approx([1.0, 0.5, 0.5])
    wedge = LinkMesh.from_triangles(
        np.vstack([np.zeros(3), np.eye(3)]), np.array([[0, 1, 2], [1, 2, 3]])
    )
    assert wedge.hull_volume == pytest.approx(1.0 / 6.0)
    assert wedge.hull_centroid == pytest.approx([0.25, 0.25, 0.25])
    flat = LinkMesh.from_triangles(
        np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]])
    )
    assert flat.hull_volume == 0.0
    assert flat.hull_centroid == pytest.approx([1 / 3, 1 / 3, 0.0])
