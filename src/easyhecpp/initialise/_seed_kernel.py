"""Fits and scores many seeds without leaving compiled code."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from easyhecpp.render._contour_kernel import contour_segments
from easyhecpp.render._jit import jit
from easyhecpp.render._raster_kernel import crossings, fill_coverage

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I32 = NDArray[np.int32]


@jit
def overlap(rendered: F32, observed: F32) -> tuple[float, float, float, float, float]:
    """Area and centroid x, y of ``rendered``, then area of intersection and of union."""
    area = 0.0
    mx = 0.0
    my = 0.0
    both = 0.0
    either = 0.0
    for y in range(rendered.shape[0]):
        row_area = 0.0
        for x in range(rendered.shape[1]):
            a = rendered[y, x]
            b = observed[y, x]
            row_area += a
            mx += a * x
            both += min(a, b)
            either += max(a, b)
        area += row_area
        my += row_area * y
    if area > 0.0:
        mx /= area
        my /= area
    return area, mx, my, both, either


@jit
def _turn(T: F64, ax: float, ay: float, bx: float, by: float) -> None:
    """Turn ``T`` in place by the smallest rotation that takes ray (ax, ay, 1) to (bx, by, 1)."""
    a = np.array([ax, ay, 1.0]) / np.sqrt(ax * ax + ay * ay + 1.0)
    b = np.array([bx, by, 1.0]) / np.sqrt(bx * bx + by * by + 1.0)
    v = np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
    c = 1.0 / (1.0 + a[0] * b[0] + a[1] * b[1] + a[2] * b[2])
    K = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    R = np.eye(3) + K + c * (K @ K)
    T[:3] = R @ T[:3]


@jit
def fit_seeds(
    seeds: F64,
    rounds: int,
    Ts_mount_link: F64,
    masks: F32,
    observed: F64,
    centre_mount: F64,
    vertices: F64,
    vertex_start: I32,
    boxes: F64,
    planes: F32,
    faces: I32,
    face_start: I32,
    edges: NDArray[np.uint32],
    edge_faces: NDArray[np.uint32],
    edge_start: I32,
    fc: F64,
    model: int,
    k: F64,
    valid_radius: float,
) -> F64:
    """Match position and size of every seed's masks to the observed ones.

    Args:
        seeds: ``(S, 4, 4)`` ``T_cam_mount``; replaced by the best pose that each came to.
        rounds: Corrections per seed.
        Ts_mount_link: ``(V, L, 4, 4)``.
        masks: ``(V, h, w)`` observed; ``observed`` ``(V, 3)`` their areas and centroids.
        centre_mount: ``(3,)`` the arm's middle.

    Returns:
        ``(S,)`` best mean IoU of each seed.
    """
    n_views, height, width = masks.shape
    n_links = Ts_mount_link.shape[1]
    outline = np.empty(edges.shape[0], np.int32)
    sides = np.empty(planes.shape[1] + 1, np.int8)
    capacity = 4 * edges.shape[0] + 64
    segments = np.empty((capacity, 4))
    ends = np.empty((capacity, 6))
    weights = np.empty(capacity, np.int32)
    links = np.empty(capacity, np.int32)
    coverage = np.empty((height, width), np.float32)
    Ts = np.empty((n_links, 4, 4))
    scores = np.full(seeds.shape[0], -1.0)
    for s in range(seeds.shape[0]):
        T = seeds[s].copy()
        for _round in range(rounds + 1):
            score = 0.0
            area, wanted_area = 0.0, 0.0
            rx, ry, wx, wy, total = 0.0, 0.0, 0.0, 0.0, 0.0
            for v in range(n_views):
                for link in range(n_links):
                    Ts[link] = T @ Ts_mount_link[v, link]
                n = contour_segments(
                    Ts, vertices, vertex_start, boxes, planes, faces, face_start, edges,
                    edge_faces, edge_start, fc, model, k, valid_radius, outline, sides,
                    segments, ends, weights, links,
                )  # fmt: skip
                # Under a strong lens right before the arm there may be no room: such a seed is
                # drawn in part, scores badly and is none to keep.
                n = min(n, capacity)
                start, found = crossings(n, segments, weights, height)
                coverage[:] = 0.0
                fill_coverage(start, found, coverage)
                seen, mx, my, both, either = overlap(coverage, masks[v])
                score += both / max(either, 1e-9) / n_views
                if seen > 1.0:
                    w = observed[v, 0]
                    area += seen
                    wanted_area += w
                    rx += w * mx
                    ry += w * my
                    wx += w * observed[v, 1]
                    wy += w * observed[v, 2]
                    total += w
            if score > scores[s]:
                scores[s] = score
                seeds[s] = T
            if total == 0.0:
                break
            # Turn by the offset of the centroids, then go nearer or farther. Distortion may be
            # left out here: it changes both centroids alike.
            _turn(
                T, (rx / total - fc[2]) / fc[0], (ry / total - fc[3]) / fc[1],
                (wx / total - fc[2]) / fc[0], (wy / total - fc[3]) / fc[1],
            )  # fmt: skip
            ratio = min(2.5, max(0.4, np.sqrt(area / wanted_area)))
            for i in range(3):
                middle = T[i, 3]
                for j in range(3):
                    middle += T[i, j] * centre_mount[j]
                T[i, 3] += middle * (ratio - 1.0)
    return scores
