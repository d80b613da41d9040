"""Masks compared with a rendered arm, and read along its contour (compiled).

Each is a few lines of numpy; but poses are optimised on thousands of small renderings, and their
overhead, which no second thread can share, was half of the time.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from easyhecpp.render._jit import jit

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]


@jit
def bilinear(image: F32, points: F64, left: float, top: float, out: F64) -> None:
    """Bilinear samples at pixel positions, clamped at the image's edge.

    Args:
        image: ``(H, W)``.
        points: ``(N, 2)``.
        left, top: Position of the image's first pixel.
        out: ``(N,)``.
    """
    height, width = image.shape
    for i in range(len(points)):
        x = min(max(points[i, 0] - left, 0.0), width - 1.0)
        y = min(max(points[i, 1] - top, 0.0), height - 1.0)
        x0, y0 = int(x), int(y)
        x1, y1 = min(x0 + 1, width - 1), min(y0 + 1, height - 1)
        u, v = x - x0, y - y0
        above = (1.0 - u) * image[y0, x0] + u * image[y0, x1]
        below = (1.0 - u) * image[y1, x0] + u * image[y1, x1]
        out[i] = (1.0 - v) * above + v * below


@jit
def covered_box(coverage: F32) -> tuple[int, int, int, int]:
    """First and last row and column of what is not zero; the last before the first if nothing is.

    Args:
        coverage: ``(H, W)``.
    """
    height, width = coverage.shape
    top, bottom, left, right = height, -1, width, -1
    for y in range(height):
        x = 0
        while x < width and coverage[y, x] == 0.0:
            x += 1
        if x == width:
            continue
        top = min(top, y)
        bottom = y
        left = min(left, x)
        x = width - 1
        while coverage[y, x] == 0.0:
            x -= 1
        right = max(right, x)
    return top, bottom, left, right


@jit
def compare(
    mask: F32, rendered: F32, usable: F32, top: int, left: int, cut: bool, difference: F32
) -> tuple[float, float, float, float]:
    """Observed against rendered mask, in a window.

    Args:
        mask, rendered: ``(H, W)``, 0..1.
        usable: ``(H, W)`` share of each pixel that counts; an empty array where all do.
        top, left: The window's first pixel.
        cut: Whether the rendered mask is cut at one half first.
        difference: Of the window's size, filled with mask minus rendered mask where that counts.

    Returns:
        Sum of the difference's squares; areas of both masks' intersection, of the rendered and of
        the observed mask, pixels.
    """
    height, width = difference.shape
    all_count = usable.shape[0] == 0
    squares, both, shown, seen = 0.0, 0.0, 0.0, 0.0
    for y in range(height):
        for x in range(width):
            m, r = mask[top + y, left + x], rendered[top + y, left + x]
            if cut:
                r = np.float32(1.0) if r > 0.5 else np.float32(0.0)
            both += min(m, r)
            shown += r
            seen += m
            d = m - r
            if not all_count:
                d *= usable[top + y, left + x]
            difference[y, x] = d
            squares += d * d
    return squares, both, shown, seen
