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


def test_entities_are_refused(tmp_path: Path) -> None:
    path = write_package(tmp_path, "")
    path.write_text('<!DOCTYPE robot [<!ENTITY a "x">]><robot name="&a;"/>')
    assert "document type declaration" in message(path)
