"""Remove sampling noise from a path-traced picture without moving its edges.

Non-local means between two independent halves of the samples (Rousselle, Knaus and Zwicker,
"Adaptive rendering with non-local means filtering", 2012): weights found in one half average the
other, so noise does not vote for itself, and the difference of the halves says how much of what
is seen is noise. Pixels on an edge are only averaged with pixels that look like the same edge.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from easyhecpp._parallel import parallel_map
from easyhecpp.render._jit import jit

F32 = NDArray[np.float32]

# All neighbours within two pixels, then a sparser ring: reach without the cost of a full window.
_NEAR = [(y, x) for y in range(-2, 3) for x in range(-2, 3)]
_RING = [(round(5 * np.sin(a)), round(5 * np.cos(a))) for a in np.arange(12) * np.pi / 6]
_OFFSETS = np.array(_NEAR + _RING + [(y * 3, x * 3) for y in (-1, 1) for x in (-1, 1)], np.int64)


@jit
def _weighted_sum(
    guide: F32, variance: F32, values: F32, offsets: NDArray[np.int64], strength: float
) -> F32:
    """Average ``values`` with weights from 3 x 3 patches of ``guide``."""
    tolerance = np.float32(strength)  # a double would make all that follows double
    rows, columns = guide.shape[:2]
    total = np.zeros((rows, columns, 3), np.float32)
    weight = np.zeros((rows, columns), np.float32)
    distance = np.zeros((rows, columns), np.float32)
    for k in range(offsets.shape[0]):
        dy, dx = offsets[k, 0], offsets[k, 1]
        y0, y1 = max(0, -dy), min(rows, rows - dy)
        x0, x1 = max(0, -dx), min(columns, columns - dx)
        for y in range(y0, y1):
            for x in range(x0, x1):
                d = np.float32(0.0)
                for c in range(3):
                    v, u = variance[y, x, c], variance[y + dy, x + dx, c]
                    step = guide[y, x, c] - guide[y + dy, x + dx, c]
                    noise = v + min(v, u)
                    d += (step * step - noise) / (np.float32(1e-6) + tolerance * (v + u))
                distance[y, x] = d
        for y in range(y0 + 1, y1 - 1):
            for x in range(x0 + 1, x1 - 1):
                d = np.float32(0.0)
                for j in range(-1, 2):
                    d += distance[y + j, x - 1] + distance[y + j, x] + distance[y + j, x + 1]
                w = np.exp(-max(np.float32(0.0), d / np.float32(27.0)))
                weight[y, x] += w
                for c in range(3):
                    total[y, x, c] += w * values[y + dy, x + dx, c]
    for y in range(rows):
        for x in range(columns):
            for c in range(3):
                if weight[y, x] > 0.0:
                    total[y, x, c] /= weight[y, x]
                else:
                    total[y, x, c] = values[y, x, c]
    return total


def denoised(first: F32, second: F32, *, strength: float = 0.4) -> F32:
    """Average two pictures of the same scene that were sampled independently.

    Args:
        first: (H, W, 3) float32 linear radiance.
        second: likewise, other random numbers.
        strength: tolerance for differences, in variances.

    Returns:
        (H, W, 3) float32.
    """
    first, second = _without_sparks(first, second), _without_sparks(second, first)
    level = np.float32(max(float(np.median(first)), 1e-6))
    guides = [np.sqrt(picture / level) for picture in (first, second)]
    # The variance of one half; single differences are as noisy as noise gets, hence the blur.
    variance = np.asarray(cv2.blur(0.5 * (guides[0] - guides[1]) ** 2, (5, 5)), np.float32)
    a, b = parallel_map(
        lambda pair: _weighted_sum(pair[0], variance, pair[1], _OFFSETS, strength),
        [(guides[0], second), (guides[1], first)],
    )
    return 0.5 * (a + b)


def _without_sparks(picture: F32, other: F32) -> F32:
    """Limit single bright samples to what the other half saw next to them."""
    return np.minimum(picture, 1.5 * cv2.dilate(other, np.ones((3, 3), np.uint8)) + 0.02)
