"""The background behind the arm, from the views in which the arm is elsewhere."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from easyhecpp._parallel import parallel_map
from easyhecpp.render._jit import jit
from easyhecpp.segment.classical.change import NOISE_FACTOR
from easyhecpp.segment.classical.region import EvidenceMaker
from easyhecpp.segment.pictures import Pictures

F32 = NDArray[np.float32]
BoolArray = NDArray[np.bool_]

_LIMIT = 0.02


@jit
def plate_distance(
    lab: F32, covers: F32, view: int, band: NDArray[np.uint8], limit: float, out: F32
) -> None:
    """How unlike the background a view's pixels are, Lab units; nan where that is not known.

    The background may have several states (something else moves, too), so a pixel is held against
    the views without the arm there one by one, and the distance to the nearest but some counts: a
    quarter of them may resemble the arm without harm.

    Args:
        lab: ``(V, H, W, 3)``.
        covers: ``(V, H, W)`` coverage, grown by what the pose may be off.
        view: The view.
        band: ``(H, W)`` where to look; out is nan elsewhere.
        limit: Coverage up to which a view counts as without the arm.
        out: ``(H, W)``.
    """
    n, height, width = covers.shape
    found = np.empty(n, np.float32)
    for y in range(height):
        for x in range(width):
            out[y, x] = np.nan
            if band[y, x] == 0:
                continue
            count = 0
            for other in range(n):
                if other == view or covers[other, y, x] > limit:
                    continue
                a = lab[view, y, x, 0] - lab[other, y, x, 0]
                b = lab[view, y, x, 1] - lab[other, y, x, 1]
                c = lab[view, y, x, 2] - lab[other, y, x, 2]
                d = a * a + b * b + c * c
                at = count
                while at > 0 and found[at - 1] > d:
                    found[at] = found[at - 1]
                    at -= 1
                found[at] = d
                count += 1
            if count > 0:
                out[y, x] = np.sqrt(found[(count - 1) // 3])


@dataclass(frozen=True)
class PlateConfig:
    """How the plate is read; pixels of the level.

    Attributes:
        margin: How far the pose may be off.
        band: How far from the contour to look.
        neighbourhood: Reach of the local maximum that edges are held against half of.
    """

    margin: int
    band: int
    neighbourhood: int = 9


def plate_maker(pictures: Pictures, config: PlateConfig) -> EvidenceMaker:
    """Evidence for the arm from every pixel's difference to the background plate."""
    lab = np.stack(parallel_map(lambda i: cv2.GaussianBlur(i, (0, 0), 0.8), pictures.lab))
    floor = NOISE_FACTOR * pictures.noise * np.sqrt(2.0)
    grow = _square(config.margin)
    near = ellipse(config.neighbourhood)

    def make(covers: F32) -> list[F32]:
        grown = np.stack(parallel_map(lambda cover: cv2.dilate(cover, grow), covers))

        def one(view: int) -> F32:
            band = contour_band(covers[view], config.band)
            distance = np.empty(covers.shape[1:], np.float32)
            plate_distance(lab, grown, view, band, _LIMIT, distance)
            return contrast(distance, near, floor)

        return parallel_map(one, range(len(covers)))

    return make


def contrast(distance: F32, near: NDArray[np.uint8], floor: float) -> F32:
    """Distances as evidence in [-1, 1], against half of their maximum nearby; nan stays."""
    known = np.nan_to_num(distance, nan=0.0)
    highest = cv2.GaussianBlur(cv2.dilate(known, near), (0, 0), 1.5)
    ratio = np.square(distance / np.maximum(0.5 * highest, floor))
    return ((ratio - 1.0) / (ratio + 1.0)).astype(np.float32)


def contour_band(cover: F32, width: int) -> NDArray[np.uint8]:
    """Pixels within ``width`` of the coverage's outline, uint8."""
    inside = (cover > 0.5).astype(np.uint8)
    kernel = _square(width)
    return cv2.dilate(inside, kernel) - cv2.erode(inside, kernel)  # type: ignore[return-value]


def ellipse(width: int) -> NDArray[np.uint8]:
    """A disc to dilate with."""
    return cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (width, width)).astype(np.uint8)


def _square(reach: int) -> NDArray[np.uint8]:
    return np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
