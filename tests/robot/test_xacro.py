"""Xacro files: what they expand to, and what is said when something is missing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from easyhecpp.errors import InputError
from easyhecpp.robot import Robot

NAMESPACE = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'
STICK = f"""<robot {NAMESPACE}><xacro:macro name="stick" params="name length">
  <link name="${{name}}"><visual><geometry><box size="0.1 0.1 ${{length}}"/></geometry></visual>
  </link>
  </xacro:macro></robot>"""


def write_package(root: Path, body: str) -> Path:
    (root / "arm" / "urdf").mkdir(parents=True)
    (root / "tools" / "urdf").mkdir(parents=True)
    (root / "arm" / "urdf" / "stick.xacro").write_text(STICK)
    (root / "tools" / "urdf" / "tool.xacro").write_text(STICK.replace('"stick"', '"tool"'))
    path = root / "arm" / "urdf" / "arm.urdf.xacro"
    path.write_text(f'<?xml version="1.0"?><robot {NAMESPACE} name="my_arm">{body}</robot>')
    return path


def message(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        Robot.from_urdf(path)
    return str(caught.value)


def test_includes_arguments_and_macros(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path = write_package(
        tmp_path,
        """<xacro:arg name="length" default="0.4"/>
        <xacro:include filename="stick.xacro"/>
        <xacro:include filename="$(find tools)/urdf/tool.xacro"/>
        <xacro:stick name="a" length="$(arg length)"/><xacro:tool name="b" length="${2 * 0.3}"/>
        <joint name="j" type="revolute"><parent link="a"/><child link="b"/>
        <origin xyz="0 0 1"/><limit lower="${-pi / 2}" upper="1"/></joint>""",
    )
    robot = Robot.from_urdf(path)
    assert robot.name == "my_arm"
    assert robot.link_names == ("a", "b")
    np.testing.assert_allclose(robot.lower, -np.pi / 2, atol=1e-6)
    assert [float(np.ptp(m.vertices[:, 2])) for m in robot.meshes] == pytest.approx([0.4, 0.6])
    assert capfd.readouterr() == ("", "")


def test_a_package_asked_for_by_an_included_file(tmp_path: Path) -> None:
    path = write_package(
        tmp_path,
        '<xacro:include filename="parts.xacro"/><xacro:tool name="a" length="1"/>',
    )
    include = '<xacro:include filename="$(find tools)/urdf/tool.xacro"/>'
    (path.parent / "parts.xacro").write_text(f"<robot {NAMESPACE}>{include}</robot>")
    assert Robot.from_urdf(path).link_names == ("a",)


@pytest.mark.parametrize(
    ("body", "what"),
    [
        ('<xacro:include filename="$(find gripper)/g.xacro"/>', "the package 'gripper'"),
        ('<xacro:include filename="missing.xacro"/>', "missing.xacro"),
        ('<link name="$(arg prefix)a"/>', "prefix"),
        ('<link name="${prefix}a"/>', "prefix"),
        ("<xacro:hand/>", "hand"),
        ("<link>", "mismatched tag"),
    ],
)
def test_what_is_missing_is_named(tmp_path: Path, body: str, what: str) -> None:
    path = write_package(tmp_path, body)
    text = message(path)
    assert what.lower() in text.lower()
    assert "arm.urdf.xacro" in text


def test_a_missing_package_tells_where_it_was_sought(tmp_path: Path) -> None:
    path = write_package(tmp_path, '<xacro:include filename="$(find gripper)/g.xacro"/>')
    assert str(tmp_path / "gripper") in message(path)
    assert "package_dirs" in message(path)


BOX_LINK = '<link name="a"><visual><geometry><box size="1 1 1"/></geometry></visual></link>'


@pytest.mark.parametrize(
    "body",
    [
        '<!-- <xacro:include filename="$(find nowhere)/old.xacro"/> -->',
        '<xacro:arg name="sim" default="false"/><xacro:if value="$(arg sim)">'
        '<xacro:include filename="$(find nowhere)/sim.xacro"/></xacro:if>',
        '<gazebo><plugin filename="lib.so" name="p">'
        "<parameters>$(find nowhere)/config/c.yaml</parameters></plugin></gazebo>",
        '<xacro:property name="config" value="$(find nowhere)/c.yaml"/>'
        '<ros2_control name="r"><param name="file">${config}</param></ros2_control>',
        '<xacro:include filename="$(find nowhere)/extra.xacro" optional="true"/>',
    ],
    ids=["comment", "if", "gazebo", "ros2_control", "optional"],
)
def test_packages_that_nothing_drawn_needs_may_be_missing(tmp_path: Path, body: str) -> None:
    assert Robot.from_urdf(write_package(tmp_path, BOX_LINK + body)).link_names == ("a",)


@pytest.mark.parametrize("file", ["g.xacro", "*.xacro"])
def test_a_package_that_is_included_from_must_be_there(tmp_path: Path, file: str) -> None:
    include = f'<xacro:include filename="$(find gripper)/{file}"/>'
    text = message(write_package(tmp_path, BOX_LINK + include))
    assert "The package 'gripper', from which the xacro file reads, was not found" in text
    assert str(tmp_path / "gripper") in text


@pytest.mark.parametrize("scheme", ["", "file://"])
def test_a_mesh_of_a_missing_package_is_told_as_a_mesh(tmp_path: Path, scheme: str) -> None:
    mesh = f'<mesh filename="{scheme}$(find gripper)/palm.stl"/>'
    body = f'<link name="a"><visual><geometry>{mesh}</geometry></visual></link>'
    text = message(write_package(tmp_path, body))
    assert "1 mesh file is missing" in text
    assert "'package://gripper/palm.stl' of link 'a'" in text
    assert str(tmp_path / "gripper" / "palm.stl") in text


def test_entities_are_refused(tmp_path: Path) -> None:
    path = write_package(tmp_path, "")
    path.write_text('<!DOCTYPE robot [<!ENTITY a "x">]><robot name="&a;"/>')
    assert "document type declaration" in message(path)
