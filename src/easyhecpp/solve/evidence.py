"""What an observed mask says along a predicted contour.

Two witnesses are read at each contour sample, both in pixels of outward displacement:

* the residual: the difference of observed and rendered mask, smoothed by a Gaussian and scaled so
  that a straight edge that is off by ``d`` gives ``d``. Its weighted sum is the gradient of the
  paper's loss (Eq. 1) on smoothed masks, so its root is that loss' minimum, without bias;
* the signed distance to the observed outline, which does not saturate: it pulls from afar and tells
  outliers.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from easyhecpp.render import Contour, SilhouetteRenderer
from easyhecpp.solve._evidence_kernel import bilinear, compare, covered_box

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]

_SQRT_2PI = float(np.sqrt(2.0 * np.pi))
_ALL_COUNT = np.zeros((0, 0), np.float32)


def signed_distance(mask: F32) -> F32:
    """Signed distance to a mask's outline, positive inside, pixels; ``(H, W)`` float32.

    The outline runs between pixels, half a pixel from the centres on either side. The image's own
    edge is no outline. A mask that is all one value is infinitely far from its outline; the
    distance is then +-(H + W).
    """
    inside = (mask > 0.5).astype(np.uint8)
    far = float(sum(mask.shape))
    if not inside.any():
        return np.full(mask.shape, -far, np.float32)
    if inside.all():
        return np.full(mask.shape, far, np.float32)
    to_outside = cv2.distanceTransform(inside, cv2.DIST_L2, cv2.DIST_MASK_5)
    to_inside = cv2.distanceTransform(1 - inside, cv2.DIST_L2, cv2.DIST_MASK_5)
    return np.where(inside > 0, to_outside - 0.5, 0.5 - to_inside).astype(np.float32)


def sample(image: F32, points: F64) -> F64:
    """Bilinear samples of ``(H, W)`` at pixel positions ``(N, 2)``; clamped at the image's edge."""
    return _sample(image, points, 0, 0)


def _sample(image: F32, points: F64, left: int, top: int) -> F64:
    """The same for an image whose first pixel lies at ``(left, top)``."""
    out = np.empty(len(points))
    bilinear(image, points, float(left), float(top), out)
    return out


@dataclass(frozen=True)
class MaskLevel:
    """A mask at one size.

    Attributes:
        mask: ``(H, W)`` in [0, 1].
        usable: ``(H, W)`` share of each pixel that counts, or None when all do.
        area: Of the mask, pixels.
    """

    mask: F32
    usable: F32 | None
    area: float


class MaskPyramid:
    """One view's mask at the levels of the optimisation, with its signed distance.

    Args:
        mask: ``(H, W)`` bool or float in [0, 1].
        ignore: ``(H, W)`` bool or None.
    """

    def __init__(self, mask: NDArray[np.generic], ignore: NDArray[np.bool_] | None) -> None:
        self.full: F32 = np.ascontiguousarray(mask, dtype=np.float32)
        self.distance = signed_distance(self.full)
        self.is_hard = mask.dtype == np.bool_
        self.ignore = None if ignore is None or not ignore.any() else ignore
        self._levels: dict[int, MaskLevel] = {}

    def level(self, reduction: int) -> MaskLevel:
        """The mask reduced in size by ``reduction``."""
        if reduction not in self._levels:
            mask = _reduce(self.full, reduction)
            usable = None if self.ignore is None else 1.0 - self.ignore.astype(np.float32)
            self._levels[reduction] = MaskLevel(
                mask,
                None if usable is None else _reduce(usable, reduction),
                float(mask.sum(dtype=np.float64)),
            )
        return self._levels[reduction]


def _reduce(image: F32, reduction: int) -> F32:
    if reduction == 1:
        return image
    height, width = image.shape
    size = (max(1, round(width / reduction)), max(1, round(height / reduction)))
    return cv2.resize(image, size, interpolation=cv2.INTER_AREA)  # type: ignore[return-value]


