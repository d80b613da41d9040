"""Contour edges of the posed meshes, projected into the image (compiled).

A face contributes its projected area once, whatever way it looks. Of an edge between two faces
that look the same way the two contributions cancel; what remains are the contour edges (weight
+-2) and the edges of open boundaries (weight +-1). The running sum of these weights along an image
row is the number of surface layers above a point, so "sum > 0" is the exact union of all links,
for closed and for open meshes alike.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from easyhecpp.render._jit import jit
from easyhecpp.render._project import distort

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I8 = NDArray[np.int8]
I32 = NDArray[np.int32]
U32 = NDArray[np.uint32]

NEAR = 1e-3
"""Near plane, metres in front of the camera."""

PIECE_PX = 4.0
"""Straight piece of an edge under lens distortion, about; bends by 0.01 px or less."""


@jit
def to_pixel(
    x: float, y: float, z: float, fc: F64, model: int, k: F64, valid_radius: float
) -> tuple[float, float]:
    xd, yd = distort(x / z, y / z, model, k, valid_radius)
    return fc[0] * xd + fc[2], fc[1] * yd + fc[3]


@jit
def _emit(
    n: int,
    weight: int,
    link: int,
    ax: float,
    ay: float,
    az: float,
    bx: float,
    by: float,
    bz: float,
    fc: F64,
    model: int,
    k: F64,
    valid_radius: float,
    segments: F64,
    ends: F64,
    weights: I32,
    links: I32,
) -> int:
    """Append the projection of a 3-D edge, in pieces when the lens bends it; returns the count.

    Nothing is written past the capacity, but the count goes on, so the caller knows what it needs.
    """
    u0, v0 = to_pixel(ax, ay, az, fc, model, k, valid_radius)
    u1, v1 = to_pixel(bx, by, bz, fc, model, k, valid_radius)
    pieces = 1
    ua, va = u0, v0
    xa, ya, za = ax, ay, az
    da, db, angle = 0.0, 0.0, 0.0
    length = np.sqrt((u1 - u0) ** 2 + (v1 - v0) ** 2)
    if model != 0 and length > PIECE_PX:
        # Pieces of equal viewing angle: of equal length, all but a few of an edge that reaches
        # close to the camera's plane would lie outside of the picture. For the same reason the
        # angle limits their number; a radian is two focal lengths where a picture is 90 deg wide.
        da = np.sqrt(ax * ax + ay * ay + az * az)
        db = np.sqrt(bx * bx + by * by + bz * bz)
        cx, cy, cz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        angle = np.arctan2(np.sqrt(cx * cx + cy * cy + cz * cz), ax * bx + ay * by + az * bz)
        pieces = 1 + int(min(length, 2.0 * max(fc[0], fc[1]) * angle) / PIECE_PX)
    for i in range(1, pieces + 1):
        if i == pieces:
            xb, yb, zb = bx, by, bz
            ub, vb = u1, v1
        else:
            s = i / pieces
            if angle > 1e-6:
                near, far = da * np.sin(s * angle), db * np.sin((1.0 - s) * angle)
                s = near / (near + far)
            xb, yb, zb = ax + s * (bx - ax), ay + s * (by - ay), az + s * (bz - az)
            ub, vb = to_pixel(xb, yb, zb, fc, model, k, valid_radius)
        if n < segments.shape[0]:
            segments[n, 0], segments[n, 1], segments[n, 2], segments[n, 3] = ua, va, ub, vb
            ends[n, 0], ends[n, 1], ends[n, 2] = xa, ya, za
            ends[n, 3], ends[n, 4], ends[n, 5] = xb, yb, zb
            weights[n] = weight
            links[n] = link
        n += 1
        ua, va = ub, vb
        xa, ya, za = xb, yb, zb
    return n


@jit
def _cut(points: F64, a: int, b: int, out: F64) -> None:
    """Where an edge passes through the near plane; the same from whichever end it is asked."""
    if a > b:
        a, b = b, a
    s = (NEAR - points[a, 2]) / (points[b, 2] - points[a, 2])
    out[0] = points[a, 0] + s * (points[b, 0] - points[a, 0])
    out[1] = points[a, 1] + s * (points[b, 1] - points[a, 1])
    out[2] = NEAR


@jit
def _cut_link(
    n: int,
    link: int,
    first: int,
    faces: I32,
    edges: U32,
    edge_faces: U32,
    sides: I8,
    face_sides: I8,
    points: F64,
    fc: F64,
    model: int,
    k: F64,
    valid_radius: float,
    segments: F64,
    ends: F64,
    weights: I32,
    links: I32,
) -> int:
    """Segments of a link that reaches behind the near plane.

    What is left of its contour edges, and of every face that is cut the new edge on the plane:
    together they are closed again. ``face_sides`` are the sides of ``faces``; ``points`` are the
    link's own, from vertex ``first`` on.
    """
    p = np.empty(3)
    q = np.empty(3)
    for e in range(edges.shape[0]):
        w = sides[edge_faces[e, 0]] - sides[edge_faces[e, 1]]
        a, b = int(edges[e, 0]) - first, int(edges[e, 1]) - first
        a_in, b_in = points[a, 2] > NEAR, points[b, 2] > NEAR
        if w == 0 or not (a_in or b_in):
            continue
        p[:], q[:] = points[a], points[b]
        if not a_in:
            _cut(points, a, b, p)
        if not b_in:
            _cut(points, a, b, q)
        n = _emit(
            n, int(w), link, p[0], p[1], p[2], q[0], q[1], q[2],
            fc, model, k, valid_radius, segments, ends, weights, links,
        )  # fmt: skip
    for f in range(faces.shape[0]):
        cuts = 0
        for j in range(3):
            a, b = faces[f, j] - first, faces[f, (j + 1) % 3] - first
            a_in, b_in = points[a, 2] > NEAR, points[b, 2] > NEAR
            if a_in == b_in:
                continue
            # The walk round the face goes from where it leaves to where it comes back.
            _cut(points, a, b, p if a_in else q)
            cuts += 1
        if cuts:
            n = _emit(
                n, face_sides[f], link, p[0], p[1], p[2], q[0], q[1], q[2],
                fc, model, k, valid_radius, segments, ends, weights, links,
            )  # fmt: skip
    return n


@jit
def _sides(planes: F32, first: int, last: int, cx: float, cy: float, cz: float, out: I8) -> None:
    """+1 for faces that look at the point, -1 for the others.

    Single precision is enough: whatever the signs, the edges between +1 and -1 form closed loops.
    """
    nx, ny, nz, d = planes[0], planes[1], planes[2], planes[3]
    x, y, z = np.float32(cx), np.float32(cy), np.float32(cz)
    for f in range(first, last):
        out[f] = np.int8(1) if nx[f] * x + ny[f] * y + nz[f] * z > d[f] else np.int8(-1)


@jit
def contour_segments(
    Ts_cam_link: F64,
    vertices: F64,
    vertex_start: I32,
    boxes: F64,
    planes: F32,
    faces: I32,
    face_start: I32,
    edges: U32,
    edge_faces: U32,
    edge_start: I32,
    fc: F64,
    model: int,
    k: F64,
    valid_radius: float,
    outline: I32,
    sides: I8,
    segments: F64,
    ends: F64,
    weights: I32,
    links: I32,
) -> int:
    """Fill the segment arrays for all links; returns how many there are (or would be).

    Args:
        Ts_cam_link: ``(L, 4, 4)``.
        vertices: ``(V, 3)`` of all links, each in its link's frame; ``vertex_start`` ``(L+1,)``.
        boxes: ``(L, 6)`` lowest and highest corner of each link, link frame.
        planes: ``(4, F)`` unit normals and offsets; ``faces`` ``(F, 3)`` global vertex indices.
        edges: ``(E, 2)`` vertex indices; ``edge_faces`` ``(E, 2)``: the first walks
            along the edge, the second against it; F stands for "no face".
        outline, sides: work arrays ``(E,)``, ``(F+1,)``.
        segments: ``(C, 4)`` pixel ends; ``ends`` ``(C, 6)`` the same in the camera frame.
    """
    n = 0
    n_faces = planes.shape[1]
    sides[n_faces] = 0
    fx, fy, px, py = fc[0], fc[1], fc[2], fc[3]
    bent = model != 0
    capacity = segments.shape[0]
    for link in range(Ts_cam_link.shape[0]):
        T = Ts_cam_link[link]
        v0, v1 = vertex_start[link], vertex_start[link + 1]
        middle, half = T[2, 3], 0.0
        for i in range(3):
            middle += T[2, i] * 0.5 * (boxes[link, i] + boxes[link, 3 + i])
            half += abs(T[2, i]) * 0.5 * (boxes[link, 3 + i] - boxes[link, i])
        if v0 == v1 or middle + half <= NEAR:
            continue
        cx = -(T[0, 0] * T[0, 3] + T[1, 0] * T[1, 3] + T[2, 0] * T[2, 3])
        cy = -(T[0, 1] * T[0, 3] + T[1, 1] * T[1, 3] + T[2, 1] * T[2, 3])
        cz = -(T[0, 2] * T[0, 3] + T[1, 2] * T[1, 3] + T[2, 2] * T[2, 3])
        _sides(planes, face_start[link], face_start[link + 1], cx, cy, cz, sides)
        # Scalars, not row views: each view would cost two atomic reference counts.
        r00, r01, r02, tx = T[0, 0], T[0, 1], T[0, 2], T[0, 3]
        r10, r11, r12, ty = T[1, 0], T[1, 1], T[1, 2], T[1, 3]
        r20, r21, r22, tz = T[2, 0], T[2, 1], T[2, 2], T[2, 3]
        if middle - half <= NEAR:
            points = np.empty((v1 - v0, 3))
            for v in range(v0, v1):
                x, y, z = vertices[v, 0], vertices[v, 1], vertices[v, 2]
                points[v - v0, 0] = r00 * x + r01 * y + r02 * z + tx
                points[v - v0, 1] = r10 * x + r11 * y + r12 * z + ty
                points[v - v0, 2] = r20 * x + r21 * y + r22 * z + tz
            f0, f1 = face_start[link], face_start[link + 1]
            e0, e1 = edge_start[link], edge_start[link + 1]
            n = _cut_link(
                n, link, v0, faces[f0:f1], edges[e0:e1], edge_faces[e0:e1], sides, sides[f0:f1],
                points, fc, model, k, valid_radius, segments, ends, weights, links,
            )  # fmt: skip
            continue
        # First which edges, then what they are: one in a dozen is a contour edge, and a branch on
        # it would be guessed wrong each time.
        n_outline = 0
        for e in range(edge_start[link], edge_start[link + 1]):
            outline[n_outline] = e
            n_outline += sides[edge_faces[e, 0]] != sides[edge_faces[e, 1]]
        for i in range(n_outline):
            e = outline[i]
            w = sides[edge_faces[e, 0]] - sides[edge_faces[e, 1]]
            v = edges[e, 0]
            x, y, z = vertices[v, 0], vertices[v, 1], vertices[v, 2]
            ax = r00 * x + r01 * y + r02 * z + tx
            ay = r10 * x + r11 * y + r12 * z + ty
            az = r20 * x + r21 * y + r22 * z + tz
            v = edges[e, 1]
            x, y, z = vertices[v, 0], vertices[v, 1], vertices[v, 2]
            bx = r00 * x + r01 * y + r02 * z + tx
            by = r10 * x + r11 * y + r12 * z + ty
            bz = r20 * x + r21 * y + r22 * z + tz
            if bent:
                n = _emit(
                    n, int(w), link, ax, ay, az, bx, by, bz,
                    fc, model, k, valid_radius, segments, ends, weights, links,
                )  # fmt: skip
                continue
            # What _emit does for a straight edge. A call with so many arrays takes longer than
            # all the rest of this loop.
            if n < capacity:
                segments[n, 0], segments[n, 1] = fx * (ax / az) + px, fy * (ay / az) + py
                segments[n, 2], segments[n, 3] = fx * (bx / bz) + px, fy * (by / bz) + py
                ends[n, 0], ends[n, 1], ends[n, 2] = ax, ay, az
                ends[n, 3], ends[n, 4], ends[n, 5] = bx, by, bz
                weights[n] = w
                links[n] = link
            n += 1
    return n
