"""What the package asks of a thing that makes masks, and the values that travel between them.

Algorithms of this layer see only these protocols; the adapters in ``models`` implement them. Pixel
coordinates are those of the whole package: an integer is a pixel's CENTRE, and a box ``x0 y0 x1
y1`` names the centres of the outermost pixels that belong to it (so a box round one pixel has
``x0 == x1``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from easyhecpp.capture import Capture
from easyhecpp.errors import InputError, NothingSuitsError

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


@dataclass(frozen=True)
class ScoredBoxes:
    """Boxes that a detector found in one image.

    Attributes:
        boxes: (N, 4) ``x0 y0 x1 y1`` in px.
        scores: (N,) the model's own confidence, in [0, 1].
    """

    boxes: FloatArray
    scores: FloatArray

    def __len__(self) -> int:
        return len(self.scores)


@dataclass(frozen=True)
class ScoredMasks:
    """Masks of one image.

    Attributes:
        masks: (N, H, W) bool.
        scores: (N,) the model's own confidence or predicted IoU.
    """

    masks: BoolArray
    scores: FloatArray

    def __len__(self) -> int:
        return len(self.scores)


@dataclass(frozen=True)
class Prompts:
    """N prompts of one image, each a box, some points, or a box with points.

    Attributes:
        boxes: (N, 4) ``x0 y0 x1 y1`` in px, or None.
        points: (N, P, 2) in px, or None; every prompt has the same number of points.
        on_object: (N, P) bool, whether a point lies on the thing wanted (True) or must stay out of
            the mask; None means that all lie on it.
    """

    boxes: FloatArray | None = None
    points: FloatArray | None = None
    on_object: BoolArray | None = None

    def __post_init__(self) -> None:
        if self.boxes is None and self.points is None:
            raise ValueError("a prompt needs boxes, points, or both")
        if self.boxes is not None and self.boxes.shape[1:] != (4,):
            raise ValueError(f"boxes must be (N, 4), got {self.boxes.shape}")
        if self.points is not None:
            if self.points.ndim != 3 or self.points.shape[2] != 2:
                raise ValueError(f"points must be (N, P, 2), got {self.points.shape}")
            if self.boxes is not None and len(self.boxes) != len(self.points):
                raise ValueError(f"{len(self.boxes)} boxes but points for {len(self.points)}")
        if self.on_object is not None and (
            self.points is None or self.on_object.shape != self.points.shape[:2]
        ):
            raise ValueError("on_object needs one entry for every point")

    def __len__(self) -> int:
        given = self.boxes if self.boxes is not None else self.points
        assert given is not None  # checked above
        return len(given)

    def chunk(self, start: int, stop: int) -> Prompts:
        """The prompts ``start`` to ``stop`` (exclusive)."""
        rows = slice(start, stop)
        return Prompts(
            None if self.boxes is None else self.boxes[rows],
            None if self.points is None else self.points[rows],
            None if self.on_object is None else self.on_object[rows],
        )


@runtime_checkable
class TextDetector(Protocol):
    """Finds what a text names, as boxes (Grounding DINO)."""

    @property
    def name(self) -> str:
        """What to call it in messages and results."""
        ...

    def detect(self, image: NDArray[np.uint8], text: str) -> ScoredBoxes:
        """Boxes of ``text`` in an (H, W, 3) RGB image, best first; none found is no error."""
        ...


@runtime_checkable
class TextSegmenter(Protocol):
    """Finds what a text names, as masks (Grounding DINO with SAM; SAM 3)."""

    @property
    def name(self) -> str:
        """What to call it in messages and results."""
        ...

    def segment(self, image: NDArray[np.uint8], text: str) -> ScoredMasks:
        """Masks of ``text`` in an (H, W, 3) RGB image, best first; none found is no error."""
        ...


class EncodedImage(Protocol):
    """An image that a promptable segmenter has seen once and answers any number of prompts for."""

    @property
    def size(self) -> tuple[int, int]:
        """(height, width) of the image."""
        ...

    def predict(self, prompts: Prompts) -> ScoredMasks:
        """One mask for each prompt, in the order of the prompts."""
        ...


@runtime_checkable
class PromptableSegmenter(Protocol):
    """Turns boxes and points into masks (the SAM family)."""

    @property
    def name(self) -> str:
        """What to call it in messages and results."""
        ...

    def encode(self, image: NDArray[np.uint8]) -> EncodedImage:
        """Encodes an (H, W, 3) RGB image: the slow part, done once for all prompts of a view."""
        ...


@dataclass(frozen=True)
class PoseBelief:
    """What is known of the camera before masks are made.

    Attributes:
        T_mount_cam: (4, 4) the camera in the mount's frame.
        covariance: (6, 6) of the tangent of ``T_mount_cam @ exp([v, w])``, m and rad; None when
            nobody has said how sure the pose is.
    """

    T_mount_cam: FloatArray
    covariance: FloatArray | None = None


@dataclass(frozen=True)
class ViewMask:
    """The mask of one view.

    Attributes:
        view_id: the view.
        mask: (H, W) bool or soft float32 in [0, 1]; None when no usable mask could be made.
        ignore: (H, W) bool, pixels of which the mask says nothing; None for none.
        score: how well the mask agrees with the evidence behind it, in [0, 1].
        notes: sentences for the user: what was rejected or left out, and why; the weightiest first.
    """

    view_id: str
    mask: NDArray[np.bool_] | NDArray[np.float32] | None
    ignore: BoolArray | None = None
    score: float = 1.0
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class CaptureMasks:
    """The masks of a capture.

    Attributes:
        views: one entry for each view of the capture, in its order.
        belief: the pose, where making the masks has found one.
        notes: sentences for the user about the capture as a whole.
        doubts: reasons why the belief, and with it the masks, may be wrong; sentences.
        margin: by how much the belief beat its best rival, in overlap; 1 where there is none.
    """

    views: tuple[ViewMask, ...]
    belief: PoseBelief | None = None
    notes: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()
    margin: float = 1.0

    @property
    def usable(self) -> tuple[ViewMask, ...]:
        """The views that have a mask."""
        return tuple(view for view in self.views if view.mask is not None)


class MaskSource(Protocol):
    """Makes the arm's masks for a whole capture: given, classical, or a pretrained pair."""

    @property
    def name(self) -> str:
        """What to call it in messages and results."""
        ...

    def masks(self, capture: Capture, belief: PoseBelief | None = None) -> CaptureMasks:
        """Masks of the arm in every view.

        Args:
            capture: the capture; its views need images.
            belief: the pose so far. None asks for first masks, made without one; a source that
                finds a pose on the way returns it in ``CaptureMasks.belief``.
        """
        ...


