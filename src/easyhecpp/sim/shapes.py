"""Triangle meshes of the things that furnish the simulated cell, each in its own frame.

They come with shading normals and texture coordinates.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles ready for shading; vertices are split where the surface has a crease.

    Attributes:
        vertices: (V, 3) metres.
        faces: (F, 3) int, counter-clockwise seen from outside.
        normals: (V, 3) unit shading normals.
        uvs: (V, 2) texture coordinates, or None for surfaces of one colour.
    """

    vertices: np.ndarray
    faces: np.ndarray
    normals: np.ndarray
    uvs: np.ndarray | None = None


def merged(*surfaces: Surface) -> Surface:
    """One surface that holds the triangles of several; each must have texture coordinates."""
    starts = np.cumsum([0, *(len(s.vertices) for s in surfaces)])
    return Surface(
        np.concatenate([s.vertices for s in surfaces]),
        np.concatenate([s.faces + start for s, start in zip(surfaces, starts, strict=False)]),
        np.concatenate([s.normals for s in surfaces]),
        np.concatenate([s.uvs for s in surfaces if s.uvs is not None]),
    )


def moved(surface: Surface, T_a_b: np.ndarray) -> Surface:
    """The surface given in frame b, expressed in frame a (rigid transforms only)."""
    return Surface(
        surface.vertices @ T_a_b[:3, :3].T + T_a_b[:3, 3],
        surface.faces,
        surface.normals @ T_a_b[:3, :3].T,
        surface.uvs,
    )


def _grid_faces(rows: int, columns: int) -> np.ndarray:
    """Two triangles for every cell of a (rows, columns) grid of vertices."""
    a = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    b, c, d = a + 1, a + columns, a + columns + 1
    return np.concatenate([np.column_stack([a, b, d]), np.column_stack([a, d, c])])


def panel(width: float, height: float) -> Surface:
    """A flat rectangle in the xy plane around the origin, facing +z; v runs down from +y."""
    x, y = width / 2, height / 2
    return Surface(
        np.array([[-x, -y, 0], [x, -y, 0], [x, y, 0], [-x, y, 0]], float),
        np.array([[0, 1, 2], [0, 2, 3]]),
        np.tile([0.0, 0.0, 1.0], (4, 1)),
        np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float),
    )


def box(size: tuple[float, float, float]) -> Surface:
    """A box around the origin; the texture covers each side once, upright on the four walls."""
    x, y, z = size
    sides = []
    for turn, (w, d) in enumerate([(y, x), (x, y), (y, x), (x, y)]):
        c, s = np.cos(turn * np.pi / 2), np.sin(turn * np.pi / 2)
        # Panel axes: x along the wall, y up, z outward.
        R = np.array([[-s, 0, c], [c, 0, s], [0, 1, 0]])
        sides.append(moved(panel(w, z), _placed(R, R[:, 2] * d / 2)))
    sides.append(moved(panel(x, y), _placed(np.eye(3), np.array([0, 0, z / 2]))))
    sides.append(moved(panel(x, y), _placed(np.diag([1.0, -1, -1]), np.array([0, 0, -z / 2]))))
    return merged(*sides)


def _placed(R: np.ndarray, t: np.ndarray) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, t
    return T


def sphere(radius: float, segments: int = 48) -> Surface:
    """A sphere around the origin."""
    polar = np.linspace(0, np.pi, segments // 2 + 1)[:, None]
    turn = np.linspace(0, 2 * np.pi, segments + 1)[None]
    normals = np.stack(
        [np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar) + 0 * turn],
        axis=-1,
    ).reshape(-1, 3)
    uvs = np.stack([turn / (2 * np.pi) + 0 * polar, 1 - polar / np.pi + 0 * turn], axis=-1)
    faces = _grid_faces(segments // 2 + 1, segments + 1)[:, ::-1]
    return Surface(radius * normals, faces, normals, uvs.reshape(-1, 2))


def lathe(profile: np.ndarray, segments: int = 40) -> Surface:
    """A solid of revolution about z: cups, bottles, posts, lamps.

    Args:
        profile: (N, 2) radius and height, from bottom to top. Every profile segment is flat
            shaded along z and smooth around it.
        segments: number of sides.
    """
    turn = np.linspace(0, 2 * np.pi, segments + 1)
    circle = np.column_stack([np.cos(turn), np.sin(turn)])
    parts = []
    for (r0, z0), (r1, z1) in pairwise(profile):
        slope = np.array([z1 - z0, r0 - r1]) / max(float(np.hypot(z1 - z0, r0 - r1)), 1e-12)
        rings = [
            np.column_stack([r * circle, np.full(segments + 1, z)]) for r, z in ((r0, z0), (r1, z1))
        ]
        normals = np.column_stack([slope[0] * circle, np.full(segments + 1, slope[1])])
        v = (np.array([z0, z1]) - profile[0, 1]) / max(float(np.ptp(profile[:, 1])), 1e-12)
        uvs = np.stack(np.meshgrid(turn / (2 * np.pi), v), axis=-1).reshape(-1, 2)
        parts.append(
            Surface(
                np.concatenate(rings),
                _grid_faces(2, segments + 1),
                np.concatenate([normals, normals]),
                uvs,
            )
        )
    return merged(*parts)


def cylinder(radius: float, height: float, segments: int = 40) -> Surface:
    """A closed cylinder standing on z = 0."""
    profile = np.array([[0, 0], [radius, 0], [radius, height], [0, height]], float)
    return lathe(profile, segments)


def tube(path: np.ndarray, radius: float, segments: int = 10) -> Surface:
    """A cable: a circle swept along a smooth path, open at both ends.

    Args:
        path: (N, 3) points; neighbouring directions must not be vertical to lie on a table.
        radius: metres.
        segments: number of sides.
    """
    tangent = np.gradient(path, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    side = np.cross(tangent, [0.0, 0.0, 1.0])
    side /= np.maximum(np.linalg.norm(side, axis=1, keepdims=True), 1e-9)
    up = np.cross(side, tangent)
    turn = np.linspace(0, 2 * np.pi, segments + 1)
    normals = (
        np.cos(turn)[None, :, None] * side[:, None] + np.sin(turn)[None, :, None] * up[:, None]
    )
    vertices = path[:, None] + radius * normals
    v, u = np.meshgrid(np.linspace(0, 1, len(path)), turn / (2 * np.pi), indexing="ij")
    return Surface(
        vertices.reshape(-1, 3),
        _grid_faces(len(path), segments + 1)[:, ::-1],
        normals.reshape(-1, 3),
        np.stack([u, v], axis=-1).reshape(-1, 2),
    )
