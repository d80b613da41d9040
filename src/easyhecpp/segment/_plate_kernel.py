"""The background behind a view's contour, from the other views (compiled)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from easyhecpp.render._jit import jit

F32 = NDArray[np.float32]
U8 = NDArray[np.uint8]


@jit
def background_plate(values: F32, covered: U8, view: int, band: U8, noise: float, out: F32) -> None:
    """The background's colour behind a view's contour band; nan where no view shows it.

    Of the views without the arm at a pixel, the ones that agree with the third nearest to what the
    view itself shows are averaged: what moves in the background has several states, and the view
    shows one of them.

    Args:
        values: ``(V, H, W, 3)`` equalised pictures, 0..255.
        covered: ``(V, H, W)`` nonzero where a view shows the arm or may show it.
        view: The view.
        band: ``(H, W)`` nonzero where the plate is wanted.
        noise: Standard deviation of a channel.
        out: ``(H, W, 3)``.
    """
    n, height, width = covered.shape
    distance = np.empty(n)
    order = np.empty(n, np.int64)
    limit = 25.0 * 6.0 * noise * noise
    for y in range(height):
        for x in range(width):
            if band[y, x] == 0:
                continue
            count = 0
            for other in range(n):
                if other == view or covered[other, y, x] != 0:
                    continue
                d = 0.0
                for c in range(3):
                    e = values[view, y, x, c] - values[other, y, x, c]
                    d += e * e
                at = count
                while at > 0 and distance[at - 1] > d:
                    distance[at] = distance[at - 1]
                    order[at] = order[at - 1]
                    at -= 1
                distance[at] = d
                order[at] = other
                count += 1
            if count == 0:
                out[y, x, 0] = np.nan
                continue
            chosen = order[(count - 1) // 3]
            total = 0
            r, g, b = 0.0, 0.0, 0.0
            for i in range(count):
                other = order[i]
                d = 0.0
                for c in range(3):
                    e = values[chosen, y, x, c] - values[other, y, x, c]
                    d += e * e
                if d <= limit:
                    r += values[other, y, x, 0]
                    g += values[other, y, x, 1]
                    b += values[other, y, x, 2]
                    total += 1
            out[y, x, 0], out[y, x, 1], out[y, x, 2] = r / total, g / total, b / total
