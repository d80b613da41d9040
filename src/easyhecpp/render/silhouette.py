"""The silhouette of a posed arm: coverage, derivative, outer contour, depth.

The fast way, compiled by numba for one CPU core; it releases the GIL, so views run in parallel
threads. :mod:`easyhecpp.render.reference` is the readable way, and tests compare the two.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from easyhecpp.camera import Camera
from easyhecpp.render._contour_kernel import contour_segments
from easyhecpp.render._depth_kernel import draw_depth
from easyhecpp.render._packed import PackedMeshes
from easyhecpp.render._raster_kernel import (
    crossings,
    fill_coverage,
    jacobian_entries,
    sample_outer_contour,
)
from easyhecpp.robot import LinkMesh

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]

CLEARANCE_PX = 1.0
"""How far outside a contour sample the image must be empty for the sample to count as outer."""


@dataclass(frozen=True)
class Contour:
    """Samples of the visible outer contour of the arm in one view.

    Attributes:
        points: ``(N, 2)`` pixels.
        normals: ``(N, 2)`` unit, pointing out of the arm.
        links: ``(N,)`` index of the link that forms the contour there.
        jacobians: ``(N, 6)`` pixels of outward displacement per unit of ``delta``, see
            :func:`easyhecpp.geometry.perturb_about`.
        points_cam: ``(N, 3)`` the contour's points in the camera frame, metres.
        spacing: Length of contour that one sample stands for, pixels.
    """

    points: F64
    normals: F64
    links: NDArray[np.int32]
    jacobians: F64
    points_cam: F64
    spacing: float

    def __len__(self) -> int:
        return len(self.points)


@dataclass
class _Segments:
    """Projected contour segments and the room for them; reused from call to call."""

    count: int
    segments: F64
    ends: F64
    weights: NDArray[np.int32]
    links: NDArray[np.int32]

    @classmethod
    def with_room(cls, capacity: int) -> _Segments:
        return cls(
            count=0,
            segments=np.empty((capacity, 4)),
            ends=np.empty((capacity, 6)),
            weights=np.empty(capacity, np.int32),
            links=np.empty(capacity, np.int32),
        )


class SilhouetteRenderer:
    """Renders the silhouette of link meshes through one camera.

    Args:
        meshes: One mesh per link, in the link's frame.
        camera: Camera with distortion; contour edges are cut into pieces of about 4 px before they
            are distorted, so that it is honoured to about 0.01 px. Links, boxes and depth, which
            are drawn as triangles, honour it to about 0.05 px.

    All poses are ``Ts_cam_link`` ``(L, 4, 4)``, metres. The object may be used from several
    threads at once.
    """

    def __init__(self, meshes: Sequence[LinkMesh] | PackedMeshes, camera: Camera) -> None:
        packed = meshes if isinstance(meshes, PackedMeshes) else PackedMeshes.from_meshes(meshes)
        self.camera = camera
        self.packed = packed
        fc, self._model, self._k, self._valid_radius = camera.numba_params()
        self._fc = np.asarray(fc, np.float64)
        self._local = threading.local()

    def with_camera(self, camera: Camera) -> SilhouetteRenderer:
        """The same meshes through another camera (for instance a scaled one)."""
        return SilhouetteRenderer(self.packed, camera)

    def coverage(self, Ts_cam_link: F64, out: F32 | None = None) -> F32:
        """Share of each pixel that the union of the links covers.

        Args:
            Ts_cam_link: ``(L, 4, 4)``.
            out: Zeroed ``(H, W)`` float32 array to fill; a new one when left out.

        Returns:
            ``(H, W)`` float32 in [0, 1].
        """
        return self._cover(self._project(Ts_cam_link), out)[0]

    def coverage_with_jacobian(self, Ts_cam_link: F64, centre_cam: F64) -> tuple[F32, F64]:
        """Coverage ``(H, W)`` and its derivative ``(H, W, 6)`` by ``delta``.

        ``delta = [v, w]`` moves the whole arm in the camera frame about the point ``centre_cam``
        ``(3,)``, see :func:`easyhecpp.geometry.perturb_about`; metres and radians.
        """
        coverage, pixels, rows = self.coverage_with_sparse_jacobian(Ts_cam_link, centre_cam)
        jacobian = np.zeros((*coverage.shape, 6))
        np.add.at(jacobian.reshape(-1, 6), pixels, rows)
        return coverage, jacobian

    def coverage_with_sparse_jacobian(
        self, Ts_cam_link: F64, centre_cam: F64, out: F32 | None = None
    ) -> tuple[F32, NDArray[np.int64], F64]:
        """Coverage ``(H, W)`` and the entries of its derivative, which is zero off the outline.

        Args:
            Ts_cam_link: ``(L, 4, 4)``.
            centre_cam: ``(3,)``, as in `coverage_with_jacobian`.
            out: As in `coverage`.

        Returns:
            The coverage; indices ``(N,)`` of pixels in the flattened picture; ``(N, 6)``. The
            derivative of a pixel by ``delta`` is the sum of all rows that name it.
        """
        seg = self._project(Ts_cam_link)
        coverage, along_rows = self._cover(seg, out)
        swapped = np.ascontiguousarray(seg.segments[: seg.count][:, [1, 0, 3, 2]])
        along_columns = crossings(seg.count, swapped, -seg.weights, self.camera.width)
        centre = np.asarray(centre_cam, np.float64)
        height, width = self.camera.height, self.camera.width
        found = []
        for (start, order), segments, upright in (
            (along_rows, seg.segments, False),
            (along_columns, swapped, True),
        ):
            pixels, rows = np.empty(len(order), np.int64), np.empty((len(order), 6))
            n = jacobian_entries(
                start, order, segments, seg.ends, centre, self._fc, self._model, self._k,
                self._valid_radius, upright, height, width, pixels, rows,
            )  # fmt: skip
            found.append((pixels[:n], rows[:n]))
        return (
            coverage,
            np.concatenate([pixels for pixels, _ in found]),
            np.concatenate([rows for _, rows in found]),
        )

    def contour(
        self, Ts_cam_link: F64, centre_cam: F64, *, spacing: float = 1.0
    ) -> tuple[Contour, F32]:
        """Samples of the visible outer contour, and the coverage that decided what is outer.

        Args:
            Ts_cam_link: ``(L, 4, 4)``.
            centre_cam: ``(3,)`` point about which rotations are taken, camera frame.
            spacing: Distance between samples along the contour, pixels.
        """
        seg = self._project(Ts_cam_link)
        coverage, _ = self._cover(seg, None)
        capacity = 1024
        while True:
            points, normals = np.empty((capacity, 2)), np.empty((capacity, 2))
            links = np.empty(capacity, np.int32)
            jacobians, points_cam = np.empty((capacity, 6)), np.empty((capacity, 3))
            n = sample_outer_contour(
                seg.count, seg.segments, seg.ends, seg.weights, seg.links, coverage,
                np.asarray(centre_cam, np.float64), self._fc, self._model, self._k,
                self._valid_radius, float(spacing), CLEARANCE_PX,
                points, normals, links, jacobians, points_cam,
            )  # fmt: skip
            if n <= capacity:
                break
            capacity = n
        contour = Contour(
            points[:n], normals[:n], links[:n], jacobians[:n], points_cam[:n], float(spacing)
        )
        return contour, coverage

    def link_coverage(self, Ts_cam_link: F64) -> F32:
        """Coverage of each link alone, as if the others were not there: ``(L, H, W)``."""
        seg = self._project(Ts_cam_link)
        links = seg.links[: seg.count]
        out = np.zeros((self.packed.n_links, self.camera.height, self.camera.width), np.float32)
        for link in range(self.packed.n_links):
            own = np.ascontiguousarray(seg.segments[: seg.count][links == link])
            weights = np.ascontiguousarray(seg.weights[: seg.count][links == link])
            fill_coverage(*crossings(len(own), own, weights, self.camera.height), out[link])
        return out

    def visible_links(self, Ts_cam_link: F64) -> NDArray[np.int16]:
        """Index of the nearest link at every pixel's centre, -1 where there is none: ``(H, W)``."""
        return self._draw_depth(Ts_cam_link)[1].astype(np.int16)

    def depth(self, Ts_cam_link: F64) -> F32:
        """Depth along the optical axis at every pixel's centre, metres, inf where empty."""
        with np.errstate(divide="ignore"):
            return (1.0 / self._draw_depth(Ts_cam_link)[0]).astype(np.float32)

    def boxes(self, Ts_cam_link: F64) -> F64:
        """Boxes ``(L, 4)`` (x0, y0, x1, y1, pixels, inclusive) of each link's visible part.

        A row is nan where the link is hidden or out of the image.
        """
        nearest = self._draw_depth(Ts_cam_link)[1]
        boxes = np.full((self.packed.n_links, 4), np.nan)
        for link in range(self.packed.n_links):
            rows, columns = np.nonzero(nearest == link)
            if len(rows):
                boxes[link] = columns.min(), rows.min(), columns.max(), rows.max()
        return boxes

    def _workspace(self) -> tuple[NDArray[np.int32], NDArray[np.int8]]:
        if not hasattr(self._local, "outline"):
            self._local.outline = np.empty(len(self.packed.edges), np.int32)
            self._local.sides = np.empty(self.packed.planes.shape[1] + 1, np.int8)
            self._local.segments = _Segments.with_room(4096)
        return self._local.outline, self._local.sides

    def _project(self, Ts_cam_link: F64) -> _Segments:
        outline, sides = self._workspace()
        p = self.packed
        Ts = np.ascontiguousarray(Ts_cam_link, dtype=np.float64)
        while True:
            seg: _Segments = self._local.segments
            count = contour_segments(
                Ts, p.vertices, p.vertex_start, p.boxes, p.planes, p.faces, p.face_start, p.edges,
                p.edge_faces, p.edge_start, self._fc, self._model, self._k,
                self._valid_radius, outline, sides,
                seg.segments, seg.ends, seg.weights, seg.links,
            )  # fmt: skip
            if count <= len(seg.segments):
                seg.count = count
                return seg
            self._local.segments = _Segments.with_room(int(1.2 * count))

    def _cover(
        self, seg: _Segments, out: F32 | None
    ) -> tuple[F32, tuple[NDArray[np.int32], NDArray[np.int64]]]:
        if out is None:
            out = np.zeros((self.camera.height, self.camera.width), np.float32)
        found = crossings(seg.count, seg.segments, seg.weights, self.camera.height)
        fill_coverage(*found, out)
        return out, found

    def _draw_depth(self, Ts_cam_link: F64) -> tuple[F32, NDArray[np.int32]]:
        shape = (self.camera.height, self.camera.width)
        inverse_depth = np.zeros(shape, np.float32)
        nearest = np.full(shape, -1, np.int32)
        p = self.packed
        draw_depth(
            np.ascontiguousarray(Ts_cam_link, dtype=np.float64), p.vertices, p.faces, p.face_start,
            self._fc, self._model, self._k, self._valid_radius, inverse_depth, nearest,
        )  # fmt: skip
        return inverse_depth, nearest
