"""Summed variance of hard masks over camera hypotheses, without any pixels (compiled).

The unbiased variance of ``H`` hard masks of which ``c`` cover a point is ``c (H - c) / (H (H -
1))``. Its sum over the pixels of a large image is its integral, which is taken exactly along every
sample line: the ends of the covered spans of all masks are sorted along the line, and between two
of them ``c`` is constant. So a few dozen lines do what a million pixels would.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from easyhecpp.render._contour_kernel import contour_segments
from easyhecpp.render._jit import jit
from easyhecpp.render._raster_kernel import LINES, crossings, line_spans

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I32 = NDArray[np.int32]

_MOST_SPANS = 8
"""Ends of spans that a line and mask have room for at first; arms rarely have more than four."""


@jit
def _spread(ends: F64, n: int, n_masks: int) -> float:
    """Integral of ``c (H - c)`` along a line.

    Args:
        ends: ``(2, K)`` where spans begin (first row) and where they end, sorted here.
        n: Number of spans.
        n_masks: ``H``.
    """
    ends[0, :n].sort()
    ends[1, :n].sort()
    total, x = 0.0, 0.0
    begun, ended = 0, 0
    while ended < n:
        covered = begun - ended
        if begun < n and ends[0, begun] <= ends[1, ended]:
            at = ends[0, begun]
            begun += 1
        else:
            at = ends[1, ended]
            ended += 1
        total += covered * (n_masks - covered) * (at - x)
        x = at
    return total


@jit
def summed_variances(
    Ts_cam_mount: F64,
    Ts_mount_link: F64,
    width: int,
    height: int,
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
    """Scores of joint poses.

    Args:
        Ts_cam_mount: ``(H, 4, 4)`` hypotheses.
        Ts_mount_link: ``(N, L, 4, 4)`` joint poses.
        width, height: Of the picture that ``fc`` belongs to, pixels.

    Returns:
        ``(N,)`` integrals over the picture, in its pixels.
    """
    n_masks, n_links = Ts_cam_mount.shape[0], Ts_mount_link.shape[1]
    n_lines = height * LINES
    outline = np.empty(edges.shape[0], np.int32)
    sides = np.empty(planes.shape[1] + 1, np.int8)
    capacity = 4 * edges.shape[0] + 64
    segments = np.empty((capacity, 4))
    corners = np.empty((capacity, 6))
    weights = np.empty(capacity, np.int32)
    links = np.empty(capacity, np.int32)
    Ts = np.empty((n_links, 4, 4))
    room = n_masks * _MOST_SPANS
    ends = np.empty((n_lines, 2, room))
    counts = np.empty(n_lines, np.int64)
    own = np.empty(capacity)
    scores = np.empty(Ts_mount_link.shape[0])
    for pose in range(Ts_mount_link.shape[0]):
        counts[:] = 0
        for mask in range(n_masks):
            for link in range(n_links):
                Ts[link] = Ts_cam_mount[mask] @ Ts_mount_link[pose, link]
            n = contour_segments(
                Ts, vertices, vertex_start, boxes, planes, faces, face_start, edges, edge_faces,
                edge_start, fc, model, k, valid_radius, outline, sides,
                segments, corners, weights, links,
            )  # fmt: skip
            start, found = crossings(min(n, capacity), segments, weights, height)
            for line in range(n_lines):
                if start[line] == start[line + 1]:
                    continue
                written = line_spans(start, found, line, width, own)
                for i in range(0, min(written, 2 * (room - counts[line])), 2):
                    ends[line, 0, counts[line]] = own[i]
                    ends[line, 1, counts[line]] = own[i + 1]
                    counts[line] += 1
        total = 0.0
        for line in range(n_lines):
            if counts[line] > 0:
                total += _spread(ends[line], counts[line], n_masks)
        scores[pose] = total / (LINES * n_masks * (n_masks - 1))
    return scores
