"""Outlines of masks and of rendered arms as smooth lines, exact to a fraction of a pixel.

`cv2.findContours` walks along the centres of boundary pixels: in order, but half a pixel inside and
in stairs. Its chain is therefore moved onto the level line 0.5 of the slightly blurred mask, which
runs where the edge is.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

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


def outline(coverage: NDArray[Any]) -> list[F64]:
    """Lines between what is covered and what is not.

    Args:
        coverage: ``(H, W)`` bool, or float in [0, 1].

    Returns:
        Polylines ``(N, 2)`` in pixels (an integer is a pixel's centre), first point repeated at the
        end where a line closes. The image's own edge is not part of them; specks of a few pixels
        are left out.
    """
    field = np.ascontiguousarray(coverage, dtype=np.float32)
    inside = (field > 0.5).astype(np.uint8)
    chains, _ = cv2.findContours(inside, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    chains = [chain[:, 0] for chain in chains if len(chain) >= _MIN_POINTS]
    if not chains:
        return []
    smooth = cv2.GaussianBlur(field, (0, 0), _BLUR_PX, borderType=cv2.BORDER_REPLICATE)
    slope_x = cv2.Sobel(smooth, cv2.CV_32F, 1, 0, scale=0.125, borderType=cv2.BORDER_REPLICATE)
    slope_y = cv2.Sobel(smooth, cv2.CV_32F, 0, 1, scale=0.125, borderType=cv2.BORDER_REPLICATE)
    start = np.concatenate(chains)
    points, good = _settle(start.astype(np.float64), smooth, slope_x, slope_y)
    height, width = field.shape
    good &= ~np.any((start <= 0) | (start >= (width - 1, height - 1)), axis=1)
    lines: list[F64] = []
    ends = np.cumsum([len(chain) for chain in chains])[:-1]
    for line, usable in zip(np.split(points, ends), np.split(good, ends), strict=True):
        lines += _cut(line, usable)
    return lines


def simplify(lines: Sequence[F64], tolerance_px: float) -> list[F64]:
    """The lines with fewer points, moved by at most the tolerance."""
    found: list[F64] = []
    for line in lines:
        closed = bool((line[0] == line[-1]).all())
        thin = cv2.approxPolyDP(line.astype(np.float32)[:, None], tolerance_px, False)
        found.append(thin[:, 0].astype(np.float64))
        if closed:
            found[-1][-1] = found[-1][0]
    return found


def _settle(points: F64, smooth: F32, slope_x: F32, slope_y: F32) -> tuple[F64, NDArray[np.bool_]]:
    """Newton steps along the slope onto the level 0.5; and which points found it."""
    good = np.ones(len(points), bool)
    for _ in range(_STEPS):
        level, gx, gy = (_sample(image, points) for image in (smooth, slope_x, slope_y))
        square = gx**2 + gy**2
        good &= square > _FLAT**2
        move = (0.5 - level) / np.maximum(square, _FLAT**2)
        limit = _STEP_LIMIT_PX / np.maximum(np.abs(move) * np.sqrt(square), 1e-9)
        points = points + (move * np.minimum(1.0, limit))[:, None] * np.column_stack([gx, gy])
    return points, good


def _sample(image: F32, points: F64) -> F64:
    # remap takes at most 32767 rows, so long chains are folded.
    width = 1024
    padded = np.zeros((-(-len(points) // width) * width, 2), np.float32)
    padded[: len(points)] = points
    found = cv2.remap(
        image, padded.reshape(-1, width, 2), None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    return found.reshape(-1)[: len(points)].astype(np.float64)


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
