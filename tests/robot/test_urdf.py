"""What is wrong with a URDF is said in words that lead to the mistake."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from easyhecpp.errors import InputError
from easyhecpp.robot import Robot

from .urdf_text import BOX, LIMIT, joint

Write = Callable[[str], Path]

LINKS = f'<link name="a">{BOX}</link><link name="b">{BOX}</link>'


def message(path: Path, **options: object) -> str:
    with pytest.raises(InputError) as caught:
        Robot.from_urdf(path, **options)
    return str(caught.value)


def test_missing_file(tmp_path: Path) -> None:
    text = message(tmp_path / "nothing.urdf")
    assert "robot description does not exist" in text
    assert "nothing.urdf" in text


def test_not_xml_and_not_a_urdf(tmp_path: Path) -> None:
    path = tmp_path / "robot.urdf"
    path.write_text("joint,x\n1,2\n")
    assert "not valid XML" in message(path)
    path.write_bytes(b'<?xml version="1.0" encoding="utf-77"?><robot/>')
    assert "not valid XML" in message(path)
    path.write_text("<sdf><model/></sdf>")
    assert "root element is <sdf>" in message(path)
    path.write_text('<robot xmlns:xacro="x" name="r"><xacro:arm/></robot>')
    assert "has no links" in message(path)
    assert ".xacro" in message(path)


@pytest.mark.parametrize(
    "inside",
    [
        '<xacro:include filename="hand.xacro"/>',
        '<gazebo><xacro:property name="x" value="1"/></gazebo>',
        '<xacro:macro name="m" params=""/>',
    ],
)
def test_xacro_that_is_called_a_urdf(tmp_path: Path, inside: str) -> None:
    path = tmp_path / "robot.urdf"
    namespace = 'xmlns:xacro="http://ros.org/wiki/xacro"'
    path.write_text(f'<robot {namespace} name="r"><link name="a">{BOX}</link>{inside}</robot>')
    text = message(path)
    assert "has to be expanded first: it holds <xacro:" in text
    assert "Give it the suffix .xacro" in text
    # Expanded files often keep the declaration.
    path.write_text(f'<robot {namespace} name="r"><link name="a">{BOX}</link></robot>')
    assert Robot.from_urdf(path).link_names == ("a",)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_entities_are_refused_before_they_expand(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "robot.urdf"
    entities = '<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;"><!ENTITY c "&b;&b;&b;">'
    path.write_text(
        f'<?xml version="1.0" encoding="{encoding}"?><!DOCTYPE robot [{entities}]>'
        '<robot name="&c;"/>',
        encoding=encoding,
    )
    assert "document type declaration" in message(path)


def test_trees_that_are_none(write_urdf: Write) -> None:
    loop = joint("j1", "a", "b") + joint("j2", "b", "a")
    assert "a <- b <- a form a loop" in message(write_urdf(LINKS + loop))
    assert "2 separate trees, with the roots a, b" in message(write_urdf(LINKS))
    two = f'<link name="c">{BOX}</link>' + joint("j1", "a", "c") + joint("j2", "b", "c")
    assert "'c' has two parents: it is the child of the joints 'j1' and 'j2'" in message(
        write_urdf(LINKS + two)
    )
    beside = LINKS + '<link name="c"/>' + joint("j1", "a", "b") + joint("j2", "b", "a")
    assert "form a loop" in message(write_urdf(beside))


def test_names_that_do_not_fit(write_urdf: Write) -> None:
    text = message(write_urdf(LINKS + joint("j", "a", "hand")))
    assert "joint 'j' names the link 'hand'" in text.lower()
    assert "a, b" in text
    assert "Two links are called 'a'" in message(write_urdf(LINKS + '<link name="a"/>'))
    twice = LINKS + '<link name="c"/>' + joint("j", "a", "b") + joint("j", "b", "c")
    assert "Two joints are called 'j'" in message(write_urdf(twice))
    assert "attribute 'name' is missing" in message(write_urdf("<link/>"))


@pytest.mark.parametrize("kind", ["floating", "planar", "ball"])
def test_unsupported_joint_types_are_named(write_urdf: Write, kind: str) -> None:
    text = message(write_urdf(LINKS + joint("j", "a", "b", kind)))
    assert f"Joint 'j' is of type '{kind}'" in text
    assert "revolute, continuous, prismatic, fixed" in text


def test_limits_are_asked_for_where_they_are_needed(write_urdf: Write) -> None:
    ends = '<parent link="a"/><child link="b"/>'
    bare = f'<joint name="j" type="revolute">{ends}</joint>'
    text = message(write_urdf(LINKS + bare))
    assert "The revolute joint 'j' has no <limit>" in text
    assert "continuous" in text
    swapped = joint("j", "a", "b", inside='<limit lower="1" upper="-1"/>')
    assert "lower limit 1 of joint 'j' is above" in message(write_urdf(LINKS + swapped))
    mimic = joint("k", "b", "c", inside='<mimic joint="j"/>').replace(LIMIT, "")
    path = write_urdf(LINKS + '<link name="c"/>' + joint("j", "a", "b") + mimic)
    assert Robot.from_urdf(path).joint_names == ("j",)
    endless = Robot.from_urdf(write_urdf(LINKS + joint("j", "a", "b", "continuous")))
    np.testing.assert_array_equal([endless.lower[0], endless.upper[0]], [-np.pi, np.pi])


@pytest.mark.parametrize(
    ("inside", "what"),
    [
        ('<origin xyz="0 nan 0"/>', 'xyz="0 nan 0" is not 3 finite numbers'),
        ('<origin rpy="0 0"/>', 'rpy="0 0" is not 3 finite numbers'),
        ('<axis xyz="0 0 one"/>', 'xyz="0 0 one" is not 3 finite numbers'),
        ('<axis xyz="0 0 0"/>', "axis of joint 'j' has no length"),
        ('<limit lower="-inf" upper="1"/>', 'lower="-inf" is not 1 finite number'),
    ],
)
def test_numbers_that_are_none(write_urdf: Write, inside: str, what: str) -> None:
    text = message(write_urdf(LINKS + joint("j", "a", "b", inside=inside)))
    assert what in text
    assert "joint 'j'" in text


@pytest.mark.parametrize(
    ("geometry", "what"),
    [
        ('<capsule radius="1" length="1"/>', "<capsule> is not supported"),
        ('<box size="1 0 1"/>', "size of a box is 1 0 1"),
        ('<cylinder radius="1"/>', "'length' is missing"),
        ('<mesh filename="m.stl" scale="1 1"/>', "size of a mesh is 1 1"),
        ('<mesh filename="m.stl" scale="1 0 1"/>', "size of a mesh is 1 0 1"),
        ("<mesh/>", "'filename' is missing"),
        ("", "has no geometry"),
    ],
)
def test_shapes_that_are_none(write_urdf: Write, geometry: str, what: str) -> None:
    body = f'<link name="a"><visual><geometry>{geometry}</geometry></visual></link>'
    text = message(write_urdf(body))
    assert what in text
    assert "link 'a', <visual>" in text
    drawn = f'<link name="b">{BOX}</link>' + joint("j", "a", "b")
    assert Robot.from_urdf(write_urdf(body + drawn), ignore_links=["a"]).link_names == ("b",)


@pytest.mark.parametrize(
    ("shape", "what"),
    [
        ('<geometry><capsule radius="1" length="1"/></geometry>', "<capsule> is not supported"),
        ('<geometry><sphere radius="0"/></geometry>', "size of a sphere is 0"),
        ('<origin xyz="0 0"/><geometry><box size="1 1 1"/></geometry>', "is not 3 finite numbers"),
        ("", "has no geometry"),
    ],
)
def test_shapes_that_are_not_drawn_may_be_none(write_urdf: Write, shape: str, what: str) -> None:
    collision = f"<collision>{shape}</collision>"
    path = write_urdf(f'<link name="a">{BOX}{collision}</link>')
    assert Robot.from_urdf(path).n_faces == 12
    text = message(path, geometry="collision")
    assert what in text
    assert "link 'a', <collision>" in text


def test_unknown_links_in_options(write_urdf: Write) -> None:
    path = write_urdf(LINKS + joint("j", "a", "b"))
    assert "'c' (base_link). Expected: one of a, b" in message(path, base_link="c")
    assert "'c' or 'd' (ignore_links)" in message(path, ignore_links=["a", "c", "d"])
    assert "Unknown geometry 'looks'" in message(path, geometry="looks")
