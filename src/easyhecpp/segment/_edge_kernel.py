"""Image edges along the contour's normals, to a fraction of a pixel (compiled)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from easyhecpp.render._jit import jit
from easyhecpp.segment._rim_kernel import STEP, locate_rim

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I8 = NDArray[np.int8]
U8 = NDArray[np.uint8]

_FAR = 9
"""Outermost samples of a line, which show the background."""

_DARKEST, _BRIGHTEST = 0.2, 1.1
"""Shade of the background, against the other views, that is taken for a shadow or a reflection."""

NONE, AGAINST_PLATE, COLOUR = 0, 1, 2
"""What an edge was found from: nothing, the difference to the plate, the colour alone."""


@jit
def _linear(v: float) -> float:
    """Value 0..255 in sRGB to linear light 0..1 (a cubic that follows the standard to 0.3 %)."""
    c = v / 255.0
    return c * (c * (c * 0.305306011 + 0.682171111) + 0.012522878)


@jit
def _sample(image: F32, x: float, y: float, colour: F64, light: F64) -> bool:
    """Bilinear colour, and in linear light; False off the image or next to an unknown pixel."""
    height, width = image.shape[0], image.shape[1]
    if x < 0.0 or y < 0.0 or x > width - 1.0 or y > height - 1.0:
        return False
    ix, iy = min(int(x), width - 2), min(int(y), height - 2)
    fx, fy = x - ix, y - iy
    for c in range(3):
        p, q = image[iy, ix, c], image[iy, ix + 1, c]
        r, s = image[iy + 1, ix, c], image[iy + 1, ix + 1, c]
        top, bottom = p * (1.0 - fx) + q * fx, r * (1.0 - fx) + s * fx
        colour[c] = top * (1.0 - fy) + bottom * fy
        top = _linear(p) * (1.0 - fx) + _linear(q) * fx
        bottom = _linear(r) * (1.0 - fx) + _linear(s) * fx
        light[c] = top * (1.0 - fy) + bottom * fy
    return not np.isnan(colour[0])


@jit
def _slope(signal: F64, k: int, taps: F64) -> float:
    """Length of the smoothed derivative of a colour signal ``(N, 3)`` at index ``k``."""
    half = len(taps) // 2
    total = 0.0
    for c in range(3):
        d = 0.0
        for j in range(-half, half + 1):
            d += taps[half + j] * signal[k + j, c]
        total += d * d
    return np.sqrt(total)


@jit
def _level(signal: F64, first: int, last: int) -> float:
    """Length of the mean of a colour signal over ``first..last``, cut to what there is."""
    n = signal.shape[0]
    first, last = max(0, first), min(n - 1, last)
    if first > last:
        return 0.0
    total = 0.0
    for c in range(3):
        m = 0.0
        for k in range(first, last + 1):
            m += signal[k, c]
        m /= last - first + 1
        total += m * m
    return np.sqrt(total)


@jit
def _shade(values: F64, behind: F64) -> float:
    """How bright the outer end of a line ``(N, 3)`` is against the background's ``(N, 3)``."""
    n = values.shape[0]
    product, square = 0.0, 1e-9
    for k in range(n - _FAR, n):
        for c in range(3):
            product += values[k, c] * behind[k, c]
            square += behind[k, c] * behind[k, c]
    return product / square


@jit
def _read_line(
    picture: F32,
    plate: F32,
    covered: U8,
    point: F64,
    normal: F64,
    middle: int,
    near: F64,
    light: F64,
    behind: F64,
    behind_light: F64,
) -> int:
    """Read a line across the contour into ``near`` and, in linear light, ``light``, inside first.

    They hold the difference to the background where that is known, else the picture itself.

    Args:
        picture, plate, covered: As for `find_edges`.
        point, normal: ``(2,)`` of the contour sample.
        middle: Index of the sample on the line.
        near, light: ``(N, 3)`` output.
        behind, behind_light: ``(N, 3)`` room for the background.

    Returns:
        What an edge could be found from; `NONE` where the line leaves the picture or meets the arm
        again outside of it.
    """
    rows, columns = covered.shape
    colour, linear = np.empty(3), np.empty(3)
    known = True
    for k in range(near.shape[0]):
        t = (k - middle) * STEP
        x, y = point[0] + t * normal[0], point[1] + t * normal[1]
        if not _sample(picture, x, y, colour, linear):
            return NONE
        if t > 2.0 and covered[min(int(y + 0.5), rows - 1), min(int(x + 0.5), columns - 1)] != 0:
            return NONE
        for c in range(3):
            near[k, c], light[k, c] = colour[c], linear[c]
        if known and not _sample(plate, x, y, colour, linear):
            known = False
        if known:
            for c in range(3):
                behind[k, c], behind_light[k, c] = colour[c], linear[c]
    if not known:
        return COLOUR
    # The arm's shadow darkens what the other views show there, evenly enough.
    shade, shade_of_light = _shade(near, behind), _shade(light, behind_light)
    if shade < _DARKEST or shade > _BRIGHTEST:
        shade, shade_of_light = 1.0, 1.0
    for k in range(near.shape[0]):
        for c in range(3):
            near[k, c] -= shade * behind[k, c]
            light[k, c] -= shade_of_light * behind_light[k, c]
    return AGAINST_PLATE


