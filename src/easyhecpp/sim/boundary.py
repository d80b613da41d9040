"""The boundary of a mask, known to a fraction of a pixel, and random displacements along it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import contourpy
import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

F64 = NDArray[np.float64]
Mask = NDArray[np.bool_]
Truth = NDArray[np.float32] | Mask
"""A mask, or better, the coverage that it is the threshold of: (H, W), bool or in [0, 1]."""

SPACING_PX = 0.5
"""Distance of the points that stand for the boundary."""

# Distance from the boundary of a pixel whose centre would else be on its wrong side or on it.
_SMALLEST_DISTANCE_PX = 1e-6


@dataclass(frozen=True)
class Contour:
    """One piece of a boundary: points about `SPACING_PX` apart, pixel coordinates.

    Attributes:
        points: (M, 2) x, y; the last of a closed contour is not the first again.
        is_closed: false for a contour that ends at the picture's border.
    """

    points: F64
    is_closed: bool

    @property
    def length_px(self) -> float:
        """Length of the contour."""
        ends = np.roll(self.points, -1, axis=0) if self.is_closed else self.points[1:]
        return float(np.linalg.norm(ends - self.points[: len(ends)], axis=1).sum())


@dataclass(frozen=True)
class Band:
    """The pixels near the boundary of a mask.

    Attributes:
        mask: (H, W) the mask.
        rows: (K,) of the pixels.
        columns: (K,) of the pixels.
        distances: (K,) signed distance of their centres from the boundary, pixels, inside positive.
        before: (K,) the nearest bit of boundary lies between this point of all contours' points...
        after: (K,) ...and this one...
        shares: (K,) ...so far along, 0 to 1.
    """

    mask: Mask
    rows: NDArray[np.int64]
    columns: NDArray[np.int64]
    distances: F64
    before: NDArray[np.int64]
    after: NDArray[np.int64]
    shares: F64

    def at_pixels(self, along: F64) -> F64:
        """(K,) values at the pixels' nearest boundary points of a function given along it."""
        return (1.0 - self.shares) * along[self.before] + self.shares * along[self.after]

    def displaced(self, displacement: F64) -> Mask:
        """The mask with its boundary moved outwards by (K,) `displacement` pixels."""
        mask = self.mask.copy()
        mask[self.rows, self.columns] = self.distances + displacement > 0.0
        return mask

    def iou(self, displacement: F64) -> float:
        """IoU of the mask and `displaced(displacement)`."""
        before = self.distances > 0.0
        after = self.distances + displacement > 0.0
        area = np.count_nonzero(self.mask)
        lost, gained = np.count_nonzero(before & ~after), np.count_nonzero(after & ~before)
        return (area - lost) / max(1, area + gained)


def find_contours(truth: Truth) -> list[Contour]:
    """Contours between the pixels inside and outside, to a fraction of a pixel."""
    if min(truth.shape) < 2:
        return []
    lines = contourpy.contour_generator(z=_level_function(truth), name="serial").lines(0.0)
    return [_resampled(np.asarray(line, dtype=np.float64)) for line in lines if len(line) > 1]


def find_band(truth: Truth, contours: Sequence[Contour], width_px: float) -> Band:
    """Pixels whose centres are within about `width_px` of the contours, and how far they are."""
    mask = as_mask(truth)
    near = np.zeros_like(mask)
    if contours:
        for side in (mask, ~mask):
            distance = cv2.distanceTransform(side.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5)
            near |= side & (distance <= width_px + 1.0)
    rows, columns = np.nonzero(near)
    pixels = np.stack([columns, rows], axis=1).astype(np.float64)
    distances, before, after, shares = _nearest(pixels, contours)
    distances = np.maximum(distances, _SMALLEST_DISTANCE_PX)
    signed = np.where(mask[rows, columns], distances, -distances)
    return Band(mask, rows, columns, signed, before, after, shares)


def draw_noise(
    contours: Sequence[Contour], correlation_px: Sequence[float], rng: np.random.Generator
) -> F64:
    """Random displacement along the contours with zero mean and unit variance.

    A sum, in equal parts of variance, of Gaussian processes with autocovariance exp(-(s / l)^2) of
    arc length s, one for each correlation length l. Contours are independent of each other.

    Args:
        contours: the pieces of boundary.
        correlation_px: the correlation lengths, pixels.
        rng: all randomness comes from here.

    Returns:
        (sum of M,) values at the points of all contours, one after the other.
    """
    noise = [np.empty(0)]
    for contour in contours:
        count = len(contour.points)
        spacing = contour.length_px / (count if contour.is_closed else max(1, count - 1))
        parts = [
            _gaussian_process(count, max(spacing, 1e-6), length, contour.is_closed, rng)
            for length in correlation_px
        ]
        noise.append(np.sum(parts, axis=0) / np.sqrt(len(parts)))
    return np.concatenate(noise)


