"""Meshes, poses and cameras for the tests of the renderer."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from easyhecpp.camera import Camera
from easyhecpp.geometry import exp_se3, make_transform
from easyhecpp.robot import LinkMesh, primitives

F64 = NDArray[np.float64]

PINHOLE = Camera(width=200, height=150, fx=170.0, fy=172.0, cx=97.3, cy=76.1)
# Smaller: the reference undoes the distortion of every sample, which takes its time.
PLUMB_BOB = Camera(
    120, 90, 90.0, 91.0, 58.8, 46.0, "plumb_bob", (-0.30, 0.11, 0.003, -0.002, -0.01)
)
RATIONAL = Camera(
    120, 90, 90.0, 90.0, 60.4, 43.6, "rational_polynomial",
    (0.4, -0.2, 0.001, -0.001, 0.02, 0.7, -0.1, 0.01),
)  # fmt: skip
FISHEYE = Camera(120, 90, 45.0, 45.0, 59.5, 44.5, "equidistant", (0.03, -0.01, 0.003, -0.001))
CAMERAS = {"pinhole": PINHOLE, "plumb_bob": PLUMB_BOB, "rational": RATIONAL, "fisheye": FISHEYE}


def box(x: float, y: float, z: float) -> LinkMesh:
    return LinkMesh.from_triangles(*primitives.box((x, y, z))[:2])


def ball(radius: float, steps: int = 24) -> LinkMesh:
    """A latitude-longitude sphere around the origin, of ``2 steps (steps - 1)`` faces or so."""
    polar, azimuth = np.meshgrid(
        np.linspace(0, np.pi, steps), np.linspace(0, 2 * np.pi, 2 * steps), indexing="ij"
    )
    vertices = np.stack(
        [np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], axis=-1
    )
    corner = np.arange(polar.size).reshape(polar.shape)
    a, b, c, d = corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]
    faces = np.concatenate([np.stack(t, axis=-1).reshape(-1, 3) for t in ((a, b, c), (a, c, d))])
    return LinkMesh.from_triangles(radius * vertices.reshape(-1, 3), faces)


def tube(radius: float, length: float, segments: int = 24) -> LinkMesh:
    """A cylinder's wall along z without its lids: an open mesh with two boundaries."""
    angle = np.arange(segments) * (2 * np.pi / segments)
    ring = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    vertices = np.concatenate(
        [np.column_stack([ring, np.full(segments, z)]) for z in (-length / 2, length / 2)]
    )
    i = np.arange(segments)
    j = (i + 1) % segments
    faces = np.concatenate(
        [np.column_stack([i, j, segments + j]), np.column_stack([i, segments + j, segments + i])]
    )
    return LinkMesh.from_triangles(vertices, faces)


def rectangle(left: float, top: float, right: float, bottom: float, depth: float = 1.0):
    """A sheet at constant depth whose corners project to the given pixels of `PINHOLE`."""
    corners = np.array([(left, top), (right, top), (right, bottom), (left, bottom)], float)
    return LinkMesh.from_triangles(
        PINHOLE.unproject(corners) * depth, np.array([[0, 1, 2], [0, 2, 3]])
    )


def at(x: float, y: float, z: float, turn: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> F64:
    return make_transform(np.eye(3), [x, y, z]) @ exp_se3([0.0, 0.0, 0.0, *turn])


ARM = (box(0.16, 0.16, 0.1), tube(0.05, 0.3), ball(0.07), box(0.06, 0.3, 0.05), ball(0.05, 16))
"""Five links, closed and open, that overlap each other's joints as an arm's do."""

ARM_POSES = np.stack(
    [
        at(-0.05, 0.28, 1.0, (1.4, 0.2, 0.1)),
        at(-0.05, 0.12, 1.0, (1.5, 0.1, 0.0)),
        at(-0.05, -0.05, 1.0),
        at(0.08, -0.1, 0.95, (0.3, 0.4, 1.2)),
        at(0.2, -0.15, 0.9),
    ]
)


def random_poses(rng: np.random.Generator, count: int, depth: float = 1.0, spread: float = 0.15):
    """Poses in front of the camera, turned any way."""
    moves = np.concatenate(
        [rng.normal(0.0, spread, (count, 3)), rng.normal(0.0, 1.0, (count, 3))], 1
    )
    return make_transform(np.eye(3), [0.0, 0.0, depth]) @ exp_se3(moves)
