"""A z-buffer over the triangles (compiled): nearest link and depth at every pixel's centre."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from easyhecpp.render._contour_kernel import NEAR, to_pixel
from easyhecpp.render._jit import jit

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I32 = NDArray[np.int32]

_SIDE = 0.8
"""Longest straight side of a triangle under lens distortion, in square roots of the focal length in
pixels: what bends is its square, so that no side bends by more than about 0.05 px."""

_DEEPEST = 100
"""Room for triangles that wait to be halved: three for each time that one is."""


@jit
def _triangle(a: F64, b: F64, c: F64, link: int, inverse_depth: F32, nearest: I32) -> None:
    """Draw one projected triangle; its corners are (x, y, 1/z)."""
    height, width = inverse_depth.shape
    area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    if area == 0.0:
        return
    low_x = max(0, int(np.ceil(max(min(a[0], b[0], c[0]), -1.0))))
    high_x = min(width - 1, int(np.floor(min(max(a[0], b[0], c[0]), float(width)))))
    low_y = max(0, int(np.ceil(max(min(a[1], b[1], c[1]), -1.0))))
    high_y = min(height - 1, int(np.floor(min(max(a[1], b[1], c[1]), float(height)))))
    for y in range(low_y, high_y + 1):
        for x in range(low_x, high_x + 1):
            wa = ((b[0] - x) * (c[1] - y) - (b[1] - y) * (c[0] - x)) / area
            wb = ((c[0] - x) * (a[1] - y) - (c[1] - y) * (a[0] - x)) / area
            wc = 1.0 - wa - wb
            if wa < 0.0 or wb < 0.0 or wc < 0.0:
                continue
            # 1/z is linear in the image.
            value = wa * a[2] + wb * b[2] + wc * c[2]
            if value > inverse_depth[y, x]:
                inverse_depth[y, x] = value
                nearest[y, x] = link


@jit
def _side(a: F64, b: F64) -> float:
    return np.sqrt((b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2)


@jit
def _longest_side(a: F64, b: F64, c: F64) -> float:
    return max(_side(a, b), _side(b, c), _side(c, a))


@jit
def _halve(a: F64, b: F64, fc: F64, model: int, k: F64, valid_radius: float, out: F64) -> None:
    """The point that halves the angle between two points, the same from whichever end."""
    da = np.sqrt(a[3] * a[3] + a[4] * a[4] + a[5] * a[5])
    db = np.sqrt(b[3] * b[3] + b[4] * b[4] + b[5] * b[5])
    for i in range(3, 6):
        out[i] = (a[i] * db + b[i] * da) / (da + db)
    out[0], out[1] = to_pixel(out[3], out[4], out[5], fc, model, k, valid_radius)
    out[2] = 1.0 / out[5]


@jit
def _bent_triangle(
    stack: F64,
    straight_px: float,
    link: int,
    fc: F64,
    model: int,
    k: F64,
    valid_radius: float,
    inverse_depth: F32,
    nearest: I32,
) -> None:
    """Draw the triangle ``stack[0]``, whose sides the lens bends, in pieces of short sides.

    A side is halved or not by its own length alone, so that neighbours do the same and no gap
    opens between them.

    Args:
        stack: ``(N, 3, 6)`` room for triangles; corners are (x, y, 1/z) and the point itself.
        straight_px: Longest side that need not be halved.
    """
    height, width = inverse_depth.shape
    middle = np.empty((3, 6))
    split = np.empty(3, np.bool_)
    n = 1
    while n > 0:
        n -= 1
        # A copy: its pieces are put where it stands.
        t = stack[n].copy()
        n_split = 0
        for j in range(3):
            split[j] = _side(t[j], t[(j + 1) % 3]) > straight_px
            n_split += split[j]
        if n_split == 0 or n + 4 > stack.shape[0]:
            _triangle(t[0], t[1], t[2], link, inverse_depth, nearest)
            continue
        # A long side may bulge into a picture that its ends lie beside.
        around = 0.5 * _longest_side(t[0], t[1], t[2])
        if (
            max(t[0, 0], t[1, 0], t[2, 0]) < -around
            or max(t[0, 1], t[1, 1], t[2, 1]) < -around
            or min(t[0, 0], t[1, 0], t[2, 0]) > width + around
            or min(t[0, 1], t[1, 1], t[2, 1]) > height + around
        ):
            continue
        for j in range(3):
            if split[j]:
                _halve(t[j], t[(j + 1) % 3], fc, model, k, valid_radius, middle[j])
        if n_split == 3:
            for j in range(3):
                stack[n, 0], stack[n, 1], stack[n, 2] = t[j], middle[j], middle[(j + 2) % 3]
                n += 1
            stack[n] = middle
            n += 1
            continue
        # One or two halved sides: `first` is one whose next side is not halved, if there are two.
        first = 0
        while not split[first] or (n_split == 2 and split[(first + 1) % 3]):
            first += 1
        p, q, r = t[first], t[(first + 1) % 3], t[(first + 2) % 3]
        stack[n, 0], stack[n, 1], stack[n, 2] = middle[first], q, r
        n += 1
        if n_split == 1:
            stack[n, 0], stack[n, 1], stack[n, 2] = p, middle[first], r
            n += 1
        else:
            last = middle[(first + 2) % 3]
            stack[n, 0], stack[n, 1], stack[n, 2] = middle[first], r, last
            stack[n + 1, 0], stack[n + 1, 1], stack[n + 1, 2] = p, middle[first], last
            n += 2


@jit
def draw_depth(
    Ts_cam_link: F64,
    vertices: F64,
    faces: I32,
    face_start: I32,
    fc: F64,
    model: int,
    k: F64,
    valid_radius: float,
    inverse_depth: F32,
    nearest: I32,
) -> None:
    """Fill ``inverse_depth`` (zero where empty) and ``nearest`` link (-1 where empty)."""
    corners = np.empty((3, 3))
    poly = np.empty((4, 3))
    flat = np.empty((4, 6))
    stack = np.empty((_DEEPEST, 3, 6))
    straight_px = _SIDE * np.sqrt(max(fc[0], fc[1]))
    for link in range(Ts_cam_link.shape[0]):
        T = Ts_cam_link[link]
        for f in range(face_start[link], face_start[link + 1]):
            for j in range(3):
                v = vertices[faces[f, j]]
                for i in range(3):
                    corners[j, i] = T[i, 0] * v[0] + T[i, 1] * v[1] + T[i, 2] * v[2] + T[i, 3]
            m = 0
            for j in range(3):
                a = corners[j]
                b = corners[(j + 1) % 3]
                if a[2] > NEAR:
                    poly[m] = a
                    m += 1
                if (a[2] > NEAR) != (b[2] > NEAR):
                    s = (NEAR - a[2]) / (b[2] - a[2])
                    poly[m] = a + s * (b - a)
                    m += 1
            if m < 3:
                continue
            for j in range(m):
                u, w = to_pixel(poly[j, 0], poly[j, 1], poly[j, 2], fc, model, k, valid_radius)
                flat[j, 0], flat[j, 1], flat[j, 2] = u, w, 1.0 / poly[j, 2]
                flat[j, 3:] = poly[j]
            for j in range(1, m - 1):
                if model == 0 or _longest_side(flat[0], flat[j], flat[j + 1]) <= straight_px:
                    _triangle(flat[0], flat[j], flat[j + 1], link, inverse_depth, nearest)
                    continue
                stack[0, 0], stack[0, 1], stack[0, 2] = flat[0], flat[j], flat[j + 1]
                _bent_triangle(
                    stack, straight_px, link, fc, model, k, valid_radius, inverse_depth, nearest
                )
