"""From contour segments to coverage, its derivative, and samples of the outer contour (compiled).

Coverage is integrated exactly along x and by ``LINES`` sample lines per pixel row along y. On every
line the crossings are sorted and the number of layers is summed up, so a point counts once however
many links lie over it (the paper's ``min(1, sum)`` adds them up first and clips afterwards, which
overcounts every pixel in which two links share a boundary).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from easyhecpp.render._jit import jit
from easyhecpp.render._project import project_row

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I32 = NDArray[np.int32]
I64 = NDArray[np.int64]

LINES = 4
"""Sample lines per pixel row."""

COVERED = 0.75
"""A contour sample where more of the pixel is covered does not lie on the outline, where one half
is; a little more in a concave corner."""

_COLUMNS = 2048
"""Pixels of the segments' rough order: filled from left to right, lines are all but sorted."""

_UNITS_PER_PX = float(1 << 25)
_FAR_PX = 16000.0


@jit
def _line_range(y0: float, y1: float, n_lines: int) -> tuple[int, int]:
    """First and one past the last sample line that a segment crosses.

    Half-open, so that two segments which meet on a line are counted once.
    """
    low = (min(y0, y1) + 0.5) * LINES - 0.5
    high = (max(y0, y1) + 0.5) * LINES - 0.5
    first = max(0, int(np.ceil(min(low, float(n_lines)))))
    last = min(n_lines, int(np.ceil(max(high, 0.0))))
    return first, last


@jit
def _from_left(n: int, segments: F64) -> I32:
    """The segments in the order of their middles from left to right, to a pixel."""
    place = np.empty(n, np.int32)
    start = np.zeros(_COLUMNS + 1, np.int32)
    for s in range(n):
        middle = 0.5 * (segments[s, 0] + segments[s, 2])
        place[s] = int(min(max(middle, 0.0), _COLUMNS - 1.0))
        start[place[s] + 1] += 1
    for column in range(_COLUMNS):
        start[column + 1] += start[column]
    order = np.empty(n, np.int32)
    for s in range(n):
        order[start[place[s]]] = s
        start[place[s]] += 1
    return order


@jit
def crossings(n: int, segments: F64, weights: I32, height: int) -> tuple[I32, I64]:
    """Crossings of all segments with the sample lines, sorted along each line.

    One integer a crossing, so that sorting moves one number instead of three: x in units of
    2**-25 px, above 22 bits that name the segment and two for the layers gained or lost there.

    Returns:
        ``start`` ``(lines + 1,)`` and the crossings; see `_x_of`, `_segment_of`, `_step_of`.
    """
    n_lines = height * LINES
    # How many segments begin and end on a line tells how many cross it.
    gained = np.zeros(n_lines + 1, np.int32)
    ranges = np.empty((n, 2), np.int32)
    for s in range(n):
        first, last = _line_range(segments[s, 1], segments[s, 3], n_lines)
        ranges[s, 0], ranges[s, 1] = first, last
        if first < last:
            gained[first] += 1
            gained[last] -= 1
    start = np.empty(n_lines + 1, np.int32)
    start[0] = 0
    on_line = 0
    for line in range(n_lines):
        on_line += gained[line]
        start[line + 1] = start[line] + on_line
    fill = start[:-1].copy()
    found = np.empty(start[n_lines], np.int64)
    for s in _from_left(n, segments):
        first, last = ranges[s, 0], ranges[s, 1]
        if first >= last:
            continue
        x0, y0, x1, y1 = segments[s, 0], segments[s, 1], segments[s, 2], segments[s, 3]
        slope = (x1 - x0) / (y1 - y0)
        x = x0 + slope * ((first + 0.5) / LINES - 0.5 - y0)
        slope /= LINES
        loses = (y1 < y0) != (weights[s] < 0)
        name = np.int64(4 * s + 2 * (abs(weights[s]) > 1) + loses)
        for line in range(first, last):
            # Far outside of any image it does not matter how far.
            key = (np.int64(min(max(x, -_FAR_PX), _FAR_PX) * _UNITS_PER_PX) << 24) | name
            i = fill[line]
            fill[line] = i + 1
            begin = start[line]
            while i > begin and found[i - 1] > key:
                found[i] = found[i - 1]
                i -= 1
            found[i] = key
            x += slope
    return start, found


@jit
def _x_of(crossing: int) -> float:
    """Where a crossing lies, pixels."""
    return (crossing >> 24) / _UNITS_PER_PX


@jit
def _segment_of(crossing: int) -> int:
    """The segment that crosses."""
    return (crossing & 0xFFFFFF) >> 2


