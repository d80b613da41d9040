"""A robot in a few plain numbers, for people and for `json.dumps`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from easyhecpp.robot.link_mesh import LinkMesh
from easyhecpp.robot.robot import Robot


@dataclass(frozen=True)
class JointSummary:
    """An actuated joint; limits in `unit`, which is `rad` or `m`."""

    name: str
    type: str
    unit: str
    lower: float
    upper: float


@dataclass(frozen=True)
class LinkSummary:
    """A link with geometry; `size` holds the edges in metres of its box along its own axes."""

    name: str
    faces: int
    open_edges: int
    size: tuple[float, float, float]


@dataclass(frozen=True)
class RobotSummary:
    """What there is to know about a robot before calibrating with it.

    Attributes:
        name: name in the URDF.
        base_link: the link whose frame is `base`.
        joints: actuated joints, in the order of joint vectors.
        links: links with geometry.
        frames: all links.
        faces: triangles of all links.
        reach: largest distance found between the base's origin and the surface, metres.
        mesh_error: metres by which surfaces may be off through tessellation or simplification.
        missing: links whose geometry is of the other kind (visual, collision) than the one in use.
        notes: what a user should know, sentences.
    """

    name: str
    base_link: str
    joints: tuple[JointSummary, ...]
    links: tuple[LinkSummary, ...]
    frames: tuple[str, ...]
    faces: int
    reach: float
    mesh_error: float
    missing: tuple[str, ...]
    notes: tuple[str, ...]


def describe(robot: Robot) -> RobotSummary:
    """Sum a robot up; `dataclasses.asdict` of the answer is ready for JSON."""
    joints = zip(robot.joint_names, robot.joint_types, robot.lower, robot.upper, strict=True)
    return RobotSummary(
        name=robot.name,
        base_link=robot.base_link,
        joints=tuple(
            JointSummary(name, kind, "m" if kind == "prismatic" else "rad", float(low), float(high))
            for name, kind, low, high in joints
        ),
        links=tuple(
            LinkSummary(name, len(mesh.faces), mesh.n_open_edges, _size(mesh))
            for name, mesh in zip(robot.link_names, robot.meshes, strict=True)
        ),
        frames=robot.frame_names,
        faces=robot.n_faces,
        reach=robot.reach,
        mesh_error=robot.mesh_error,
        missing=robot.undrawn_links,
        notes=robot.notes,
    )


def _size(mesh: LinkMesh) -> tuple[float, float, float]:
    x, y, z = np.ptp(mesh.vertices, axis=0).tolist()
    return x, y, z
