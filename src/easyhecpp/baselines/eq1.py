"""Eq. 1 of the paper for one view: the squared difference of masks, summed over the pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from easyhecpp.camera import Camera
from easyhecpp.errors import InputError
from easyhecpp.render import SilhouetteRenderer
from easyhecpp.rig import Rig
from easyhecpp.solve import Observation

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]

Combine = Literal["union", "sum"]
COMBINE = ("union", "sum")


@dataclass(frozen=True, eq=False)
class Eq1View:
    """One view, ready to be compared at any pose.

    Attributes:
        renderers: One of all links (exact union), or one for each link, to be added up and cut off
            at 1.
        Ts_mount_link: For each renderer the ``(L, 4, 4)`` poses of its links.
        mask: ``(H * W,)``.
        kept: ``(H * W,)`` 0 where the mask says nothing, else 1; None when it speaks everywhere.
    """

    renderers: tuple[SilhouetteRenderer, ...]
    Ts_mount_link: tuple[F64, ...]
    mask: F32
    kept: F32 | None

    def __call__(self, T_cam_mount: F64) -> tuple[float, F64]:
        """The sum of squares, and its derivative ``(6,)``.

        The derivative is by ``delta = [v, w]`` of ``exp(delta) @ T_cam_mount``. Where a sum of
        links exceeds 1 it is zero, as that of a clamp.
        """
        rendered = [
            renderer.coverage_with_sparse_jacobian(T_cam_mount @ Ts_mount_link, np.zeros(3))
            for renderer, Ts_mount_link in zip(self.renderers, self.Ts_mount_link, strict=True)
        ]
        total = rendered[0][0].ravel()
        for coverage, _, _ in rendered[1:]:
            total += coverage.ravel()
        difference = np.minimum(total, 1.0) if len(rendered) > 1 else total
        difference = np.subtract(difference, self.mask)
        if self.kept is not None:
            difference *= self.kept
        derivative = np.zeros(6)
        for _, pixels, rows in rendered:
            here = 2.0 * difference[pixels]
            if len(rendered) > 1:
                here[total[pixels] > 1.0] = 0.0
            derivative += here @ rows
        return float(difference @ difference), derivative


def eq1_views(
    rig: Rig, camera: Camera, observations: Sequence[Observation], combine: Combine
) -> list[Eq1View]:
    """Prepare views.

    Args:
        rig: Robot and set-up.
        camera: Intrinsics.
        observations: Views with masks.
        combine: ``union`` of the links, or ``sum``: `min(1, sum)` of each link's silhouette.

    Raises:
        InputError: No view, a mask whose size is not the camera's, or an unknown way to combine.
    """
    _check(camera, observations, combine)
    meshes = rig.robot.meshes
    groups = [slice(i, i + 1) for i in range(len(meshes))] if combine == "sum" else [slice(None)]
    renderers = tuple(SilhouetteRenderer(meshes[group], camera) for group in groups)
    views = []
    for o in observations:
        Ts_mount_link = rig.Ts_mount_link(o.joints)
        mask = np.array(o.mask, np.float32).ravel()
        kept = None if o.ignore is None else (~o.ignore).astype(np.float32).ravel()
        views.append(
            Eq1View(renderers, tuple(Ts_mount_link[group] for group in groups), mask, kept)
        )
    return views


def _check(camera: Camera, observations: Sequence[Observation], combine: str) -> None:
    if combine not in COMBINE:
        raise InputError(f"Unknown way {combine!r} to combine links", expected=" or ".join(COMBINE))
    if not observations:
        raise InputError("There is no view to calibrate with", expected="one or more masks")
    for index, o in enumerate(observations):
        if np.shape(o.mask) != (camera.height, camera.width):
            raise InputError(
                f"The mask of view {o.id or index} has the shape {np.shape(o.mask)}",
                expected=f"({camera.height}, {camera.width}), the camera's",
            )
