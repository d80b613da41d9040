"""Where along its normal does the contour lie? Evidence of a region, read along a line (compiled).

Moving a contour sample outward by ``d`` adds the pixels of the line between to the arm. With
evidence (log-odds of arm against background) per pixel, the log-likelihood of ``d`` is the running
sum, and its posterior over all ``d`` tells both the displacement and how sure it is.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from easyhecpp.render._jit import jit

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]

_FEWEST_PX = 3
"""A line that is cut shorter than this to either side says nothing."""


@jit
def _bilinear(image: F32, x: float, y: float) -> float:
    """Bilinear sample; nan outside of the image or next to an unknown pixel."""
    height, width = image.shape
    if x < 0.0 or y < 0.0 or x > width - 1.0 or y > height - 1.0:
        return np.nan
    ix, iy = min(int(x), width - 2), min(int(y), height - 2)
    fx, fy = x - ix, y - iy
    top = image[iy, ix] * (1.0 - fx) + image[iy, ix + 1] * fx
    bottom = image[iy + 1, ix] * (1.0 - fx) + image[iy + 1, ix + 1] * fx
    return top * (1.0 - fy) + bottom * fy


@jit
def line_posteriors(
    evidence: F32,
    coverage: F32,
    points: F64,
    normals: F64,
    reach: int,
    strength: float,
    sigma: float,
    bracketed: bool,
    mean: F64,
    weight: F64,
) -> None:
    """Displacement of every contour sample along its normal, pixels.

    A line ends where it leaves the image or the known pixels, where going outward it meets another
    part of the arm, and where going inward it comes out on the arm's other side; the opposite half
    is cut to the same length, as an uneven line would draw the posterior to its longer side.

    Args:
        evidence: ``(H, W)`` log-odds of arm against background, nan where unknown.
        coverage: ``(H, W)`` rendered at the present pose.
        points, normals: ``(N, 2)``.
        reach: Largest displacement looked at, pixels.
        strength: Factor on the evidence; neighbouring pixels are not independent.
        sigma: Standard deviation of the displacement before looking, pixels.
        bracketed: Whether a line counts only when it sees arm and background, so that its most
            likely place is not one of its ends.
        mean, weight: ``(N,)`` output: displacement and its information (1 / variance) without
            what was assumed before; weight 0 where nothing is known.
    """
    values = np.empty(2 * reach)
    log_p = np.empty(2 * reach + 1)
    for s in range(points.shape[0]):
        x, y, nx, ny = points[s, 0], points[s, 1], normals[s, 0], normals[s, 1]
        half = reach
        for k in range(reach):
            out_x, out_y = x + (k + 0.5) * nx, y + (k + 0.5) * ny
            in_x, in_y = x - (k + 0.5) * nx, y - (k + 0.5) * ny
            a = _bilinear(evidence, out_x, out_y)
            b = _bilinear(evidence, in_x, in_y)
            ends = np.isnan(a) or np.isnan(b)
            if not ends and k >= 2:
                ends = (
                    _bilinear(coverage, out_x, out_y) > 0.5 or _bilinear(coverage, in_x, in_y) < 0.5
                )
            if ends:
                half = k
                break
            values[reach + k] = a
            values[reach - 1 - k] = b
        mean[s] = 0.0
        weight[s] = 0.0
        if half < _FEWEST_PX:
            continue
        log_p[reach] = 0.0
        for k in range(half):
            log_p[reach + k + 1] = log_p[reach + k] + strength * values[reach + k]
            log_p[reach - k - 1] = log_p[reach - k] - strength * values[reach - 1 - k]
        most, at = -1e300, 0
        for k in range(-half, half + 1):
            log_p[reach + k] -= 0.5 * (k / sigma) ** 2
            if log_p[reach + k] > most:
                most, at = log_p[reach + k], k
        if bracketed and abs(at) >= half - 1:
            continue
        total, first, second = 0.0, 0.0, 0.0
        for k in range(-half, half + 1):
            p = np.exp(log_p[reach + k] - most)
            total += p
            first += p * k
            second += p * k * k
        m = first / total
        # A pixel's width of rounding is the least variance that an integer grid can tell.
        variance = max(second / total - m * m, 0.08)
        information = 1.0 / variance - 1.0 / (sigma * sigma)
        if information > 0.0:
            weight[s] = information
            mean[s] = min(max(m / variance / information, -float(half)), float(half))
