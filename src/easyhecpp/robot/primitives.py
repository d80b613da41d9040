"""Boxes, cylinders and spheres of a URDF as triangles.

Round shapes are cut so finely, with their corners so far outside and their faces so far inside
the true surface, that no point is off by more than `TESSELLATION_ERROR`.
"""

from __future__ import annotations

import numpy as np

TESSELLATION_ERROR = 5e-5
"""Metres between a tessellated and a true round surface, which bounds the silhouette's error."""

_MIN_SEGMENTS, _MAX_SEGMENTS = 16, 512

_BOX_FACES = np.array(
    [
        [0, 3, 2], [0, 1, 3], [4, 7, 5], [4, 6, 7], [0, 5, 1], [0, 4, 5],
        [2, 7, 6], [2, 3, 7], [0, 6, 4], [0, 2, 6], [1, 7, 3], [1, 5, 7],
    ]
)  # fmt: skip


def box(size: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray, float]:
    """Box of the given edge lengths (3,) about the origin: vertices, faces, error 0."""
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    return signs * (np.array(size) / 2.0), _BOX_FACES, 0.0


def cylinder(size: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray, float]:
    """Cylinder of `(radius, length)` along Z about the origin: vertices, faces, error in metres."""
    radius, length = size
    # With half-angle a per segment and corners at r * 2 / (1 + cos a), corners are as far outside
    # as the middles of the faces are inside: r * (1 - cos a) / (1 + cos a), about r * a^2 / 4.
    n = _segments(np.pi / 2.0 * np.sqrt(radius / TESSELLATION_ERROR))
    c = np.cos(np.pi / n)
    angle = np.arange(n) * (2.0 * np.pi / n)
    ring = radius * 2.0 / (1.0 + c) * np.column_stack([np.cos(angle), np.sin(angle)])
    half = np.full(n, length / 2.0)
    vertices = np.concatenate(
        [
            np.column_stack([ring, -half]),
            np.column_stack([ring, half]),
            [[0.0, 0.0, -length / 2.0], [0.0, 0.0, length / 2.0]],
        ]
    )
    i = np.arange(n)
    j = (i + 1) % n
    faces = np.concatenate(
        [
            np.column_stack([i, j, n + j]),
            np.column_stack([i, n + j, n + i]),
            np.column_stack([j, i, np.full(n, 2 * n)]),
            np.column_stack([n + i, n + j, np.full(n, 2 * n + 1)]),
        ]
    )
    return vertices, faces, radius * (1.0 - c) / (1.0 + c)


def sphere(size: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray, float]:
    """Sphere of `(radius,)` about the origin: vertices, faces, error in metres."""
    (radius,) = size
    # A quadrilateral of half-angle a both ways dips to cos(a)^2 of its corners' radius.
    n = 2 * _segments(np.pi / 2.0 * np.sqrt(radius / (2.0 * TESSELLATION_ERROR)))
    c = np.cos(np.pi / n) ** 2
    rows = n // 2
    polar = np.arange(1, rows) * (np.pi / rows)
    angle = np.arange(n) * (2.0 * np.pi / n)
    rings = np.stack(
        [
            np.outer(np.sin(polar), np.cos(angle)),
            np.outer(np.sin(polar), np.sin(angle)),
            np.outer(np.cos(polar), np.ones(n)),
        ],
        axis=-1,
    ).reshape(-1, 3)
    vertices = np.concatenate([rings, [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]])
    i = np.arange(n)
    j = (i + 1) % n
    top, bottom, last = (rows - 1) * n, (rows - 1) * n + 1, (rows - 2) * n
    upper = (np.arange(rows - 2) * n)[:, None]
    bands = [
        np.stack([upper + i, upper + n + i, upper + n + j], axis=-1).reshape(-1, 3),
        np.stack([upper + i, upper + n + j, upper + j], axis=-1).reshape(-1, 3),
    ]
    caps = [
        np.column_stack([np.full(n, top), i, j]),
        np.column_stack([np.full(n, bottom), last + j, last + i]),
    ]
    faces = np.concatenate(bands + caps)
    return vertices * (radius * 2.0 / (1.0 + c)), faces, radius * (1.0 - c) / (1.0 + c)


def _segments(wanted: float) -> int:
    return int(np.clip(np.ceil(wanted), _MIN_SEGMENTS, _MAX_SEGMENTS))