def union(masks: BoolArray) -> BoolArray:
    """(H, W) of the pixels in any of the masks (N, H, W); none for no mask."""
    return np.asarray(masks.any(axis=0), dtype=np.bool_)


def image_of(capture: Capture, index: int) -> NDArray[np.uint8]:
    """The image of a view, or an InputError that says which view lacks one."""
    view = capture.views[index]
    if view.image is None:
        raise InputError(
            f"view {view.id} has no image",
            where=f"capture {capture.name}",
            expected="one image per view, from which masks are made",
            fix="add the image, or leave the view out of the capture",
        )
    return view.image


def require_usable(masks: Sequence[ViewMask], source: str, at_least: int = 1) -> None:
    """Raises NothingSuitsError when too few views have a mask, naming each view and its reason."""
    empty = [view for view in masks if view.mask is None]
    if len(masks) - len(empty) >= at_least:
        return
    # The first note says what came of the view, the second why, and the others much the same.
    reasons = "; ".join(f"view {v.view_id}: {' '.join(v.notes[:2]) or 'no mask'}" for v in empty)
    raise NothingSuitsError(
        f"{source} gave a usable mask in {len(masks) - len(empty)} of {len(masks)} views",
        where=reasons,
        expected=f"a mask of the arm in at least {at_least}",
        fix="look at these images: is the arm in them, sharp and lit? Try another model, give "
        "masks yourself (--segmenter given), or use --segmenter classical, which needs no weights",
    )
