"""The triangle mesh of one link, welded, with the adjacency that silhouettes are made of."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import ConvexHull, QhullError

# Vertices closer than the mesh's extent divided by this are one vertex: 0.5 um on a 1 m link.
_WELD_STEPS = 2**21 - 1


@dataclass(frozen=True, eq=False)
class LinkMesh:
    """Triangles of one link in the link's own frame; all arrays are read-only.

    `edges[e]` runs in the direction in which face `edge_faces[e, 0]` walks round; face
    `edge_faces[e, 1]` walks it the other way. So every half-edge of every face stands in exactly
    one row, and summing signed contour edges over any set of faces is exact, also where more than
    two faces meet or where windings disagree.

    Attributes:
        vertices: (V, 3) float64 metres.
        faces: (F, 3) int32, winding as in the source, no degenerate faces.
        face_planes: (F, 4) float64 unit normal n and offset d, n . x = d.
        edges: (E, 2) int32 vertex indices.
        edge_faces: (E, 2) int32; the second is -1 on an open boundary.
        error: metres by which the surface may differ from the true shape because it was
            tessellated or simplified; 0 for a mesh taken as it is.
    """

    vertices: np.ndarray
    faces: np.ndarray
    face_planes: np.ndarray
    edges: np.ndarray
    edge_faces: np.ndarray
    error: float = 0.0

    @classmethod
    def from_triangles(
        cls, vertices: np.ndarray, faces: np.ndarray, *, error: float = 0.0
    ) -> LinkMesh:
        """Weld vertices, drop degenerate faces and find the adjacency.

        Args:
            vertices: (V, 3) metres.
            faces: (F, 3) vertex indices.
            error: see the class.

        Returns:
            The mesh; it has no faces when all given ones are degenerate.
        """
        vertices, faces = _weld(np.asarray(vertices, np.float64), np.asarray(faces))
        corners = vertices[faces]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        lengths = np.linalg.norm(normals, axis=1)
        keep = lengths > 1e-12 * np.ptp(vertices, axis=0).max(initial=0.0) ** 2
        faces, normals = faces[keep], normals[keep] / lengths[keep, None]
        vertices, faces = _drop_unused(vertices, faces)
        offsets = np.einsum("ij,ij->i", normals, vertices[faces[:, 0]])
        edges, edge_faces = _adjacency(faces)
        arrays = (
            vertices,
            faces.astype(np.int32),
            np.column_stack([normals, offsets]),
            edges,
            edge_faces,
        )
        for array in arrays:
            array.setflags(write=False)
        return cls(*arrays, error=error)

    @cached_property
    def area(self) -> float:
        """Surface area, square metres."""
        return float(self._face_areas.sum())

    @cached_property
    def centroid(self) -> np.ndarray:
        """(3,) area-weighted centroid of the surface, link frame."""
        middles = self.vertices[self.faces].mean(axis=1)
        return self._face_areas @ middles / self.area

    @property
    def hull_volume(self) -> float:
        """Volume of the convex hull, cubic metres."""
        return self._hull[0]

    @property
    def hull_centroid(self) -> np.ndarray:
        """(3,) middle of the convex hull's volume, link frame; of a flat mesh that of its faces."""
        return self._hull[1]

    @cached_property
    def _hull(self) -> tuple[float, np.ndarray]:
        try:
            hull = ConvexHull(self.vertices)
        except QhullError:
            return 0.0, self.centroid
        inside = self.vertices[hull.vertices].mean(axis=0)
        corners = self.vertices[hull.simplices] - inside
        volumes = np.abs(np.linalg.det(corners)) / 6.0
        return float(hull.volume), inside + volumes @ corners.mean(axis=1) * 0.75 / volumes.sum()

    @property
    def n_open_edges(self) -> int:
        """Number of edges with a face on one side only; 0 for a closed surface."""
        return int((self.edge_faces[:, 1] < 0).sum())

    @property
    def _face_areas(self) -> np.ndarray:
        a, b, c = np.moveaxis(self.vertices[self.faces], 1, 0)
        return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)


def _weld(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Merge vertices that lie in one cell of a fine grid; faces that collapse are dropped."""
    low = vertices.min(axis=0, initial=np.inf)
    step = max(float(np.ptp(vertices, axis=0).max(initial=0.0)), 1e-9) / _WELD_STEPS
    cells = np.rint((vertices - low) / step).astype(np.int64)
    keys = (cells[:, 0] << 42) | (cells[:, 1] << 21) | cells[:, 2]
    _, first, index = np.unique(keys, return_index=True, return_inverse=True)
    faces = index.astype(np.int32)[faces]
    a, b, c = faces.T
    return vertices[first], faces[(a != b) & (b != c) & (c != a)]


def _drop_unused(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    used = np.zeros(len(vertices), bool)
    used[faces] = True
    new_index = np.cumsum(used) - 1
    return vertices[used], new_index[faces]


def _adjacency(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pair half-edges that run in opposite directions between the same two vertices.

    Returns:
        edges (E, 2) and edge_faces (E, 2), int32, as `LinkMesh` describes them.
    """
    half = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).astype(np.int64)
    owner = np.repeat(np.arange(len(faces)), 3)
    backward = half[:, 0] > half[:, 1]
    low, high = np.sort(half, axis=1).T
    key = (low << 32) | high

    # Within each group of equal keys, the i-th forward half-edge meets the i-th backward one.
    order = np.lexsort((backward, key))
    key, backward, half, owner = key[order], backward[order], half[order], owner[order]
    starts = np.flatnonzero(np.r_[True, key[1:] != key[:-1]]) if len(key) else np.zeros(0, int)
    group = np.repeat(np.arange(len(starts)), np.diff(np.r_[starts, len(key)]))
    n_forward = np.bincount(group, ~backward, minlength=len(starts)).astype(int)
    rank = np.arange(len(key)) - starts[group] - np.where(backward, n_forward[group], 0)
    n_backward = np.bincount(group, backward, minlength=len(starts)).astype(int)
    paired = rank < np.minimum(n_forward, n_backward)[group]

    first = paired & ~backward
    partner = np.flatnonzero(first) + n_forward[group[first]]
    alone = ~paired
    edges = np.concatenate([half[first], half[alone]])
    edge_faces = np.concatenate(
        [
            np.column_stack([owner[first], owner[partner]]),
            np.column_stack([owner[alone], np.full(alone.sum(), -1)]),
        ]
    )
    return edges.astype(np.int32), edge_faces.astype(np.int32)
