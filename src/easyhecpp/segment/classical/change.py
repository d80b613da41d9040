"""Where two views of a still camera differ: the arm moved away, or moved in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from easyhecpp._parallel import parallel_map
from easyhecpp.segment.pictures import Pictures

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]

BLUR_PX = 0.8
NEIGHBOURHOOD_PX = 7
"""Reach of the local maximum; a little more than the blur spreads an edge."""

NOISE_FACTOR = 3.0
"""Differences of this many standard deviations are as likely a change as not."""

_STRONG_PERCENT, _SHARE_OF_STRONG = 90.0, 0.15
"""So are differences of this share of a strong one, that of the percentile over all that exceeds
the noise: an arm's shadow, and the light that it throws back, change a table over large areas, but
by less than the arm itself."""

_LIGHTNESS_AT_ZERO = np.array([16.0, 0.0, 0.0], np.float32)
_DEEPEST_SHADE = 0.8
"""Of (L + 16): half of the light."""
_TINT, _TINT_NOISE = 0.35, 1.4
"""Change of colour that a shadow may bring, as a share of the whole change and in noise."""

_MOST_PAIRED, _OTHERS = 12, 3


@dataclass(frozen=True)
class ChangeMaps:
    """Evidence for change between pairs of views.

    Attributes:
        pairs: ``(P, 2)`` view indices, first < second.
        maps: ``(P, H, W)`` float32 in [-1, 1]: positive where the views differ.
        reduction: Size reduction against the camera.
    """

    pairs: NDArray[np.int32]
    maps: F32
    reduction: int

    def reduced(self, factor: int) -> ChangeMaps:
        """The same evidence at a size ``factor`` times smaller."""
        height, width = self.maps.shape[1:]
        size = (max(1, round(width / factor)), max(1, round(height / factor)))
        maps = parallel_map(lambda m: cv2.resize(m, size, interpolation=cv2.INTER_AREA), self.maps)
        return ChangeMaps(self.pairs, np.stack(maps).astype(np.float32), self.reduction * factor)


def pairs_to_compare(motion: F64) -> NDArray[np.int32]:
    """Pairs of views ``(P, 2)``, first < second: all of them, or so many as add something.

    With more than 12 views, all pairs of the 12 that differ most in posture, and each other view
    with the three of these that it differs most from: evidence grows with the number of views, not
    with its square.

    Args:
        motion: ``(V, V)`` how far the arm moves between two views, in any unit.
    """
    n = len(motion)
    core = _far_apart(motion, _MOST_PAIRED)
    i, j = np.triu_indices(len(core), k=1)
    pairs = [np.column_stack([core[i], core[j]])]
    for view in np.setdiff1d(np.arange(n), core):
        others = core[np.argsort(-motion[view, core], kind="stable")[:_OTHERS]]
        pairs.append(np.column_stack([np.full(len(others), view), others]))
    found = np.sort(np.concatenate(pairs), axis=1)
    return found[np.lexsort((found[:, 1], found[:, 0]))].astype(np.int32)


def _far_apart(motion: F64, count: int) -> NDArray[np.intp]:
    """Views that differ from each other, each the farthest from those before it; sorted."""
    n = len(motion)
    if n <= count:
        return np.arange(n)
    chosen = [int(np.argmax(motion.sum(axis=1)))]
    while len(chosen) < count:
        nearest = motion[chosen].min(axis=0)
        nearest[chosen] = -1.0
        chosen.append(int(np.argmax(nearest)))
    return np.sort(np.array(chosen, np.intp))


def change_maps(
    pictures: Pictures, pairs: NDArray[np.int32], *, shadows: bool = True
) -> ChangeMaps:
    """Compare pairs of views.

    The difference of blurred pictures is held against half of its own maximum nearby: an edge then
    is where the difference crosses half of its height, however strong it is. A threshold from the
    noise alone would count the blur's tails and make everything too large, and shadows as well.

    Args:
        pictures: The views.
        pairs: ``(P, 2)`` of them.
        shadows: Whether what may be a shadow counts as change. Where arm and background look alike,
            the arm's shadow may change a picture more than the arm does, and moves with it in
            another way; but an arm whose colour is that of a shadow is lost with the shadows. What
            counts as strong is the same either way.
    """
    blurred = np.stack(parallel_map(lambda i: cv2.GaussianBlur(i, (0, 0), BLUR_PX), pictures.lab))
    sizes = parallel_map(lambda pair: _difference(blurred[pair[0]], blurred[pair[1]]), pairs)
    noise = pictures.noise * float(np.sqrt(2.0))
    floor = _least_change(sizes, NOISE_FACTOR * noise)
    maps = parallel_map(lambda size: _evidence(size, floor), sizes)
    if not shadows:
        shaded = parallel_map(
            lambda pair: _shaded(blurred[pair[0]], blurred[pair[1]], noise), pairs
        )
        maps = [np.where(s, np.minimum(m, 0.0), m) for m, s in zip(maps, shaded, strict=True)]
    return ChangeMaps(pairs, np.stack(maps), pictures.reduction)


def _shaded(a: F32, b: F32, noise: float) -> NDArray[np.bool_]:
    """Where two pictures ``(H, W, 3)``, in Lab, differ as the same thing does in light and shade.

    A shadow scales all of X, Y and Z, whose cube roots Lab is made of (but for dark colours): it
    scales ``(L + 16, a, b)``.
    """
    a, b = a + _LIGHTNESS_AT_ZERO, b + _LIGHTNESS_AT_ZERO
    darker = a[..., :1] < b[..., :1]
    dark, bright = np.where(darker, a, b), np.where(darker, b, a)
    shade: F32 = np.einsum("hwc,hwc->hw", dark, bright) / np.einsum("hwc,hwc->hw", bright, bright)
    tinted = _difference(dark, (shade[..., None] * bright).astype(np.float32))
    like = (shade > _DEEPEST_SHADE) & (tinted < _TINT * _difference(a, b) + _TINT_NOISE * noise)
    # Single pixels of a textured arm look shaded by chance.
    opened = cv2.morphologyEx(like.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    return np.asarray(opened, np.bool_)


def _difference(a: F32, b: F32) -> F32:
    difference = a - b
    return np.sqrt(np.einsum("hwc,hwc->hw", difference, difference))


def _least_change(sizes: Sequence[F32], noise: float) -> float:
    """The difference that is as likely a change as not."""
    above = np.concatenate([size[size > noise] for size in sizes])
    if len(above) == 0:
        return noise
    return max(noise, _SHARE_OF_STRONG * float(np.percentile(above, _STRONG_PERCENT)))


def _evidence(size: F32, floor: float) -> F32:
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (NEIGHBOURHOOD_PX, NEIGHBOURHOOD_PX))
    highest = cv2.GaussianBlur(cv2.dilate(size, kernel), (0, 0), 1.5)
    middle = np.maximum(0.5 * highest, floor)
    ratio = np.square(size / middle)
    return ((ratio - 1.0) / (ratio + 1.0)).astype(np.float32)
