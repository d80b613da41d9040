"""How far two triangle surfaces are apart, measured on samples that close in on the worst."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from scipy.spatial import KDTree

# How many samples a surface gets, before its corners and edges are added.
_SAMPLES = 6000
# Points whose distances are made exact at a time.
_AT_ONCE = 64
# Nearest samples whose triangles bound the distance of a point that may be the farthest.
_NEIGHBOURS = 16
# Triangles that share one box, the first that a point is compared with.
_BLOCK = 32
# Samples on each of the triangles that hold the worst places.
_CLOSE_UP = 64


class Surface:
    """A triangle surface, sampled.

    Args:
        vertices: (V, 3) metres.
        faces: (F, 3), at least one.
        spacing: metres between samples; `natural_spacing` suits.
    """

    def __init__(self, vertices: np.ndarray, faces: np.ndarray, spacing: float) -> None:
        corners = vertices[faces]
        self._corners = corners[_neighbours_together(corners.mean(axis=1))]
        self._spacing = spacing

    @property
    def points(self) -> np.ndarray:
        """(N, 3) points to measure from: all corners, and edges and insides thinned out."""
        return self._points[0]

    def close_up(self, indices: np.ndarray) -> np.ndarray:
        """(M, 3) many more points on the triangles on which some of the `points` lie."""
        triangles = np.unique(self._points[1][indices])
        counts = np.full(len(triangles), _CLOSE_UP)
        return _points_inside(self._corners[triangles], counts)[0]

    def farthest(self, points: np.ndarray, enough: float = np.inf) -> tuple[float, np.ndarray]:
        """Largest distance in metres from any of the points (N, 3) to this surface.

        The sample nearest to a point names a triangle, whose distance is an upper bound. Then only
        the points that could still be the farthest are compared with all triangles near them.

        Args:
            points: (N, 3).
            enough: metres; the search may stop once it has found a distance above this.

        Returns:
            The distance, and the indices of the worst points, the first ones of them for certain.
        """
        bounds = self._upper_bounds(points, neighbours=1)
        order = np.argsort(-bounds)[:_AT_ONCE]
        farthest = self._make_exact(points, bounds, order)
        left = np.flatnonzero(bounds > farthest)
        if farthest <= enough**2 and len(left):
            bounds[left] = self._upper_bounds(points[left], neighbours=_NEIGHBOURS)
            left = left[np.argsort(-bounds[left])]
        while len(left) and bounds[left[0]] > farthest and farthest <= enough**2:
            farthest = max(farthest, self._make_exact(points, bounds, left[:_AT_ONCE]))
            left = left[_AT_ONCE:]
        return float(np.sqrt(farthest)), np.argsort(-bounds)[:_AT_ONCE]

    def _upper_bounds(self, points: np.ndarray, neighbours: int) -> np.ndarray:
        """Upper bounds (N,) of squared distances, from the triangles of the nearest samples."""
        tree, owners = self._tree
        k = min(neighbours, len(owners))
        triangles = owners[tree.query(points, k=k)[1]].reshape(len(points), k)
        return squared_distances(points[:, None], self._corners[triangles]).min(axis=1)

    def _make_exact(self, points: np.ndarray, bounds: np.ndarray, indices: np.ndarray) -> float:
        """Turn some upper bounds of squared distances into exact ones; returns the largest."""
        low, high, block_low, block_high = self._boxes
        chosen, reach = points[indices], bounds[indices]
        near = _to_boxes(chosen[:, None], block_low, block_high) < reach[:, None]
        rows, blocks = np.nonzero(near)
        triangles = (blocks[:, None] * _BLOCK + np.arange(_BLOCK)).ravel()
        rows = np.repeat(rows, _BLOCK)
        rows, triangles = rows[triangles < len(low)], triangles[triangles < len(low)]
        near = _to_boxes(chosen[rows], low[triangles], high[triangles]) < reach[rows]
        rows, triangles = rows[near], triangles[near]
        squared = squared_distances(points[indices[rows]], self._corners[triangles])
        np.minimum.at(bounds, indices[rows], squared)
        return float(bounds[indices].max())

    @cached_property
    def _boxes(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Low and high corners of each triangle's box, and of each block of triangles."""
        low, high = self._corners.min(axis=1), self._corners.max(axis=1)
        starts = np.arange(0, len(low), _BLOCK)
        return low, high, np.minimum.reduceat(low, starts), np.maximum.reduceat(high, starts)

    @cached_property
    def _tree(self) -> tuple[KDTree, np.ndarray]:
        points, owners = self._inside
        return KDTree(points, balanced_tree=False, compact_nodes=False), owners

    @cached_property
    def _points(self) -> tuple[np.ndarray, np.ndarray]:
        """`points`, and the triangle on which each lies."""
        pieces = [self._inside, *(self._along_edge(i) for i in range(3))]
        points, owners = (np.concatenate(arrays) for arrays in zip(*pieces, strict=True))
        cells = np.floor((points - points.min(axis=0)) / (self._spacing / 2)).astype(np.int64)
        keys = (cells[:, 0] << 42) | (cells[:, 1] << 21) | cells[:, 2]
        kept = np.unique(keys, return_index=True)[1]
        # Corners are where the farthest points mostly are: none may be thinned out.
        corners, first = np.unique(self._corners.reshape(-1, 3), axis=0, return_index=True)
        return np.concatenate([corners, points[kept]]), np.concatenate([first // 3, owners[kept]])

    @cached_property
    def _inside(self) -> tuple[np.ndarray, np.ndarray]:
        """Points inside every triangle, long thin ones too, and the triangle of each."""
        a, b, c = np.moveaxis(self._corners, 1, 0)
        longest = self._edge_lengths.max(axis=1)
        heights = np.linalg.norm(np.cross(b - a, c - a), axis=1) / np.maximum(longest, 1e-300)
        cells = np.ceil(longest / self._spacing) * np.ceil(heights / self._spacing)
        return _points_inside(self._corners, np.ceil((cells + 1) / 2).astype(int))

    def _along_edge(self, i: int) -> tuple[np.ndarray, np.ndarray]:
        """Points on the i-th edges, corners left out, and the triangle of each."""
        counts = np.ceil(self._edge_lengths[:, i] / self._spacing).astype(int) - 1
        owner, rank = _expand(np.maximum(counts, 0))
        t = ((rank + 1) / (counts[owner] + 1))[:, None]
        start, end = self._corners[owner, i], self._corners[owner, (i + 1) % 3]
        return (1 - t) * start + t * end, owner

    @cached_property
    def _edge_lengths(self) -> np.ndarray:
        return np.linalg.norm(self._corners - np.roll(self._corners, -1, axis=1), axis=2)


def hausdorff(a: Surface, b: Surface, enough: float = np.inf) -> float:
    """Two-sided distance in metres: the farthest that a point of either lies from the other.

    The picture of a point moves no more than the point does, so this bounds how far a silhouette
    of one surface can lie from that of the other, taken at the surface's depth. Above `enough` the
    answer may be too small, but stays above `enough`.
    """
    there = _one_sided(a, b, enough)
    return there if there > enough else max(there, _one_sided(b, a, enough))


def _one_sided(a: Surface, b: Surface, enough: float) -> float:
    """Farthest that a point of `a` lies from `b`, the neighbourhood of the worst searched again."""
    distance, worst = b.farthest(a.points, enough)
    return distance if distance > enough else max(distance, b.farthest(a.close_up(worst))[0])


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


def _to_boxes(points: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Squared distances of points (..., 3) to boxes (..., 3), shapes broadcast."""
    gaps = np.maximum(np.maximum(low - points, points - high), 0.0)
    return _dot(gaps, gaps)


def _to_segment(ap: np.ndarray, ab: np.ndarray) -> np.ndarray:
    t = np.clip(_dot(ap, ab) / np.maximum(_dot(ab, ab), 1e-300), 0.0, 1.0)
    gap = ap - t[..., None] * ab
    return _dot(gap, gap)


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.einsum("...i,...i->...", a, b)


def _neighbours_together(points: np.ndarray) -> np.ndarray:
    """(N,) an order in which points (N, 3) near each other mostly follow each other."""
    low, size = points.min(axis=0), max(float(np.ptp(points, axis=0).max()), 1e-12)
    per_axis = max(np.cbrt(len(points)), 1.0)
    cells = np.floor((points - low) * (per_axis / size)).astype(np.int64)
    return np.argsort((cells[:, 0] << 42) | (cells[:, 1] << 21) | cells[:, 2], kind="stable")


def _points_inside(corners: np.ndarray, counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Evenly spread points in triangles (T, 3, 3), and the triangle of each."""
    owner, rank = _expand(counts)
    # The R2 sequence of Roberts (2018) fills the unit square evenly; folded, the triangle.
    s, t = np.modf(0.3 + rank * np.array([[0.7548776662466927], [0.5698402909980532]]))[0]
    folded = s + t > 1
    s, t = np.where(folded, 1 - s, s)[:, None], np.where(folded, 1 - t, t)[:, None]
    a, b, c = np.moveaxis(corners[owner], 1, 0)
    return (1 - s - t) * a + s * b + t * c, owner


def _expand(counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """For counts [2, 0, 1]: owners [0, 0, 2] and ranks [0, 1, 0]."""
    owner = np.repeat(np.arange(len(counts)), counts)
    return owner, np.arange(len(owner)) - (np.cumsum(counts) - counts)[owner]
