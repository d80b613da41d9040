"""All views of one calibration, ready to be rendered and compared at any level."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from easyhecpp._parallel import parallel_map
from easyhecpp.camera import Camera
from easyhecpp.errors import InputError
from easyhecpp.geometry import transform_points
from easyhecpp.render import SilhouetteRenderer
from easyhecpp.rig import Rig
from easyhecpp.solve.evidence import Evidence, MaskPyramid, gather
from easyhecpp.solve.types import Observation

F64 = NDArray[np.float64]


class PoseProblem:
    """The views, their masks, and the posed links relative to the camera's mount.

    Args:
        rig: Robot and set-up.
        camera: Intrinsics of the masks.
        observations: At least one view.
        masks: The observations' masks, when another problem has prepared them already.

    Raises:
        InputError: No view, or a mask that does not have the camera's size or is no mask.
    """

    def __init__(
        self,
        rig: Rig,
        camera: Camera,
        observations: Sequence[Observation],
        masks: Sequence[MaskPyramid] | None = None,
    ) -> None:
        if not observations:
            raise InputError(
                "There is no view to solve for", expected="at least one view with a mask"
            )
        for i, o in enumerate(observations):
            _check(o, camera, f"view {o.id or i}")
        self.rig = rig
        self.camera = camera
        self.observations = tuple(observations)
        self.weights = np.array([o.weight for o in observations])
        self.Ts_mount_link = rig.Ts_mount_link(np.stack([o.joints for o in observations]))
        self.masks = (
            list(masks)
            if masks is not None
            else parallel_map(lambda o: MaskPyramid(o.mask, o.ignore), observations)
        )
        self.centre_mount = self._centre()
        self._renderers = {1: SilhouetteRenderer(rig.robot.meshes, camera)}

    def __len__(self) -> int:
        return len(self.observations)

    def centre_cam(self, T_cam_mount: F64) -> F64:
        """The middle of the arm over all views in the camera frame, ``(3,)`` metres."""
        return transform_points(T_cam_mount, self.centre_mount)

    def renderer(self, reduction: int) -> SilhouetteRenderer:
        """The renderer of the camera reduced in size by an integer."""
        if reduction not in self._renderers:
            camera = self.camera.scaled(1.0 / reduction)
            self._renderers[reduction] = self._renderers[1].with_camera(camera)
        return self._renderers[reduction]

    def gather(
        self,
        T_cam_mount: F64,
        reduction: int,
        *,
        smoothing_px: float,
        spacing: float,
        threads: bool = True,
    ) -> list[Evidence]:
        """Compare all views with the masks at a pose; see :func:`.evidence.gather`."""
        renderer = self.renderer(reduction)
        centre = self.centre_cam(T_cam_mount)

        def one(view: int) -> Evidence:
            return gather(
                renderer, reduction, self.masks[view], T_cam_mount @ self.Ts_mount_link[view],
                centre, smoothing_px=smoothing_px, spacing=spacing,
            )  # fmt: skip

        views = range(len(self))
        return parallel_map(one, views) if threads else [one(view) for view in views]

    def _centre(self) -> F64:
        meshes = self.rig.robot.meshes
        middles = np.stack([m.centroid for m in meshes])
        areas = np.array([m.area for m in meshes])
        # A view without weight shall not change even the last digits.
        counts = self.weights > 0.0
        Ts = self.Ts_mount_link[counts if counts.any() else ~counts]
        posed = np.einsum("vlij,lj->vli", Ts[..., :3, :3], middles) + Ts[..., :3, 3]
        return (areas[:, None] * posed).sum(axis=1).mean(axis=0) / areas.sum()


def _check(observation: Observation, camera: Camera, where: str) -> None:
    """Raise an `InputError` unless the mask, and the region to ignore, fit the camera."""
    size = (camera.height, camera.width)
    mask, ignore = observation.mask, observation.ignore
    for what, image in (("mask", mask), ("region to ignore", ignore)):
        if image is not None and image.shape != size:
            raise InputError(
                f"The {what} is {image.shape[-1]}x{image.shape[0]} pixels, "
                f"the camera {camera.width}x{camera.height}",
                where=where,
                expected="masks of the camera's size",
            )
    if mask.dtype != np.bool_ and not (mask.min() >= 0.0 and mask.max() <= 1.0):
        raise InputError(
            f"The mask's values run from {mask.min():g} to {mask.max():g}",
            where=where,
            expected="true and false, or numbers from 0 to 1",
        )
