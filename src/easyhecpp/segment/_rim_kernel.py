"""Where the arm's rim lies on a line across its contour (compiled); see `edge_rim`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from easyhecpp.render._jit import jit

F64 = NDArray[np.float64]

STEP = 0.5
"""Distance of the samples along a normal, pixels."""

WITHIN, BEYOND = 4, 6
"""Samples inside and outside of the steepest rise that a rim is fitted to."""

_NEAREST = 0.25
"""Displacement from the steepest rise that a rim may always have, pixels."""

_STEEPNESS = 2
"""Samples to either side over which the steepness of a rim is measured: a pixel."""


@jit
def _height_over_steepness(light: F64, at: int) -> float:
    """Samples that a colour signal would take to fall to nothing, at its slope at an index."""
    rise, height = 0.0, 0.0
    for c in range(3):
        d = light[at - _STEEPNESS, c] - light[at + _STEEPNESS, c]
        rise += d * d
        height += d * light[at, c]
    return 2.0 * _STEEPNESS * height / max(rise, 1e-12)


@jit
def locate_rim(
    light: F64, at: int, shifts: F64, explains: F64, step_width: float, found: F64
) -> bool:
    """Where a surface that starts with a step and a ramp best explains the light about an edge.

    Args:
        light: ``(N, 3)`` difference to the background in linear light, inside first.
        at: Index of its steepest rise.
        shifts: ``(G,)`` outward displacements from there that are tried, pixels, even steps.
        explains: ``(G, 2, T)`` what step and ramp explain at each, from `WITHIN` inside outwards.
        step_width: Height over steepness of a mere step, pixels.
        found: ``(2,)`` output: the displacement, and the share of the light left unexplained.

    Returns:
        Whether the best of the displacements is none at either end.
    """
    count, _, taps = explains.shape
    first = at - WITHIN
    # No farther out than half as far again as its slope would take it to nothing.
    largest = max(1.5 * _height_over_steepness(light, at) * STEP - step_width, _NEAREST)
    total = 0.0
    for t in range(taps):
        for c in range(3):
            total += light[first + t, c] * light[first + t, c]
    if total <= 0.0:
        return False
    misfit = np.empty(count)
    best = -1
    for g in range(count):
        explained = 0.0
        for c in range(3):
            for k in range(2):
                v = 0.0
                for t in range(taps):
                    v += explains[g, k, t] * light[first + t, c]
                explained += v * v
        misfit[g] = total - explained
        if shifts[g] <= largest and (best < 0 or misfit[g] < misfit[best]):
            best = g
    if best < 1 or best > count - 2:
        return False
    a, b, c2 = misfit[best - 1], misfit[best], misfit[best + 1]
    curvature = a - 2.0 * b + c2
    step = 0.0
    if curvature > 1e-12 * total and a >= b and c2 >= b:
        step = 0.5 * (a - c2) / curvature
    found[0] = shifts[best] + step * (shifts[1] - shifts[0])
    found[1] = b / total
    return True
