"""Reading a URDF into plain data, with every complaint naming the element it is about.

Only what a picture of the robot depends on is kept: links, their shapes, joints, mimic rules.
Masses, transmissions, simulator tags and materials are skipped.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeVar

import numpy as np

from easyhecpp.errors import InputError
from easyhecpp.robot.safe_xml import parse_xml

MOVING_TYPES = ("revolute", "continuous", "prismatic")
Geometry = Literal["visual", "collision"]
GEOMETRIES: tuple[Geometry, ...] = ("visual", "collision")
SHAPE_KINDS = ("mesh", "box", "cylinder", "sphere")


@dataclass(frozen=True)
class Shape:
    """One `<visual>` or `<collision>` of a link.

    Only one of the two is drawn, and not of every link, so that a shape which is none is an error
    only to whoever wants to draw it.

    Attributes:
        kind: `mesh`, `box`, `cylinder` or `sphere`; `none` when there is a problem.
        T_link_shape: (4, 4) pose of the shape in its link.
        size: box edges (3,), cylinder (radius, length), sphere (radius,), mesh scale (3,); metres
            but for the scale.
        filename: as written in the URDF, meshes only.
        where: the place in the URDF, for error texts.
        problem: why the shape cannot be drawn.
    """

    kind: str
    T_link_shape: np.ndarray
    size: tuple[float, ...]
    filename: str | None
    where: str
    problem: InputError | None = None


@dataclass(frozen=True)
class UrdfLink:
    """A link with its shapes as seen (`visual`) and as used for contact (`collision`)."""

    name: str
    visual: tuple[Shape, ...]
    collision: tuple[Shape, ...]


@dataclass(frozen=True)
class Mimic:
    """`value = multiplier * value(joint) + offset`."""

    joint: str
    multiplier: float
    offset: float


@dataclass(frozen=True)
class UrdfJoint:
    """A joint; `lower`/`upper` in radians or metres, equal to -pi, pi for a continuous joint."""

    name: str
    type: str
    parent: str
    child: str
    T_parent_joint: np.ndarray
    axis: np.ndarray
    lower: float
    upper: float
    mimic: Mimic | None

    @property
    def moves(self) -> bool:
        """Whether the joint has a degree of freedom, its own or a mimicked one."""
        return self.type in MOVING_TYPES


Named = TypeVar("Named", UrdfLink, UrdfJoint)


@dataclass(frozen=True)
class Urdf:
    """A whole URDF; `joints` are in document order, `root` is the only link without a parent."""

    name: str
    links: dict[str, UrdfLink]
    joints: tuple[UrdfJoint, ...]
    root: str


def parse_urdf(data: bytes, path: Path) -> Urdf:
    """Parse the bytes of a URDF; `path` is only used in error texts.

    Raises:
        InputError: not XML, not a URDF, xacro elements, a DTD, a number that is not finite, an
            unknown joint type, or links that do not form one tree. Shapes that cannot be drawn say
            so themselves.
    """
    element = parse_xml(data, path)
    if element.tag != "robot":
        raise InputError(
            f"The file is not a URDF: its root element is <{element.tag}>",
            where=path,
            expected="a <robot> element",
            fix="Give a URDF or a xacro file; convert SDF and MJCF models first",
        )
    _refuse_xacro(element, path)
    links = _unique((_read_link(e, path) for e in element.findall("link")), "link", path)
    joints = _unique((_read_joint(e, path) for e in element.findall("joint")), "joint", path)
    if not links:
        raise InputError(
            "The URDF has no links",
            where=path,
            expected="<link> elements",
            fix="If it is a xacro file, give it the suffix .xacro" if b"xacro" in data else None,
        )
    root = _check_tree(links, list(joints.values()), path)
    return Urdf(element.get("name") or path.stem, links, tuple(joints.values()), root)


def _refuse_xacro(robot: ET.Element, path: Path) -> None:
    """Xacro elements in a file that is read as a URDF: what they stand for would be missing."""
    for element in robot.iter():
        namespace, _, name = element.tag.rpartition("}")
        if "xacro" in namespace:
            raise InputError(
                f"The file has to be expanded first: it holds <xacro:{name}>",
                where=path,
                expected="a URDF without xacro elements",
                fix="Give it the suffix .xacro, or expand it (xacro FILE > robot.urdf)",
            )


def _unique(items: Iterable[Named], what: str, path: Path) -> dict[str, Named]:
    named: dict[str, Named] = {}
    for item in items:
        if item.name in named:
            raise InputError(
                f"Two {what}s are called '{item.name}'",
                where=path,
                expected=f"each {what} name once",
            )
        named[item.name] = item
    return named


def _read_link(element: ET.Element, path: Path) -> UrdfLink:
    name = _attribute(element, "name", f"{path}, a <link>")
    where = f"{path}, link '{name}'"
    shapes = {
        kind: tuple(_shape_or_problem(e, f"{where}, <{kind}>") for e in element.findall(kind))
        for kind in GEOMETRIES
    }
    return UrdfLink(name, **shapes)


def _shape_or_problem(element: ET.Element, where: str) -> Shape:
    try:
        return _read_shape(element, where)
    except InputError as error:
        return Shape("none", np.eye(4), (), None, where, error)


def _read_shape(element: ET.Element, where: str) -> Shape:
    geometry = element.find("geometry")
    inner = None if geometry is None else next(iter(geometry), None)
    if inner is None:
        raise InputError(
            "A shape has no geometry", where=where, expected=f"one of {', '.join(SHAPE_KINDS)}"
        )
    filename = None
    if inner.tag == "mesh":
        filename = _attribute(inner, "filename", f"{where}, <mesh>")
        size = _numbers(inner, "scale", where, default=(1.0, 1.0, 1.0))
        if len(size) == 1:  # some exporters write one number for a uniform scale
            size = size * 3
    elif inner.tag == "box":
        size = _numbers(inner, "size", where)
    elif inner.tag == "cylinder":
        size = _numbers(inner, "radius", where) + _numbers(inner, "length", where)
    elif inner.tag == "sphere":
        size = _numbers(inner, "radius", where)
    else:
        raise InputError(
            f"Geometry <{inner.tag}> is not supported",
            where=where,
            expected=f"one of {', '.join(SHAPE_KINDS)}",
            fix="Replace it by a mesh",
        )
    _check_size(inner.tag, size, where)
    return Shape(inner.tag, _read_origin(element, where), size, filename, where)


def _check_size(kind: str, size: tuple[float, ...], where: str) -> None:
    count = {"mesh": 3, "box": 3, "cylinder": 2, "sphere": 1}[kind]
    wrong = len(size) != count or any(s == 0 if kind == "mesh" else s <= 0 for s in size)
    if wrong:
        expected = "a scale of 3 numbers other than 0" if kind == "mesh" else "sizes above 0"
        raise InputError(
            f"The size of a {kind} is {' '.join(f'{s:g}' for s in size)}",
            where=where,
            expected=expected,
        )


def _read_joint(element: ET.Element, path: Path) -> UrdfJoint:
    name = _attribute(element, "name", f"{path}, a <joint>")
    where = f"{path}, joint '{name}'"
    joint_type = _attribute(element, "type", where)
    if joint_type not in (*MOVING_TYPES, "fixed"):
        raise InputError(
            f"Joint '{name}' is of type '{joint_type}', which is not supported",
            where=path,
            expected=f"one of {', '.join(MOVING_TYPES)}, fixed",
            fix="Make it fixed if the part does not move between views",
        )
    ends = {}
    for end in ("parent", "child"):
        child = element.find(end)
        if child is None:
            raise InputError(f"Joint '{name}' has no <{end}>", where=path)
        ends[end] = _attribute(child, "link", f"{where}, <{end}>")
    axis = np.array([1.0, 0.0, 0.0])
    if (axis_element := element.find("axis")) is not None:
        axis = np.array(_numbers(axis_element, "xyz", where, count=3, default=(1.0, 0.0, 0.0)))
    norm = float(np.linalg.norm(axis))
    if joint_type != "fixed" and norm < 1e-9:
        raise InputError(f"The axis of joint '{name}' has no length", where=path)
    mimic = _read_mimic(element, where)
    lower, upper = _read_limits(element, name, joint_type, mimic is not None, path)
    return UrdfJoint(
        name,
        joint_type,
        ends["parent"],
        ends["child"],
        _read_origin(element, where),
        axis / max(norm, 1e-9),
        lower,
        upper,
        mimic,
    )


def _read_mimic(element: ET.Element, where: str) -> Mimic | None:
    mimic = element.find("mimic")
    if mimic is None:
        return None
    (multiplier,) = _numbers(mimic, "multiplier", where, count=1, default=(1.0,))
    (offset,) = _numbers(mimic, "offset", where, count=1, default=(0.0,))
    return Mimic(_attribute(mimic, "joint", f"{where}, <mimic>"), multiplier, offset)


def _read_limits(
    element: ET.Element, name: str, joint_type: str, is_mimic: bool, path: Path
) -> tuple[float, float]:
    """Limits of a joint; a mimic joint needs none of its own, since its source has them."""
    if joint_type == "continuous":
        return -np.pi, np.pi
    limit = element.find("limit")
    if joint_type == "fixed" or (limit is None and is_mimic):
        return 0.0, 0.0
    if limit is None:
        raise InputError(
            f"The {joint_type} joint '{name}' has no <limit>",
            where=path,
            expected='<limit lower="..." upper="..."/> in radians or metres',
            fix="Add the limits, or make the joint 'continuous' if it turns without end",
        )
    where = f"{path}, joint '{name}', <limit>"
    (lower,) = _numbers(limit, "lower", where, count=1, default=(0.0,))
    (upper,) = _numbers(limit, "upper", where, count=1, default=(0.0,))
    if lower > upper:
        raise InputError(
            f"The lower limit {lower:g} of joint '{name}' is above its upper limit {upper:g}",
            where=path,
        )
    return lower, upper


def _read_origin(element: ET.Element, where: str) -> np.ndarray:
    """(4, 4) transform of an element's `<origin>`, identity when it has none."""
    T = np.eye(4)
    origin = element.find("origin")
    if origin is not None:
        T[:3, :3] = rotation_from_rpy(
            *_numbers(origin, "rpy", where, count=3, default=(0.0, 0.0, 0.0))
        )
        T[:3, 3] = _numbers(origin, "xyz", where, count=3, default=(0.0, 0.0, 0.0))
    return T


