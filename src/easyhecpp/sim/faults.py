"""Gross faults of masks: a link missing, a blob attached, holes.

Each takes and returns either a plain mask or a coverage in [0, 1]; apply them before the boundary
is made to wander (`easyhecpp.sim.masks`), so that the faults' outlines wander too.
"""

from __future__ import annotations

from typing import TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from easyhecpp.errors import InputError
from easyhecpp.sim.boundary import as_mask, find_contours

F64 = NDArray[np.float64]
AnyMask = TypeVar("AnyMask", NDArray[np.bool_], NDArray[np.float32])


def remove_link(truth: AnyMask, visible_links: NDArray[np.int16], link: int) -> AnyMask:
    """The mask of an arm of which the visible part of one link was missed.

    Args:
        truth: (H, W) mask or coverage.
        visible_links: (H, W) index of the nearest link at each pixel's centre.
        link: the link to remove.
    """
    faulty = truth.copy()
    faulty[visible_links == link] = 0
    return faulty


def add_blob(truth: AnyMask, rng: np.random.Generator, area_fraction: float = 0.15) -> AnyMask:
    """The mask with something attached to the arm that is not the arm.

    The blob is smooth and star-shaped around a point of the arm's outline.

    Args:
        truth: (H, W) mask or coverage.
        rng: chooses the place on the arm's outline, and the shape.
        area_fraction: area added, as a share of the mask's area.

    Raises:
        InputError: the mask is empty or fills the picture, or there is no room for the blob.
    """
    mask = as_mask(truth)
    contours = find_contours(truth)
    added = round(area_fraction * np.count_nonzero(mask))
    if not contours or added >= np.count_nonzero(~mask):
        raise InputError(
            f"a blob of {area_fraction:.0%} of the arm's area cannot be attached",
            expected="a mask with an outline, and room beside it",
        )
    centre = rng.choice(np.concatenate([contour.points for contour in contours]))
    distance, profile = _star(truth.shape, centre, rng)
    # The blob of scale s has the radius s * profile: pixels join it in the order of this ratio.
    ratio = distance / profile
    scale = np.partition(ratio[~mask], added)[added]
    blob = np.clip(scale * profile - distance + 0.5, 0.0, 1.0).astype(np.float32)
    added_to = np.maximum(truth, blob > 0.5 if truth.dtype == np.bool_ else blob)
    return cast(AnyMask, added_to)


def punch_holes(
    truth: AnyMask, rng: np.random.Generator, *, area_fraction: float = 0.05, count: int = 3
) -> AnyMask:
    """The mask with round holes, all of one size, somewhere in the arm.

    Args:
        truth: (H, W) mask or coverage.
        rng: chooses the places.
        area_fraction: area of all holes together as a share of the mask's area; less is lost
            where holes overlap or stick out of the arm.
        count: number of holes.
    """
    rows, columns = np.nonzero(as_mask(truth))
    faulty = truth.copy()
    if not len(rows):
        return faulty
    radius = np.sqrt(area_fraction * len(rows) / (np.pi * count))
    for chosen in rng.integers(len(rows), size=count):
        y, x = np.ogrid[: truth.shape[0], : truth.shape[1]]
        faulty[np.hypot(y - rows[chosen], x - columns[chosen]) <= radius] = 0
    return faulty


def _star(shape: tuple[int, ...], centre: F64, rng: np.random.Generator) -> tuple[F64, F64]:
    """(H, W) each pixel's distance from a centre (x, y), and a random radius in its direction."""
    y, x = np.ogrid[: shape[0], : shape[1]]
    x, y = x - centre[0], y - centre[1]
    direction = np.arctan2(y, x)
    profile = np.ones_like(direction)
    for waves in range(2, 6):
        amplitude, phase = rng.normal(0.0, 0.15) / (waves - 1), rng.uniform(0.0, 2.0 * np.pi)
        profile += amplitude * np.cos(waves * direction + phase)
    return np.hypot(x, y), np.maximum(profile, 0.2)
