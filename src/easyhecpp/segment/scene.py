"""The arm of one calibration as the classical way renders it: all views, any size."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from easyhecpp._parallel import parallel_map
from easyhecpp.camera import Camera
from easyhecpp.geometry import transform_points
from easyhecpp.render import Contour, SilhouetteRenderer
from easyhecpp.rig import Rig

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]

COARSE_ERROR = 0.004
"""Metres that the simplified meshes of the search may be off."""


class Scene:
    """Posed links of every view, with renderers for the sizes in use.

    Args:
        rig: Robot and set-up.
        camera: Intrinsics of the full images.
        joints: ``(V, n)``.
    """

    def __init__(self, rig: Rig, camera: Camera, joints: Sequence[F64]) -> None:
        self.rig = rig
        self.camera = camera
        self.joints = np.stack([np.asarray(q, np.float64) for q in joints])
        self._pose_links()
        self._renderers: dict[tuple[int, bool], SilhouetteRenderer] = {}

    def _pose_links(self) -> None:
        self.Ts_mount_link = self.rig.Ts_mount_link(self.joints)
        meshes = self.rig.robot.meshes
        middles = np.stack([m.centroid for m in meshes])
        areas = np.array([m.area for m in meshes])
        posed = transform_points(self.Ts_mount_link, middles[None, :, None])[:, :, 0]
        self._shares = areas / areas.sum()
        self._middles = posed
        self.centre_mount: F64 = (areas[:, None] * posed).sum(axis=1).mean(axis=0) / areas.sum()

    def __len__(self) -> int:
        return len(self.joints)

    def corrected(self, camera: Camera, joint_offsets: F64) -> Scene:
        """The same arm with its joints corrected, seen through another lens.

        Args:
            camera: With the other lens, for pictures of the same size.
            joint_offsets: ``(V, n)`` added to the joints.
        """
        other = copy(self)
        other.camera = camera
        if joint_offsets.any():
            other.joints = self.joints + joint_offsets
            other._pose_links()
        other._renderers = {
            (reduction, coarse): renderer.with_camera(_reduced(camera, reduction))
            for (reduction, coarse), renderer in self._renderers.items()
        }
        return other

    @cached_property
    def radius(self) -> float:
        """Radius of a ball round :attr:`centre_mount` that nearly always holds the arm, metres."""
        distances = []
        for link, mesh in enumerate(self.rig.robot.meshes):
            some = mesh.vertices[:: max(1, len(mesh.vertices) // 100)]
            points = transform_points(self.Ts_mount_link[:, link], some[None])
            distances.append(np.linalg.norm(points - self.centre_mount, axis=-1).ravel())
        return float(np.quantile(np.concatenate(distances), 0.95))

    @cached_property
    def motion(self) -> F64:
        """How far the links' middles lie apart in two views, by area, ``(V, V)`` metres."""
        apart = self._middles[:, None] - self._middles[None]
        return np.linalg.norm(apart, axis=-1) @ self._shares

    def centre_cam(self, T_cam_mount: F64) -> F64:
        """The middle of the arm over all views, camera frame, ``(3,)`` metres."""
        return transform_points(T_cam_mount, self.centre_mount)

    def renderer(self, reduction: int, *, coarse: bool = False) -> SilhouetteRenderer:
        """The renderer for images reduced by ``reduction``; ``coarse`` takes simplified meshes."""
        key = (reduction, coarse)
        if key not in self._renderers:
            robot = self.rig.robot.simplified(COARSE_ERROR) if coarse else self.rig.robot
            self._renderers[key] = SilhouetteRenderer(
                robot.meshes, _reduced(self.camera, reduction)
            )
        return self._renderers[key]

    def coverages(
        self,
        T_cam_mount: F64,
        reduction: int,
        *,
        coarse: bool = False,
        views: NDArray[np.integer] | None = None,
    ) -> F32:
        """The arm's coverage in every view, or in some, ``(V, H, W)``; one thread."""
        renderer = self.renderer(reduction, coarse=coarse)
        Ts_mount_link = self.Ts_mount_link if views is None else self.Ts_mount_link[views]
        size = (len(Ts_mount_link), renderer.camera.height, renderer.camera.width)
        out = np.zeros(size, np.float32)
        for cover, Ts in zip(out, Ts_mount_link, strict=True):
            renderer.coverage(T_cam_mount @ Ts, cover)
        return out

    def contours(
        self, T_cam_mount: F64, reduction: int, *, spacing: float = 1.0, coarse: bool = False
    ) -> list[tuple[Contour, F32]]:
        """Contour and coverage of every view; in threads."""
        renderer = self.renderer(reduction, coarse=coarse)
        centre = self.centre_cam(T_cam_mount)
        return parallel_map(
            lambda Ts: renderer.contour(T_cam_mount @ Ts, centre, spacing=spacing),
            list(self.Ts_mount_link),
        )


def _reduced(camera: Camera, reduction: int) -> Camera:
    return camera if reduction == 1 else camera.scaled(1.0 / reduction)
