"""Masks made worse on purpose, as a segmenter would: boundaries that wander, parts missing, blobs.

The boundary's displacement is a random function of arc length ALONG the contour, so the two sides
of a thin link wander apart, as they do in real masks. It is a sum, in equal parts of variance, of
Gaussian processes with zero mean, one for each correlation length: the distance along the contour
at which the correlation has fallen to 1 / e. A pixel belongs to the worse mask when its signed
distance from the true boundary, known to a fraction of a pixel, plus the displacement at the
nearest point of that boundary is positive; without displacement the mask comes back unchanged.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from easyhecpp.errors import InputError
from easyhecpp.sim.boundary import (
    Contour,
    Mask,
    Truth,
    as_mask,
    draw_noise,
    find_band,
    find_contours,
)

F64 = NDArray[np.float64]


@dataclass(frozen=True)
class Degradation:
    """How far the boundaries of masks wander.

    Attributes:
        iou: mean IoU with the true masks that wandering alone brings about; 1 for no wandering.
        correlation_px: correlation lengths of the displacement, in equal parts.
        bias_px: constant displacement on top of it, outwards, pixels.
    """

    iou: float = 0.982
    correlation_px: tuple[float, ...] = (2.0, 6.0, 15.0, 40.0)
    bias_px: float = 0.0

    def __post_init__(self) -> None:
        if not 0.5 <= self.iou <= 1.0:
            raise InputError(f"the wanted IoU is {self.iou}", expected="a number from 0.5 to 1")
        if not self.correlation_px or min(self.correlation_px) < 1.0:
            raise InputError(
                f"the correlation lengths are {self.correlation_px}",
                expected="one or more lengths of at least a pixel",
            )


@dataclass(frozen=True)
class DegradedMasks:
    """Masks whose boundaries have wandered.

    Attributes:
        masks: the masks.
        sigma_px: standard deviation of the displacement, the same for all of them.
    """

    masks: tuple[Mask, ...]
    sigma_px: float


def degrade_masks(
    truths: Sequence[Truth], rng: np.random.Generator, degradation: Degradation
) -> DegradedMasks:
    """Let the boundaries of several masks wander, all equally far, to the wanted MEAN IoU.

    Args:
        truths: (H, W) each: coverage in [0, 1]; or plain masks, whose boundaries are then known
            less well and are taken to be smooth.
        rng: all randomness comes from here.
        degradation: how far, with which correlation lengths, and by what bias.
    """
    contours = [find_contours(truth) for truth in truths]
    largest = _largest_sigma(truths, contours, degradation.iou)
    # Beyond five standard deviations, displacements are cut off.
    width = 5.0 * largest + abs(degradation.bias_px)
    bands = [find_band(t, c, width) for t, c in zip(truths, contours, strict=True)]
    noises = [
        band.at_pixels(draw_noise(pieces, degradation.correlation_px, rng))
        for band, pieces in zip(bands, contours, strict=True)
    ]

    def mean_iou(sigma: float) -> float:
        return float(np.mean([b.iou(sigma * n) for b, n in zip(bands, noises, strict=True)]))

    sigma = _where_it_falls_to(degradation.iou, mean_iou, largest)
    displaced = (
        band.displaced(sigma * noise + degradation.bias_px)
        for band, noise in zip(bands, noises, strict=True)
    )
    return DegradedMasks(tuple(displaced), sigma)


def degrade_mask(
    truth: Truth,
    rng: np.random.Generator,
    *,
    iou: float = 0.982,
    correlation_px: tuple[float, ...] = (2.0, 6.0, 15.0, 40.0),
    bias_px: float = 0.0,
) -> Mask:
    """Let the boundary of one mask wander; see `degrade_masks` and `Degradation`."""
    return degrade_masks([truth], rng, Degradation(iou, correlation_px, bias_px)).masks[0]


def _largest_sigma(truths: Sequence[Truth], contours: Sequence[list[Contour]], iou: float) -> float:
    """An upper bound for the standard deviation that leads to this IoU.

    While displacements are small against the arm's width, each view's IoU is one minus length of
    boundary times mean absolute displacement (0.8 standard deviations) over area; the factor
    leaves room for boundaries whose displacements overlap.
    """
    ratios = [
        np.count_nonzero(as_mask(truth)) / sum(piece.length_px for piece in pieces)
        for truth, pieces in zip(truths, contours, strict=True)
        if pieces
    ]
    return 2.5 * (1.0 - iou) * max(ratios, default=0.0) / 0.8


def _where_it_falls_to(wanted: float, function: Callable[[float], float], high: float) -> float:
    """The x between 0 and `high` at which a falling function has fallen to `wanted`."""
    low = 0.0
    for _ in range(24):
        middle = (low + high) / 2.0
        low, high = (middle, high) if function(middle) > wanted else (low, middle)
    return low
