"""Masks of the arm at a known pose, from the difference to the background."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from easyhecpp._parallel import parallel_map
from easyhecpp.geometry import inverse
from easyhecpp.segment.backgrounds import Backgrounds
from easyhecpp.segment.classical.change import NOISE_FACTOR
from easyhecpp.segment.classical.plate import contour_band, contrast, ellipse
from easyhecpp.segment.protocols import ViewMask
from easyhecpp.solve.evidence import signed_distance

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]

_BAND_PX = 10
_PULL = 3.0
"""Log-odds of clear evidence; against the rendered mask's half per pixel of distance."""

_PRIOR_PER_PX = 0.5

NO_ARM = "The picture does not tell the arm from the background where the pose puts it."
_APART_PX = 2.0
_LEAST_CONTRAST = 0.2
"""By how much the evidence, -1 to 1, must be higher inside of the predicted outline than outside.
Pictures in which the arm can be seen have 0.4 to 1.1, black or shifted ones up to 0.15."""

_NEIGHBOURHOOD = ellipse(11)


def masks_at(backgrounds: Backgrounds, T_mount_cam: F64, ids: Sequence[str]) -> list[ViewMask]:
    """Masks of all views, for a pose that is off by a few pixels at most.

    Near the predicted contour a pixel belongs to the arm when it differs from the background there
    by more than half of what its surroundings do, weighed against its distance to the predicted
    contour. Where no view shows the background, the prediction is filled in and marked as saying
    nothing. A view whose picture does not tell inside from outside gets no mask: it would be the
    prediction again, which agrees with itself.

    Args:
        backgrounds: The pictures and what is behind the arm.
        T_mount_cam: ``(4, 4)``.
        ids: Names of the views.
    """
    scene = backgrounds.scene
    covers = scene.coverages(inverse(T_mount_cam), 1)
    floor = NOISE_FACTOR * backgrounds.noise * np.sqrt(2.0)

    def one(view: int) -> ViewMask:
        cover = covers[view]
        if not (cover > 0.5).any():
            return ViewMask(ids[view], None, score=0.0, notes=("The arm is not in this view.",))
        difference = backgrounds.values[view] - backgrounds.plates[view]
        distance = np.sqrt(np.einsum("hwc,hwc->hw", difference, difference))
        evidence = contrast(distance, _NEIGHBOURHOOD, floor)
        band = contour_band(cover, _BAND_PX) > 0
        unknown = band & np.isnan(evidence)
        depth = signed_distance(cover)
        decided = band & ~unknown
        if not _shows_the_arm(evidence[decided], depth[decided]):
            return ViewMask(ids[view], None, score=0.0, notes=(NO_ARM,))
        logit = _PULL * np.nan_to_num(evidence) + _PRIOR_PER_PX * depth
        mask = cover > 0.5
        mask[decided] = logit[decided] > 0.0
        mask = cv2.medianBlur(mask.astype(np.uint8), 5) > 0
        agree = (mask == (cover > 0.5)) & decided
        score = float(agree.sum() / max(decided.sum(), 1))
        share = float(unknown.sum() / max(band.sum(), 1))
        notes = (
            (f"No view shows what is behind {share:.0%} of the contour.",) if share > 0.5 else ()
        )
        return ViewMask(ids[view], mask, unknown, score, notes)

    return parallel_map(one, range(len(scene)))


def _shows_the_arm(evidence: F32, depth: F32) -> bool:
    """Whether the evidence is higher inside of the predicted outline than outside.

    Args:
        evidence: ``(N,)`` of pixels near the outline.
        depth: ``(N,)`` how far inside of it they lie, pixels.
    """
    inside, outside = evidence[depth > _APART_PX], evidence[depth < -_APART_PX]
    if len(inside) == 0 or len(outside) == 0:
        return True  # the arm fills the picture or is a line: nothing to compare
    return float(inside.mean() - outside.mean()) > _LEAST_CONTRAST