@jit
def _step_of(crossing: int) -> int:
    """Layers gained when the crossing is passed from left to right: -2, -1, 1 or 2."""
    return (1 + ((crossing >> 1) & 1)) * (1 - 2 * (crossing & 1))


@jit
def line_spans(start: I32, found: I64, line: int, width: int, ends: F64) -> int:
    """Write begin and end (pixels, from the image's left edge) of a line's covered spans.

    Returns:
        How many numbers were written to ``ends``; as many as the line has crossings suffice.
    """
    count, layers = 0, 0
    left = 0.0
    for i in range(start[line], start[line + 1]):
        before = layers
        layers += _step_of(found[i])
        if before <= 0 and layers > 0:
            left = _x_of(found[i])
        elif before > 0 and layers <= 0:
            a = min(max(left + 0.5, 0.0), float(width))
            b = min(max(_x_of(found[i]) + 0.5, 0.0), float(width))
            if b > a:
                ends[count], ends[count + 1] = a, b
                count += 2
    return count


@jit
def fill_coverage(start: I32, found: I64, out: F32) -> None:
    """Add the covered spans of every sample line to ``out`` ``(H, W)``, which must be zero."""
    height, width = out.shape
    one, unit = np.float32(1.0), np.float32(1.0 / LINES)
    # Whole numbers add up faster than fractions, one after the other as they must.
    inner = np.zeros(width + 1, np.int32)
    for row in range(height):
        begin, end = start[row * LINES], start[(row + 1) * LINES]
        if begin == end:
            continue
        low, high = width, 0
        for line in range(row * LINES, (row + 1) * LINES):
            layers = 0
            left = 0.0
            for i in range(start[line], start[line + 1]):
                before = layers
                layers += _step_of(found[i])
                if before <= 0 and layers > 0:
                    left = _x_of(found[i])
                elif before > 0 and layers <= 0:
                    a = min(max(left + 0.5, 0.0), float(width))
                    b = min(max(_x_of(found[i]) + 0.5, 0.0), float(width))
                    if b <= a:
                        continue
                    ia, ib = int(a), int(b)
                    low, high = min(low, ia), max(high, min(ib + 1, width))
                    if ia == ib:
                        out[row, ia] += unit * (b - a)
                        continue
                    out[row, ia] += unit * (ia + 1 - a)
                    if ib < width:
                        out[row, ib] += unit * (b - ib)
                    inner[ia + 1] += 1
                    inner[ib] -= 1
        run = np.int32(0)
        for x in range(low, high):
            run += inner[x]
            inner[x] = 0
            out[row, x] = min(one, out[row, x] + unit * np.float32(run))
        # Of spans that end at the picture's right edge.
        inner[high] = 0


@jit
def jacobian_entries(
    start: I32,
    found: I64,
    segments: F64,
    ends: F64,
    centre: F64,
    fc: F64,
    model: int,
    k: F64,
    valid_radius: float,
    upright: bool,
    height: int,
    width: int,
    pixels: I64,
    rows: F64,
) -> int:
    """What each end of a span that moves adds to d(coverage)/d(delta) of the pixel it lies in.

    A line tells nothing of an outline that runs along it. So this is asked twice, with lines along
    rows and, ``upright``, along columns (``segments`` and crossings with x and y swapped, their
    weights negated because that turns the picture over), and takes what crosses a line steeply.

    Fills ``pixels`` ``(C,)``, ``y * width + x`` in the picture as it is, and ``rows`` ``(C, 6)``
    with room for every crossing; returns how many there are. A pixel may come up several times.
    """
    n_lines, length = (width, height) if upright else (height, width)
    p = np.empty(3)
    normal = np.empty(2)
    row3 = np.empty(3)
    n = 0
    for line in range(n_lines * LINES):
        layers = 0
        for i in range(start[line], start[line + 1]):
            before = layers
            layers += _step_of(found[i])
            opens = before <= 0 and layers > 0
            closes = before > 0 and layers <= 0
            if not (opens or closes):
                continue
            at = int(np.floor(_x_of(found[i]) + 0.5))
            if at < 0 or at >= length:
                continue
            s = _segment_of(found[i])
            y0, y1 = segments[s, 1], segments[s, 3]
            slope = (segments[s, 2] - segments[s, 0]) / (y1 - y0)
            if abs(slope) > 1.0 or (upright and abs(slope) == 1.0):
                continue
            t = ((line + 0.5) / LINES - 0.5 - y0) / (y1 - y0)
            # Perspective: the image parameter t is not the parameter along the 3-D edge.
            za, zb = ends[s, 2], ends[s, 5]
            u = t * za / (t * za + (1.0 - t) * zb)
            for j in range(3):
                p[j] = ends[s, j] + u * (ends[s, 3 + j] - ends[s, j])
            # On a fixed line, x moves by du - (dx/dy) dv.
            normal[0], normal[1] = (-slope, 1.0) if upright else (1.0, -slope)
            project_row(p, normal, fc, model, k, valid_radius, row3)
            sign = -1.0 / LINES if opens else 1.0 / LINES
            px, py, pz = p[0] - centre[0], p[1] - centre[1], p[2] - centre[2]
            pixels[n] = at * width + line // LINES if upright else line // LINES * width + at
            rows[n, 0] = sign * row3[0]
            rows[n, 1] = sign * row3[1]
            rows[n, 2] = sign * row3[2]
            rows[n, 3] = sign * (py * row3[2] - pz * row3[1])
            rows[n, 4] = sign * (pz * row3[0] - px * row3[2])
            rows[n, 5] = sign * (px * row3[1] - py * row3[0])
            n += 1
    return n


