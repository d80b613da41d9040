"""Flat polygons in space to triangles, also where they are not convex."""

from __future__ import annotations

import numpy as np

# Turns that are smaller than this, relative to the polygon's area, are straight.
_STRAIGHT = 1e-9


def triangulate(vertices: np.ndarray, corners: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """Cut polygons into triangles that wind as they do.

    Convex ones become fans from their first corner, others lose one ear after the other (Meisters,
    "Polygons have ears", 1975).

    Args:
        vertices: (V, 3).
        corners: (C,) vertex indices, polygon after polygon.
        counts: (P,) how many corners each polygon has; with less than three it has no area.

    Returns:
        (F, 3) vertex indices.
    """
    starts = np.cumsum(counts) - counts
    faces = [np.zeros((0, 3), np.int64)]
    for count in np.unique(counts[counts >= 3]).tolist():
        polygons = corners[starts[counts == count][:, None] + np.arange(count)]
        convex = _are_convex(vertices[polygons])
        for corner in range(1, count - 1):
            faces.append(polygons[convex][:, [0, corner, corner + 1]])
        for polygon in polygons[~convex]:
            faces.append(polygon[_ears(_flattened(vertices[polygon]))])
    return np.concatenate(faces)


def _are_convex(points: np.ndarray) -> np.ndarray:
    """Which of (P, K, 3) polygons never turn against their own normal."""
    edges = np.roll(points, -1, axis=1) - points
    turns = np.cross(np.roll(edges, 1, axis=1), edges)
    normals = _area_vectors(points)
    straight = _STRAIGHT * np.einsum("pi,pi->p", normals, normals)
    return (np.einsum("pki,pi->pk", turns, normals) >= -straight[:, None]).all(axis=1)


def _area_vectors(points: np.ndarray) -> np.ndarray:
    """(P, 3) normals of (P, K, 3) polygons, as long as twice their areas."""
    arms = points - points[:, :1]
    return np.cross(arms, np.roll(arms, -1, axis=1)).sum(axis=1)


def _flattened(points: np.ndarray) -> np.ndarray:
    """(K, 2) shadow of a (K, 3) polygon on the nearest coordinate plane, counter-clockwise."""
    normal = _area_vectors(points[None])[0]
    axis = int(np.abs(normal).argmax())
    flat = points[:, [(axis + 1) % 3, (axis + 2) % 3]]
    return flat if normal[axis] >= 0 else flat * [-1.0, 1.0]


def _ears(points: np.ndarray) -> np.ndarray:
    """(K - 2, 3) corners of the triangles of a counter-clockwise (K, 2) polygon."""
    left = list(range(len(points)))
    faces = []
    while len(left) > 3:
        # A polygon without ears crosses itself; going on anywhere is as good as anything.
        at = next((i for i in range(len(left)) if _is_ear(points[left], i)), 0)
        faces.append([left[at - 1], left[at], left[(at + 1) % len(left)]])
        del left[at]
    return np.array([*faces, left])


def _is_ear(points: np.ndarray, at: int) -> bool:
    """Whether a corner turns left and no other corner lies in its triangle."""
    corners = points[[at - 1, at, (at + 1) % len(points)]]
    sides = np.roll(corners, -1, axis=0) - corners
    if _cross(sides[0], sides[1]) <= 0:
        return False
    # Corners in the same place as one of the three are where a cut leads to a hole and back.
    others = points[~(points[:, None] == corners).all(axis=2).any(axis=1)]
    return not (_cross(sides, others[:, None] - corners) >= 0).all(axis=1).any()


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