@dataclass(frozen=True)
class Evidence:
    """Contour samples of one view with what the mask says there; pixels of the full image.

    Attributes:
        contour: The samples (in pixels of the level they were rendered at).
        points: ``(N, 2)`` full-size pixels.
        jacobians: ``(N, 6)`` full-size pixels.
        residuals: ``(N,)`` smoothed difference, full-size pixels.
        distances: ``(N,)`` signed distance of the sample from the observed outline.
        length: Contour length per sample, full-size pixels.
        mismatch: Sum of squared differences of the masks (the paper's loss), full-size pixels.
        iou: Intersection over union, soft.
    """

    contour: Contour
    points: F64
    jacobians: F64
    residuals: F64
    distances: F64
    length: float
    mismatch: float
    iou: float


def gather(
    renderer: SilhouetteRenderer,
    reduction: int,
    view: MaskPyramid,
    Ts_cam_link: F64,
    centre_cam: F64,
    *,
    smoothing_px: float,
    spacing: float,
) -> Evidence:
    """Render one view and read the mask along its outer contour.

    Args:
        renderer: For the camera scaled by ``1 / reduction``.
        reduction: Size reduction of the level.
        view: The observed mask.
        Ts_cam_link: ``(L, 4, 4)``.
        centre_cam: ``(3,)`` centre of rotation of the Jacobians.
        smoothing_px: Standard deviation of the Gaussian, pixels of the level; 0 leaves the
            residuals out (they are zero then).
        spacing: Distance of the samples, pixels of the level.
    """
    observed = view.level(reduction)
    contour, coverage = renderer.contour(Ts_cam_link, centre_cam, spacing=spacing)
    rows, columns = _window(coverage, int(np.ceil(4 * smoothing_px)) + 2)
    usable = _ALL_COUNT if observed.usable is None else observed.usable
    difference = np.empty((rows.stop - rows.start, columns.stop - columns.start), np.float32)
    # Cut the rendered mask as the observed one was cut: then what a threshold does to an edge is
    # in both and cancels, instead of being noise of a tenth of a pixel.
    cut = view.is_hard and reduction == 1
    squares, both, shown, seen = compare(
        observed.mask, coverage, usable, rows.start, columns.start, cut, difference
    )
    beyond = observed.area - seen
    union = observed.area + shown - both
    residuals = np.zeros(len(contour))
    if smoothing_px > 0.0:
        smooth = cv2.GaussianBlur(difference, (0, 0), smoothing_px, borderType=cv2.BORDER_REPLICATE)
        step = _sample(smooth, contour.points, columns.start, rows.start)  # type: ignore[arg-type]
        residuals = _SQRT_2PI * smoothing_px * step
    points = (contour.points + 0.5) * reduction - 0.5
    keep = slice(None)
    if view.ignore is not None:
        reach = view.ignore.astype(np.uint8)
        grown = cv2.dilate(reach, np.ones((7, 7), np.uint8)).astype(np.float32)
        keep = sample(grown, points) < 0.5
    kept = Contour(
        contour.points[keep], contour.normals[keep], contour.links[keep],
        contour.jacobians[keep], contour.points_cam[keep], contour.spacing,
    )  # fmt: skip
    points = points[keep]
    return Evidence(
        contour=kept,
        points=points,
        jacobians=kept.jacobians * reduction,
        residuals=residuals[keep] * reduction,
        distances=sample(view.distance, points),
        length=contour.spacing * reduction,
        mismatch=(squares + beyond) * reduction**2,
        iou=both / union if union > 0 else 0.0,
    )


def _window(coverage: F32, margin: int) -> tuple[slice, slice]:
    """Rows and columns that hold everything the samples can see.

    Starts from the rendered arm's box, as parts of the contour may lie outside of the image.
    """
    height, width = coverage.shape
    top, bottom, left, right = covered_box(coverage)
    if bottom < top:
        return slice(0, height), slice(0, width)
    return (
        slice(max(0, top - margin), min(height, bottom + margin + 1)),
        slice(max(0, left - margin), min(width, right + margin + 1)),
    )
