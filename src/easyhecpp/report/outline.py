"""Outlines of masks and of rendered arms as smooth lines, exact to a fraction of a pixel.

`cv2.findContours` walks along the centres of boundary pixels: in order, but half a pixel inside and
in stairs. Its chain is therefore moved onto the level line 0.5 of the slightly blurred mask, which
runs where the edge is.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

import cv2
import numpy as np
from numpy.typing import NDArray

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]

_BLUR_PX = 0.8
_STEPS = 2
_STEP_LIMIT_PX = 0.8
_FLAT = 0.05  # slope per pixel below which there is no edge to stand on; a blurred step has 0.5
_MIN_POINTS = 12
_MARGIN = 5  # around what is covered; more than the blur reaches


def outline(coverage: NDArray[Any]) -> list[F64]:
    """Lines between what is covered and what is not.

    Args:
        coverage: ``(H, W)`` bool, or float in [0, 1].

    Returns:
        Polylines ``(N, 2)`` in pixels (an integer is a pixel's centre), first point repeated at the
        end where a line closes. The image's own edge is not part of them; specks of a few pixels
        are left out.
    """
    height, width = coverage.shape
    inside = (np.asarray(coverage) > 0.5).astype(np.uint8)
    x, y, w, h = cv2.boundingRect(inside)
    left, top = max(0, x - _MARGIN), max(0, y - _MARGIN)
    window = slice(top, y + h + _MARGIN), slice(left, x + w + _MARGIN)
    chains, _ = cv2.findContours(inside[window], cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    chains = [chain[:, 0] for chain in chains if len(chain) >= _MIN_POINTS]
    if not chains:
        return []
    field = np.ascontiguousarray(coverage[window], dtype=np.float32)
    smooth = cast(F32, cv2.GaussianBlur(field, (0, 0), _BLUR_PX, borderType=cv2.BORDER_REPLICATE))
    start = np.concatenate(chains)
    points, good = _settle(start.astype(np.float64), smooth)
    corner = np.array([left, top])
    good &= ~np.any((start + corner <= 0) | (start + corner >= (width - 1, height - 1)), axis=1)
    ends = np.cumsum([len(chain) for chain in chains])[:-1]
    lines: list[F64] = []
    for line, usable in zip(np.split(points + corner, ends), np.split(good, ends), strict=True):
        lines += _cut(line, usable)
    return lines


def simplify(lines: Sequence[F64], tolerance_px: float) -> list[F64]:
    """The lines with fewer points, moved by about the tolerance."""
    found: list[F64] = []
    for line in lines:
        closed = bool((line[0] == line[-1]).all())
        thin = cv2.approxPolyDP(line.astype(np.float32)[:, None], tolerance_px, False)
        found.append(thin[:, 0].astype(np.float64))
        if closed:
            found[-1][-1] = found[-1][0]
    return found


def _settle(points: F64, smooth: F32) -> tuple[F64, NDArray[np.bool_]]:
    """Newton steps along the slope onto the level 0.5; and which points found it."""
    good = np.ones(len(points), bool)
    around = np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])
    for _ in range(_STEPS):
        level, right, left, down, up = _sample(smooth, points + around[:, None])
        slope = 0.5 * np.column_stack([right - left, down - up])
        steepness = np.linalg.norm(slope, axis=1)
        good &= steepness > _FLAT
        way = (0.5 - level) / np.maximum(steepness, _FLAT)
        way = np.clip(way, -_STEP_LIMIT_PX, _STEP_LIMIT_PX)
        points = points + slope * (way / np.maximum(steepness, _FLAT))[:, None]
    return points, good


def _sample(image: F32, points: F64) -> F64:
    """Bilinear samples at ``(K, N, 2)`` pixels: ``(K, N)``."""
    # remap takes at most 32767 rows or columns, so long chains are folded.
    width, count = 1024, points[..., 0].size
    padded = np.zeros((-(-count // width) * width, 2), np.float32)
    padded[:count] = points.reshape(-1, 2)
    xy = padded.reshape(-1, width, 2)
    found = cv2.remap(
        image, xy[..., 0], xy[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    return found.reshape(-1)[:count].reshape(points.shape[:2]).astype(np.float64)


def _cut(line: F64, usable: NDArray[np.bool_]) -> list[F64]:
    """Split a closed chain where points are not usable; close it where all are."""
    if usable.all():
        return [np.vstack([line, line[:1]])]
    if not usable.any():
        return []
    # Start at a gap, so that no piece runs across the chain's seam.
    first = int(np.flatnonzero(~usable)[0])
    line, usable = np.roll(line, -first, axis=0), np.roll(usable, -first)
    edges = np.flatnonzero(np.diff(usable.astype(np.int8), prepend=0, append=0))
    return [line[a:b] for a, b in edges.reshape(-1, 2) if b - a > 2]
