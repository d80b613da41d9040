"""How far two triangle surfaces are apart, measured on dense samples."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

# How many samples a surface gets, before its corners and edges are added.
_SAMPLES = 4000
# Points whose distances are made exact at a time.
_AT_ONCE = 64
# Nearest samples whose triangles bound the distance of a point that may be the farthest.
_NEIGHBOURS = 16


class Surface:
    """A triangle surface, sampled.

    Args:
        vertices: (V, 3) metres.
        faces: (F, 3), at least one.
        spacing: metres between samples; `natural_spacing` suits.
    """

    def __init__(self, vertices: np.ndarray, faces: np.ndarray, spacing: float) -> None:
        self._corners = vertices[faces]
        self._vertices = vertices
        self._spacing = spacing

    @cached_property
    def points(self) -> np.ndarray:
        """(N, 3) points to measure from: corners, edges and insides, thinned to the spacing."""
        inside, _ = self._inside
        points = np.concatenate([self._vertices, self._edge_points(), inside])
        cells = np.floor((points - points.min(axis=0)) / (self._spacing / 2)).astype(np.int64)
        keys = (cells[:, 0] << 42) | (cells[:, 1] << 21) | cells[:, 2]
        return points[np.unique(keys, return_index=True)[1]]

    def farthest(self, points: np.ndarray, enough: float = np.inf) -> float:
        """Largest distance in metres from any of the points (N, 3) to this surface.

        The sample nearest to a point names a triangle, whose distance is an upper bound. Then only
        the points that could still be the farthest are compared with all triangles near them.

        Args:
            points: (N, 3).
            enough: metres; the search may stop once it has found a distance above this.
        """
        bounds = self._upper_bounds(points, neighbours=1)
        worst = np.argsort(-bounds)[:_AT_ONCE]
        farthest = self._exact(points[worst], bounds[worst]).max()
        points = points[bounds > farthest]
        if len(points) == 0 or farthest > enough**2:
            return float(np.sqrt(farthest))
        bounds = self._upper_bounds(points, neighbours=_NEIGHBOURS)
        order = np.argsort(-bounds)
        for start in range(0, len(order), _AT_ONCE):
            worst = order[start : start + _AT_ONCE]
            if bounds[worst[0]] <= farthest or farthest > enough**2:
                break
            farthest = max(farthest, self._exact(points[worst], bounds[worst]).max())
        return float(np.sqrt(farthest))

    def _upper_bounds(self, points: np.ndarray, neighbours: int) -> np.ndarray:
        """Upper bounds (N,) of squared distances, from the triangles of the nearest samples."""
        tree, owners = self._tree
        k = min(neighbours, len(owners))
        triangles = owners[tree.query(points, k=k)[1]].reshape(len(points), k)
        return squared_distances(points[:, None], self._corners[triangles]).min(axis=1)

    def _exact(self, points: np.ndarray, bounds: np.ndarray) -> np.ndarray:
        """Exact squared distances (N,) of points (N, 3), given upper bounds of them (N,)."""
        low, high = self._boxes
        gaps = np.maximum(np.maximum(low - points[:, None], points[:, None] - high), 0.0)
        rows, triangles = np.nonzero(_dot(gaps, gaps) < bounds[:, None])
        exact = bounds.copy()
        squared = squared_distances(points[rows], self._corners[triangles])
        np.minimum.at(exact, rows, squared)
        return exact

    @cached_property
    def _boxes(self) -> tuple[np.ndarray, np.ndarray]:
        return self._corners.min(axis=1), self._corners.max(axis=1)

    @cached_property
    def _tree(self) -> tuple[cKDTree, np.ndarray]:
        points, owners = self._inside
        return cKDTree(points, balanced_tree=False, compact_nodes=False), owners

    @cached_property
    def _inside(self) -> tuple[np.ndarray, np.ndarray]:
        """Points inside every triangle, long thin ones too, and the triangle of each."""
        a, b, c = np.moveaxis(self._corners, 1, 0)
        longest = self._edge_lengths.max(axis=1)
        heights = np.linalg.norm(np.cross(b - a, c - a), axis=1) / np.maximum(longest, 1e-300)
        rows = np.ceil(longest / self._spacing) * np.ceil(heights / self._spacing)
        owner, rank = _expand(np.ceil((rows + 1) / 2).astype(int))
        # The R2 sequence of Roberts (2018) fills the unit square evenly; folded, the triangle.
        s, t = np.modf(0.3 + rank * np.array([[0.7548776662466927], [0.5698402909980532]]))[0]
        folded = s + t > 1
        s, t = np.where(folded, 1 - s, s)[:, None], np.where(folded, 1 - t, t)[:, None]
        return (1 - s - t) * a[owner] + s * b[owner] + t * c[owner], owner

    def _edge_points(self) -> np.ndarray:
        pieces = []
        for i in range(3):
            counts = np.ceil(self._edge_lengths[:, i] / self._spacing).astype(int) - 1
            owner, rank = _expand(np.maximum(counts, 0))
            t = ((rank + 1) / (counts[owner] + 1))[:, None]
            start, end = self._corners[owner, i], self._corners[owner, (i + 1) % 3]
            pieces.append((1 - t) * start + t * end)
        return np.concatenate(pieces)

    @cached_property
    def _edge_lengths(self) -> np.ndarray:
        return np.linalg.norm(self._corners - np.roll(self._corners, -1, axis=1), axis=2)


def hausdorff(a: Surface, b: Surface, enough: float = np.inf) -> float:
    """Two-sided distance in metres: the farthest that a sample of either lies from the other.

    Above `enough` the answer may be too small, but stays above `enough`.

    The picture of a point moves no more than the point does, so this bounds how far a silhouette
    of one surface can lie from that of the other, taken at the surface's depth.
    """
    there = a.farthest(b.points, enough)
    return there if there > enough else max(there, b.farthest(a.points, enough))


def natural_spacing(area: float) -> float:
    """Spacing in metres that gives a surface of `area` square metres some thousand samples."""
    return float(np.sqrt(area / _SAMPLES))


def squared_distances(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Exact squared distances of points (..., 3) to triangles (..., 3, 3), shapes broadcast.

    Over the inside of a triangle it is the height, elsewhere the distance of the nearest edge.
    """
    a, b, c = np.moveaxis(triangles, -2, 0)
    ab, ac, ap = b - a, c - a, points - a
    d00, d01, d11 = _dot(ab, ab), _dot(ab, ac), _dot(ac, ac)
    d20, d21 = _dot(ap, ab), _dot(ap, ac)
    area = d00 * d11 - d01 * d01
    flat = area <= 1e-12 * d00 * d11
    area = np.where(flat, 1.0, area)
    # Barycentric coordinates of the foot of the perpendicular.
    v = (d11 * d20 - d01 * d21) / area
    w = (d00 * d21 - d01 * d20) / area
    inside = (v >= 0) & (w >= 0) & (v + w <= 1) & ~flat
    gap = ap - v[..., None] * ab - w[..., None] * ac
    edges = np.minimum(_to_segment(ap, ab), _to_segment(ap, ac))
    edges = np.minimum(edges, _to_segment(points - b, c - b))
    return np.where(inside, _dot(gap, gap), edges)


def _to_segment(ap: np.ndarray, ab: np.ndarray) -> np.ndarray:
    t = np.clip(_dot(ap, ab) / np.maximum(_dot(ab, ab), 1e-300), 0.0, 1.0)
    gap = ap - t[..., None] * ab
    return _dot(gap, gap)


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.einsum("...i,...i->...", a, b)


def _expand(counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """For counts [2, 0, 1]: owners [0, 0, 2] and ranks [0, 1, 0]."""
    owner = np.repeat(np.arange(len(counts)), counts)
    return owner, np.arange(len(owner)) - (np.cumsum(counts) - counts)[owner]