@jit
def _bilinear(image: F32, x: float, y: float) -> float:
    height, width = image.shape
    x = min(max(x, 0.0), width - 1.0)
    y = min(max(y, 0.0), height - 1.0)
    ix, iy = min(int(x), width - 2), min(int(y), height - 2)
    fx, fy = x - ix, y - iy
    top = image[iy, ix] * (1.0 - fx) + image[iy, ix + 1] * fx
    bottom = image[iy + 1, ix] * (1.0 - fx) + image[iy + 1, ix + 1] * fx
    return top * (1.0 - fy) + bottom * fy


@jit
def sample_outer_contour(
    n: int,
    segments: F64,
    ends: F64,
    weights: I32,
    links: I32,
    coverage: F32,
    centre: F64,
    fc: F64,
    model: int,
    k: F64,
    valid_radius: float,
    spacing: float,
    clearance: float,
    points: F64,
    normals: F64,
    sample_links: I32,
    jacobians: F64,
    points_cam: F64,
) -> int:
    """Walk the contour segments and keep samples, ``spacing`` apart, with nothing just outside.

    "Outside" is ``clearance`` pixels along the outward normal, where the coverage must be under
    one half; at the sample itself it must be under ``COVERED``: an edge that runs just inside of
    the silhouette is none of its outline. Samples within ``clearance`` of the image's edge are left
    out.

    Returns:
        The number of samples; like the segments it counts on beyond the capacity.
    """
    height, width = coverage.shape
    count = 0
    phase = 0.5 * spacing
    p = np.empty(3)
    normal = np.empty(2)
    row3 = np.empty(3)
    for s in range(n):
        x0, y0, x1, y1 = segments[s, 0], segments[s, 1], segments[s, 2], segments[s, 3]
        dx, dy = x1 - x0, y1 - y0
        length = np.sqrt(dx * dx + dy * dy)
        if length < 1e-9:
            continue
        if (
            max(x0, x1) < 0.0
            or max(y0, y1) < 0.0
            or min(x0, x1) > width - 1.0
            or min(y0, y1) > height - 1.0
            or length > 1e6
        ):
            continue
        at = phase
        side = 1.0 if weights[s] > 0 else -1.0
        nx, ny = -side * dy / length, side * dx / length
        while at < length:
            t = at / length
            at += spacing
            x, y = x0 + t * dx, y0 + t * dy
            xo, yo = x + clearance * nx, y + clearance * ny
            if (
                min(x, xo) < clearance
                or min(y, yo) < clearance
                or max(x, xo) > width - 1.0 - clearance
                or max(y, yo) > height - 1.0 - clearance
            ):
                continue
            if _bilinear(coverage, xo, yo) > 0.5 or _bilinear(coverage, x, y) > COVERED:
                continue
            if count < points.shape[0]:
                za, zb = ends[s, 2], ends[s, 5]
                u = t * za / (t * za + (1.0 - t) * zb)
                for j in range(3):
                    p[j] = ends[s, j] + u * (ends[s, 3 + j] - ends[s, j])
                normal[0], normal[1] = nx, ny
                project_row(p, normal, fc, model, k, valid_radius, row3)
                points[count, 0], points[count, 1] = x, y
                normals[count, 0], normals[count, 1] = nx, ny
                sample_links[count] = links[s]
                points_cam[count] = p
                px, py, pz = p[0] - centre[0], p[1] - centre[1], p[2] - centre[2]
                jacobians[count, 0] = row3[0]
                jacobians[count, 1] = row3[1]
                jacobians[count, 2] = row3[2]
                jacobians[count, 3] = py * row3[2] - pz * row3[1]
                jacobians[count, 4] = pz * row3[0] - px * row3[2]
                jacobians[count, 5] = px * row3[1] - py * row3[0]
            count += 1
        phase = at - length
    return count
