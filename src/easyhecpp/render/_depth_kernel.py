"""A z-buffer over the triangles (compiled): nearest link and depth at every pixel's centre."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from easyhecpp.render._contour_kernel import NEAR, to_pixel
from easyhecpp.render._jit import jit

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I32 = NDArray[np.int32]


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
    flat = np.empty((4, 3))
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
            for j in range(1, m - 1):
                _triangle(flat[0], flat[j], flat[j + 1], link, inverse_depth, nearest)
