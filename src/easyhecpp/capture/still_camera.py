"""Whether the camera stood still: what is behind the arm lies in the same place in every picture.

Corners are followed from picture to picture. The arm and other things that move take theirs along,
each its own way; what most of the corners do, all over the picture, is what the camera did.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import fft

from easyhecpp._parallel import parallel_map
from easyhecpp.capture._text import listing

U8 = NDArray[np.uint8]
F32 = NDArray[np.float32]

STILL_PX = 1.5
"""A background displaced by less counts as still, pixels of the full picture."""

LARGEST_SHARE_MOVED = 0.26
"""With more views than this displaced the camera was moved for good, not for a moment."""

_WIDTH = 640
_SMOOTHING_PX, _LEAST_CONTRAST = 8.0, 6.0
_MOST_CORNERS = 300
_REFERENCES = 6
"""Most views that all others are compared with."""

_FEWEST_CORNERS, _LEAST_SHARE, _LEAST_SPAN = 20, 0.2, 0.4
"""Followed corners that a displacement needs: how many, as a share of all, and how far they
reach over the picture, so that no single thing that moves passes for the background."""

_BACK_AND_FORTH_PX, _INLIER_PX = 0.3, 1.0
_SAME_MOVE = 0.1
_LIKELY = 3


@dataclass(frozen=True)
class Backdrop:
    """A picture reduced to what shows whether the camera moved.

    Attributes:
        view: Id of the view.
        grey: ``(h, w)`` uint8, at most 640 wide, with its light and contrast evened out.
        corners: ``(N, 1, 2)`` float32 points to follow, pixels of ``grey``.
        scale: Pixels of the picture per pixel of ``grey``.
    """

    view: str
    grey: U8
    corners: F32
    scale: float

    @staticmethod
    def of(view: str, image: U8) -> Backdrop:
        """Reduce one picture ``(H, W, 3)`` uint8 RGB."""
        grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
        height, width = grey.shape
        scale = max(1.0, width / _WIDTH)
        size = (max(1, round(width / scale)), max(1, round(height / scale)))
        small = cv2.resize(grey, size, interpolation=cv2.INTER_AREA).astype(np.float32)
        mean = cv2.GaussianBlur(small, (0, 0), _SMOOTHING_PX)
        variance = cv2.GaussianBlur(small * small, (0, 0), _SMOOTHING_PX) - mean * mean
        even = (small - mean) / np.sqrt(np.maximum(variance, 0.0) + _LEAST_CONTRAST**2)
        flat = np.clip(127.5 + 50.0 * even, 0.0, 255.0).astype(np.uint8)
        corners: Any = cv2.goodFeaturesToTrack(flat, _MOST_CORNERS, 0.05, 8.0, blockSize=5)
        if corners is None:  # a picture without any texture
            corners = np.zeros((0, 1, 2), np.float32)
        return Backdrop(view, flat, np.asarray(corners, np.float32), scale)


@dataclass(frozen=True)
class CameraMoves:
    """In which views the camera stood elsewhere than in most.

    Attributes:
        moved: By how many pixels the background is displaced, by view id.
        n_views: How many views were looked at.
    """

    moved: dict[str, float]
    n_views: int

    @property
    def for_good(self) -> bool:
        """Whether so many views are displaced that the camera has a second place."""
        return len(self.moved) > max(1.0, LARGEST_SHARE_MOVED * self.n_views)

    @property
    def text(self) -> str:
        """What was found, without a full stop."""
        low, high = min(self.moved.values()), max(self.moved.values())
        about = f"{high:.0f} px" if high - low < 0.2 * high else f"{low:.0f} to {high:.0f} px"
        views = f"view{'s' if len(self.moved) > 1 else ''} {listing(self.moved)}"
        return f"The camera moved in {views} by about {about}, against the other views"


def camera_moves(backdrops: Sequence[Backdrop]) -> CameraMoves:
    """Find the views whose background is displaced against that of the largest group of views.

    A view of which nothing can be said, for lack of texture or because too little of the background
    can be seen, counts as not moved. So do all where no two views show the background in one place.

    Args:
        backdrops: Of all views of one recording with a still camera.
    """
    n = len(backdrops)
    nothing = CameraMoves({}, n)
    if n < 3 or len({b.grey.shape for b in backdrops}) > 1:
        return nothing
    references = np.unique(np.linspace(0, n - 1, min(n, _REFERENCES)).round().astype(int)).tolist()
    relations = _compared(backdrops, references[:1])
    if all(relations[0, v] == "still" for v in range(1, n)):
        return nothing
    relations |= _compared(backdrops, references[1:])
    still = {r: {v for v in range(n) if v == r or relations[r, v] == "still"} for r in references}
    home = max(references, key=lambda r: len(still[r]))
    anchors = [r for r in references if r in still[home]]
    if len(still[home]) < 2:
        return nothing
    moved = {}
    for view in range(n):
        seen = [relations[r, view] for r in anchors if r != view]
        steps = [s for s in seen if isinstance(s, tuple)]
        if view in still[home] or len(steps) < 2 or len(steps) <= seen.count("still"):
            continue
        step = np.median(steps, axis=0)
        size = float(np.linalg.norm(step))
        # The arm's own motion differs from view to view, the camera's is the same against all.
        off = np.linalg.norm(np.array(steps) - step, axis=1)
        if size > STILL_PX and np.mean(off < max(STILL_PX, _SAME_MOVE * size)) > 0.5:
            moved[backdrops[view].view] = size
    return CameraMoves(moved, n)


Relation = tuple[float, float] | Literal["still"] | None
"""How the background of a view lies against another's: displaced by pixels of the full picture,
still, or not known."""


def _compared(
    backdrops: Sequence[Backdrop], references: Sequence[int]
) -> dict[tuple[int, int], Relation]:
    """Relations of all views to some, by ``(reference, view)``."""
    pairs = [(r, v) for r in references for v in range(len(backdrops)) if v != r]
    found: list[Relation] = parallel_map(
        lambda pair: _relation(backdrops[pair[0]], backdrops[pair[1]]), pairs
    )
    return dict(zip(pairs, found, strict=True))


def _relation(a: Backdrop, b: Backdrop) -> Relation:
    """How the background of ``b`` lies against that of ``a``."""
    if len(a.corners) < _FEWEST_CORNERS:
        return None
    limit = max(STILL_PX / a.scale, 0.5)
    fewest = max(_FEWEST_CORNERS, round(_LEAST_SHARE * len(a.corners)))
    points, steps = _followed(a, b, np.zeros(2, np.float32))
    at_rest = int(np.count_nonzero(np.linalg.norm(steps, axis=1) < limit))
    together = _together(points, steps)
    if at_rest >= fewest and 2 * at_rest > np.count_nonzero(together):
        return "still"
    # Farther than corners can be followed from where they are: start at shifts of the whole.
    for shift in _likely_shifts(a.grey, b.grey):
        far_points, far_steps = _followed(a, b, shift)
        far = _together(far_points, far_steps)
        if np.count_nonzero(far) > np.count_nonzero(together):
            points, steps, together = far_points, far_steps, far
        if 2 * np.count_nonzero(together) > len(a.corners):
            break
    moving = np.count_nonzero(together)
    if moving < fewest or 2 * at_rest > moving:
        return None
    span = np.ptp(points[together], axis=0) / np.array(a.grey.shape[::-1])
    step = np.median(steps[together], axis=0)
    if span.min() < _LEAST_SPAN or np.linalg.norm(step) < limit:
        return None
    return float(a.scale * step[0]), float(a.scale * step[1])


def _likely_shifts(a: U8, b: U8) -> list[F32]:
    """Shifts ``(2,)`` that bring much of one picture onto the other, by phase correlation.

    The arm may be more of the picture than what is behind it, so the first need not be the
    background's.
    """
    halves = [cv2.resize(i, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA) for i in (a, b)]
    window = cv2.createHanningWindow(halves[0].shape[::-1], cv2.CV_32F)
    before, after = (np.asarray(fft.rfft2((i - np.float32(127.5)) * window)) for i in halves)
    cross = after * np.conj(before)
    cross /= np.maximum(np.abs(cross), 1e-6)
    peaks = fft.irfft2(cross, s=window.shape)  # type: ignore[arg-type]
    peaks = cv2.GaussianBlur(np.asarray(peaks, np.float32), (0, 0), 1.0)
    height, width = window.shape
    shifts = []
    for _ in range(_LIKELY):
        y, x = np.unravel_index(int(np.argmax(peaks)), peaks.shape)
        rows, columns = np.arange(y - 4, y + 5) % height, np.arange(x - 4, x + 5) % width
        peaks[np.ix_(rows, columns)] = 0.0
        shift = (x - width * (x > width // 2), y - height * (y > height // 2))
        shifts.append(2.0 * np.array(shift, np.float32))
    return shifts


def _followed(a: Backdrop, b: Backdrop, start: F32) -> tuple[F32, F32]:
    """Corners of ``a`` that are found in ``b`` and back again ``(M, 2)``, and their steps."""
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 20, 0.02)

    def follow(first: U8, second: U8, points: F32, guess: F32) -> tuple[F32, U8]:
        there, ok, _ = cv2.calcOpticalFlowPyrLK(
            first, second, points, guess, winSize=(15, 15), maxLevel=3, criteria=criteria,
            flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
        )  # fmt: skip
        return np.asarray(there, np.float32), np.asarray(ok, np.uint8)

    there, there_found = follow(a.grey, b.grey, a.corners, a.corners + start)
    back, back_found = follow(b.grey, a.grey, there, there - start)
    found = (there_found[:, 0] > 0) & (back_found[:, 0] > 0)
    found &= np.linalg.norm((back - a.corners)[:, 0], axis=1) < _BACK_AND_FORTH_PX
    points = a.corners[found, 0]
    return points, there[found, 0] - points


def _together(points: F32, steps: F32) -> NDArray[np.bool_]:
    """Which corners move as if fixed to one plane: the largest set of them, ``(M,)``."""
    none = np.zeros(len(points), np.bool_)
    if len(points) < _FEWEST_CORNERS:
        return none
    inliers: Any
    _, inliers = cv2.estimateAffinePartial2D(
        points, points + steps, method=cv2.RANSAC, ransacReprojThreshold=_INLIER_PX, maxIters=500
    )
    return none if inliers is None else inliers[:, 0] > 0