@jit
def _outermost_rise(near: F64, slope: F64, pad: int, least: float, noise: float) -> int:
    """The outermost steep rise of a difference ``(N, 3)`` with none beyond it; -1 for none."""
    for k in range(len(slope) - pad - 1, pad - 1, -1):
        if slope[k] < least or slope[k] < slope[k - 1] or slope[k] < slope[k + 1]:
            continue
        inside, beyond = _level(near, k - 8, k - 3), _level(near, k + 3, k + 8)
        if beyond > max(4.0 * noise, 0.3 * inside) or inside < 6.0 * noise:
            # Something else begins out there: this line does not show the arm's edge.
            return -1
        return k
    return -1


@jit
def _lone_rise(slope: F64, pad: int, least: float, sigma: float) -> int:
    """The steepest place near the middle, when no other rivals it; -1 for none."""
    middle = len(slope) // 2
    best, value, rival = -1, 0.0, 0.0
    for k in range(pad, len(slope) - pad):
        if slope[k] < least or slope[k] < slope[k - 1] or slope[k] < slope[k + 1]:
            continue
        v = slope[k] * np.exp(-0.5 * ((k - middle) / sigma) ** 2)
        if v > value:
            rival = value
            value, best = v, k
        elif v > rival:
            rival = v
    return best if rival <= 0.6 * value else -1


@jit
def find_edges(
    picture: F32,
    plate: F32,
    covered: U8,
    points: F64,
    normals: F64,
    reach: float,
    taps: F64,
    noise: float,
    shifts: F64,
    explains: F64,
    step_width: float,
    offset: F64,
    contrast: F64,
    misfit: F64,
    kind: I8,
) -> None:
    """Find the arm's occluding edge along the normal of every contour sample.

    Where the background is known, the edge is the outermost steep rise of the difference to it
    with no difference beyond; texture of the arm and of the background has no such rise. Where it
    is not (parts that never move away), the steepest colour edge counts, when no other rivals it.
    It is then located in linear light, in which a pixel half covered is half way in between: by the
    rim that explains the light best (`edge_rim`) where the background is known, else where the
    light is steepest. The background may lie in the arm's shadow: along each line it is scaled to
    what the line's outer end shows.

    Args:
        picture: ``(H, W, 3)`` the view, 0..255.
        plate: ``(H, W, 3)`` its background, nan where unknown.
        covered: ``(H, W)`` nonzero on the rendered arm.
        points, normals: ``(N, 2)`` contour samples.
        reach: Largest displacement, pixels.
        taps: Odd number of weights of the smoothed derivative.
        noise: Standard deviation of a channel.
        shifts, explains, step_width: Of the rim, see `edge_rim.RimModel`.
        offset: ``(N,)`` output: outward displacement of the edge, pixels.
        contrast: ``(N,)`` output: height of the edge, 0..255.
        misfit: ``(N,)`` output: share of the light about the edge that no rim explains.
        kind: ``(N,)`` output: see :data:`NONE`, :data:`AGAINST_PLATE`, :data:`COLOUR`.
    """
    pad = len(taps) // 2 + 6
    inner = int(np.ceil(reach / STEP))
    n = 2 * (inner + pad) + 1
    middle = inner + pad
    near = np.empty((n, 3))
    light = np.empty((n, 3))
    behind = np.empty((n, 3))
    behind_light = np.empty((n, 3))
    slope = np.zeros(n)
    rim = np.empty(2)
    # The smoothed derivative of white noise, per channel and for both pictures.
    slope_noise = noise * np.sqrt(2.0 * 3.0 * np.sum(taps * taps) * STEP)
    for s in range(points.shape[0]):
        kind[s] = NONE
        offset[s] = 0.0
        contrast[s] = 0.0
        misfit[s] = 0.0
        seen = _read_line(
            picture, plate, covered, points[s], normals[s], middle, near, light, behind,
            behind_light,
        )  # fmt: skip
        if seen == NONE:
            continue
        top = 0.0
        for k in range(pad - 6, n - pad + 6):
            slope[k] = _slope(near, k, taps)
            if pad <= k < n - pad:
                top = max(top, slope[k])
        least = max(4.0 * slope_noise, 0.3 * top)
        if seen == AGAINST_PLATE:
            best = _outermost_rise(near, slope, pad, least, noise)
        else:
            best = _lone_rise(slope, pad, least, 0.6 * reach / STEP)
        if best < 0:
            continue
        # Locate in linear light, near the place found.
        at, highest = best, -1.0
        for k in range(max(pad, best - 3), min(n - pad, best + 4)):
            v = _slope(light, k, taps)
            if v > highest:
                highest, at = v, k
        a, b = _slope(light, at - 1, taps), _slope(light, at + 1, taps)
        curvature = a - 2.0 * highest + b
        if a > highest or b > highest or curvature >= -1e-12:
            continue
        if seen == AGAINST_PLATE:
            if not locate_rim(light, at, shifts, explains, step_width, rim):
                continue
            offset[s], misfit[s] = (at - middle) * STEP + rim[0], rim[1]
        else:
            offset[s] = (at - middle + 0.5 * (a - b) / curvature) * STEP
        contrast[s] = slope[best]
        kind[s] = seen