def as_mask(truth: Truth) -> Mask:
    """(H, W) bool: pixels that are inside, or covered by more than half."""
    return truth > 0.5


def _level_function(truth: Truth) -> F64:
    """A function whose zero, interpolated linearly between pixel centres, is the boundary.

    An edge that crosses a row of pixels at the distance e from a pixel's centre covers 1/2 + e of
    that pixel and all or none of the next. Interpolating the coverage itself would be wrong by up
    to 0.09 px; e / (1 - |e|) makes it exact for edges along the grid and nearly so for others.
    A plain mask does not say where within a pixel the boundary is: it is smoothed.
    """
    if truth.dtype == np.bool_:
        soft = cv2.GaussianBlur(truth.astype(np.float64), (0, 0), 1.0)
        return soft - 0.5
    excess = np.clip(truth.astype(np.float64), 0.0, 1.0) - 0.5
    return excess / (1.0 - np.abs(excess))


def _resampled(line: F64) -> Contour:
    """A polyline with points at equal distances of about `SPACING_PX`."""
    is_closed = bool(np.array_equal(line[0], line[-1]))
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    steps = max(4, round(arc[-1] / SPACING_PX))
    at = np.linspace(0.0, arc[-1], steps + 1)[: steps if is_closed else steps + 1]
    return Contour(np.stack([np.interp(at, arc, axis) for axis in line.T], axis=1), is_closed)


def _nearest(
    pixels: F64, contours: Sequence[Contour]
) -> tuple[F64, NDArray[np.int64], NDArray[np.int64], F64]:
    """Distance of each pixel from the contours, and where the nearest point lies on them."""
    if not len(pixels):
        return np.empty(0), np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0)
    points = np.concatenate([contour.points for contour in contours])
    preceding, following = _neighbours(contours)
    nearest = KDTree(points).query(pixels)[1]
    # The nearest bit of the polyline ends at the nearest point, or starts there.
    ending = _to_segment(pixels, points[preceding[nearest]], points[nearest])
    starting = _to_segment(pixels, points[nearest], points[following[nearest]])
    starts = starting[0] < ending[0]
    distances, shares = np.where(starts, starting, ending)
    before = np.where(starts, nearest, preceding[nearest])
    return distances, before, np.where(starts, following[nearest], nearest), shares


def _neighbours(
    contours: Sequence[Contour],
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Indices of the points before and after each; an open end is its own neighbour."""
    preceding, following = [], []
    first = 0
    for contour in contours:
        index = np.arange(first, first + len(contour.points))
        before, after = np.roll(index, 1), np.roll(index, -1)
        if not contour.is_closed:
            before[0], after[-1] = index[0], index[-1]
        preceding.append(before)
        following.append(after)
        first += len(index)
    return np.concatenate(preceding), np.concatenate(following)


def _to_segment(pixels: F64, a: F64, b: F64) -> F64:
    """(2, K) distance of each pixel from its segment, and the share along it of the foot."""
    along = b - a
    squared = np.maximum((along**2).sum(axis=1), 1e-18)
    share = np.clip(((pixels - a) * along).sum(axis=1) / squared, 0.0, 1.0)
    return np.stack([np.linalg.norm(pixels - a - share[:, None] * along, axis=1), share])


def _gaussian_process(
    count: int, spacing: float, length: float, is_closed: bool, rng: np.random.Generator
) -> F64:
    """(count,) values, `spacing` apart, of a process with autocovariance exp(-(s / length)^2).

    Made on a circle by shaping the spectrum of white noise; an open line is a part of a circle
    that is longer by more than the correlation reaches.
    """
    around = count if is_closed else count + int(np.ceil(4.0 * length / spacing))
    steps = np.arange(around)
    distance = spacing * np.minimum(steps, around - steps)
    spectrum = np.maximum(np.fft.rfft(np.exp(-((distance / length) ** 2))).real, 0.0)
    white = rng.standard_normal(around)
    process = np.fft.irfft(np.fft.rfft(white) * np.sqrt(spectrum), around)
    # On a circle not much longer than the correlation, cutting off what is negative adds variance.
    variance = np.fft.irfft(spectrum, around)[0]
    return process[:count] / np.sqrt(variance)
