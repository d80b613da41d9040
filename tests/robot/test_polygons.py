"""Triangles cover a polygon once: their areas, all of one sign, add up to its own."""

from __future__ import annotations

import numpy as np
import pytest

from easyhecpp.robot.polygons import triangulate

SHAPES = {
    "triangle": [(0, 0), (1, 0), (0, 1)],
    "square": [(0, 0), (1, 0), (1, 1), (0, 1)],
    "notched": [(0, 0), (2, 0), (2, 2), (1, 0.2), (0, 2)],
    "arrowhead": [(0, 0), (2, 1), (0, 2), (1, 1)],
    "arrowhead from its notch": [(1, 1), (0, 0), (2, 1), (0, 2)],
    "comb": [
        (0, 0), (7, 0), (7, 3), (6, 3), (6, 1), (4, 1),
        (4, 3), (3, 3), (3, 1), (1, 1), (1, 3), (0, 3),
    ],
    "straight corners": [(0, 0), (1, 0), (2, 0), (2, 2), (1, 0.5), (0, 2), (0, 1)],
    # A cut leads from the rim to the hole and back.
    "square with a hole": [
        (0, 0), (3, 0), (3, 3), (0, 3), (0, 0),
        (1, 1), (1, 2), (2, 2), (2, 1), (1, 1),
    ],
}  # fmt: skip


def turned(flat: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A flat shape somewhere in space."""
    frame, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return flat @ frame[:2] + rng.normal(size=3)


def area_vector(points: np.ndarray) -> np.ndarray:
    return np.cross(points, np.roll(points, -1, axis=0)).sum(axis=0) / 2


def check(points: np.ndarray) -> None:
    faces = triangulate(points, np.arange(len(points)), np.array([len(points)]))
    assert len(faces) == len(points) - 2
    whole = area_vector(points)
    parts = np.array([area_vector(points[face]) for face in faces])
    normal = whole / np.linalg.norm(whole)
    assert (parts @ normal > -1e-9).all()
    assert (parts @ normal).sum() == pytest.approx(np.linalg.norm(whole), rel=1e-9)


@pytest.mark.parametrize("name", SHAPES)
def test_shapes_that_are_not_convex(name: str) -> None:
    rng = np.random.default_rng(2)
    for flat in (np.array(SHAPES[name], float), np.array(SHAPES[name][::-1], float)):
        check(np.column_stack([flat, np.zeros(len(flat))]))
        check(turned(flat, rng))


def test_jagged_stars() -> None:
    rng = np.random.default_rng(5)
    for corners in rng.integers(4, 60, 40):
        angle = np.sort(rng.uniform(0, 2 * np.pi, corners))
        if np.diff(angle, append=angle[0] + 2 * np.pi).max() > np.pi:
            continue  # it would not go round its middle
        radius = rng.uniform(0.1, 1, corners)
        check(turned(np.column_stack([radius * np.cos(angle), radius * np.sin(angle)]), rng))


def test_polygons_of_all_sizes_at_once() -> None:
    vertices = np.array([[0, 0, 0], [2, 0, 0], [2, 2, 0], [1, 0.2, 0], [0, 2, 0]], float)
    corners = np.array([0, 1, 2, 3, 4, 0, 1, 0, 1, 2, 4, 4, 3, 2])
    faces = triangulate(vertices, corners, np.array([5, 2, 4, 3]))
    areas = np.array([area_vector(vertices[face])[2] for face in faces])
    assert areas.sum() == pytest.approx(2.2 + 4 + 1.8)
    assert (areas > 0).all()
    assert triangulate(vertices, corners[:0], np.array([], int)).shape == (0, 3)