def rotation_from_rpy(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """(3, 3) rotation of a URDF's `rpy`: about the fixed X, then Y, then Z axis, radians."""
    (cr, cp, cy), (sr, sp, sy) = np.cos([roll, pitch, yaw]), np.sin([roll, pitch, yaw])
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def _attribute(element: ET.Element, name: str, where: str) -> str:
    value = element.get(name)
    if not value:
        raise InputError(f"The attribute '{name}' is missing", where=where)
    return value


def _numbers(
    element: ET.Element,
    name: str,
    where: str,
    count: int | None = None,
    default: tuple[float, ...] | None = None,
) -> tuple[float, ...]:
    text = element.get(name)
    if text is None and default is not None:
        return default
    text = _attribute(element, name, where) if not text else text
    try:
        values = tuple(float(word) for word in text.split())
    except ValueError:
        values = ()
    if not values or not np.all(np.isfinite(values)) or (count and len(values) != count):
        raise InputError(
            f'{name}="{text}" is not {"a list of" if count is None else count} finite '
            f"number{'' if count == 1 else 's'}",
            where=where,
        )
    return values


def _check_tree(links: dict[str, UrdfLink], joints: list[UrdfJoint], path: Path) -> str:
    """The root of the tree that the joints make of the links."""
    parent_joint: dict[str, UrdfJoint] = {}
    for joint in joints:
        for end in (joint.parent, joint.child):
            if end not in links:
                raise InputError(
                    f"Joint '{joint.name}' names the link '{end}', which does not exist",
                    where=path,
                    expected=f"one of the links: {', '.join(links)}",
                )
        if joint.child in parent_joint:
            raise InputError(
                f"Link '{joint.child}' has two parents: it is the child of the joints "
                f"'{parent_joint[joint.child].name}' and '{joint.name}'",
                where=path,
                expected="a tree; a closed chain has to be cut at one joint",
            )
        parent_joint[joint.child] = joint
    for link in links:
        _check_no_loop(link, parent_joint, path)
    roots = [link for link in links if link not in parent_joint]
    if len(roots) != 1:
        raise InputError(
            f"The links form {len(roots)} separate trees, with the roots {', '.join(roots)}",
            where=path,
            expected="one tree",
            fix="Connect them by fixed joints, or remove what is not used",
        )
    return roots[0]


def _check_no_loop(link: str, parent_joint: dict[str, UrdfJoint], path: Path) -> None:
    seen = [link]
    while (joint := parent_joint.get(seen[-1])) is not None:
        if joint.parent in seen:
            loop = seen[seen.index(joint.parent) :]
            raise InputError(
                f"The links {' <- '.join([*loop, loop[0]])} form a loop",
                where=path,
                expected="a tree with one root",
            )
        seen.append(joint.parent)
