"""The pictures of a still camera, and behind each contour the background that other views show."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy

import cv2
import numpy as np
from numpy.typing import NDArray

from easyhecpp._parallel import parallel_map
from easyhecpp.geometry import inverse
from easyhecpp.segment._plate_kernel import background_plate
from easyhecpp.segment.pictures import equalised, measured_noise
from easyhecpp.segment.scene import Scene

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
U8 = NDArray[np.uint8]

_MARGIN_PX = 4
_REACH_PX = 18


class Backgrounds:
    """Equalised pictures with the background behind the arm's contour.

    Args:
        scene: The arm in all views.
        images: ``(H, W, 3)`` uint8 RGB per view.
        T_mount_cam: ``(4, 4)`` present pose; says where the background is free of the arm.

    Attributes:
        values: ``(V, H, W, 3)`` float32, 0..255, see `equalised`.
        noise: Standard deviation of a channel.
        plates: Per view ``(H, W, 3)``, nan where no view shows the background, and away from the
            contour.
    """

    def __init__(self, scene: Scene, images: Sequence[U8], T_mount_cam: F64) -> None:
        self.scene = scene
        self.values: F32 = equalised(images)
        self.noise = measured_noise(self.values[:, ::2, ::2])
        self.plates: list[F32] = []
        self.look_behind(T_mount_cam)

    def with_scene(self, scene: Scene) -> Backgrounds:
        """The same pictures and plates, of an arm with other joints or through another lens."""
        other = copy(self)
        other.scene = scene
        return other

    def look_behind(self, T_mount_cam: F64) -> None:
        """Find the background anew for the contours at another pose."""
        covers = self.scene.coverages(inverse(T_mount_cam), 1)
        grow = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * _MARGIN_PX + 1,) * 2)
        wide = np.ones((2 * _REACH_PX + 1,) * 2, np.uint8)
        covered = np.stack(
            parallel_map(lambda c: cv2.dilate((c > 0.01).astype(np.uint8), grow), list(covers))
        ).astype(np.uint8)

        def one(view: int) -> F32:
            inside = (covers[view] > 0.5).astype(np.uint8)
            band = (cv2.dilate(inside, wide) - cv2.erode(inside, wide)).astype(np.uint8)
            plate = np.full((*band.shape, 3), np.nan, np.float32)
            background_plate(self.values, covered, view, band, self.noise, plate)
            return plate

        self.plates = parallel_map(one, range(len(self.scene)))
