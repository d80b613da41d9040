"""Where the masks of a calibration come from."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from easyhecpp.capture import Capture
from easyhecpp.errors import InputError
from easyhecpp.segment.protocols import (
    CaptureMasks,
    MaskSource,
    PoseBelief,
    ViewMask,
    image_of,
)

GIVEN, CLASSICAL, AUTO = "given", "classical", "auto"

_MOST_OF_EDGE = 0.7


class GivenMasks:
    """A ``MaskSource``: the masks that lie in the capture."""

    name = GIVEN

    def masks(self, capture: Capture, belief: PoseBelief | None = None) -> CaptureMasks:
        """The capture's masks; a view without one has none."""
        if not any(view.has_mask for view in capture.views):
            raise InputError(
                "The capture holds no masks",
                where=capture.name,
                expected="a folder masks/ with one picture per view",
                fix="use --segmenter classical, which needs none",
            )
        return CaptureMasks(
            tuple(
                ViewMask(
                    view.id,
                    view.mask,
                    notes=() if view.has_mask else ("The capture holds no mask of this view.",),
                )
                for view in capture.views
            )
        )


def inverted(capture: Capture) -> tuple[str, ...]:
    """A sentence where most of a capture's masks look as if black and white were exchanged.

    An arm reaches into the picture from somewhere; what lies along most of the picture's edge, and
    over more than half of it, is the background.
    """
    masks = [mask for view in capture.views if (mask := view.mask) is not None]
    suspect = sum(_is_background(mask) for mask in masks)
    if 2 * suspect <= len(masks):
        return ()
    return (
        f"{suspect} of {len(masks)} masks cover most of the picture and of its edge, as if black "
        "and white were exchanged. Make the arm white and the background black.",
    )


def _is_background(mask: NDArray[np.bool_]) -> bool:
    edge = np.concatenate([mask[0], mask[-1], mask[:, 0], mask[:, -1]])
    return float(edge.mean()) > _MOST_OF_EDGE and float(mask.mean()) > 0.5


@dataclass(frozen=True)
class ChosenSource:
    """A source of masks and why it was taken.

    Attributes:
        source: Makes the masks; None for the classical way, which finds pose and masks together.
        name: As written into the result.
        why: A sentence for the user.
        refines: Whether better masks come out once a pose is known.
    """

    source: MaskSource | None
    name: str
    why: str
    refines: bool


def choose_source(
    segmenter: str,
    capture: Capture,
    *,
    text_weights: str | Path | None = None,
    box_weights: str | Path | None = None,
    device: str | None = None,
) -> ChosenSource:
    """The source that a name stands for.

    Args:
        segmenter: ``auto``, ``given``, ``classical``, or a pretrained segmenter's name.
        capture: Decides what ``auto`` takes: its masks, else weights that are on this disk, else
            the classical way. ``auto`` never downloads.
        text_weights: Folder or hub name in place of the text model's own weights.
        box_weights: The same for the box model.
        device: ``cpu``, ``cuda`` and the like, for pretrained models.

    Raises:
        InputError: Unknown name, or weights that cannot be had.
        MissingExtraError: A pretrained name without torch and transformers.
    """
    if segmenter == AUTO:
        return _automatic(capture)
    if segmenter == GIVEN:
        return ChosenSource(GivenMasks(), GIVEN, "masks from the capture, as asked", False)
    if segmenter == CLASSICAL:
        return _classical("classical segmentation, as asked")
    return _pretrained(segmenter, "as asked", text_weights, box_weights, device)


def segmenter_for_images(segmenter: str) -> str:
    """What ``auto`` stands for where masks are to be made: weights on this disk, else classical."""
    if segmenter != AUTO:
        return segmenter
    from easyhecpp.models import registry

    return registry.first_ready() or CLASSICAL


def _automatic(capture: Capture) -> ChosenSource:
    if any(view.has_mask for view in capture.views):
        return ChosenSource(GivenMasks(), GIVEN, "masks from the capture", False)
    ready = segmenter_for_images(AUTO)
    if ready != CLASSICAL:
        return _pretrained(ready, "its weights are on this disk", None, None, None)
    return _classical(
        "classical segmentation: the capture holds no masks, and no weights are on this disk"
    )


def _classical(why: str) -> ChosenSource:
    return ChosenSource(None, CLASSICAL, why, True)


def _pretrained(
    name: str,
    why: str,
    text_weights: str | Path | None,
    box_weights: str | Path | None,
    device: str | None,
) -> ChosenSource:
    from easyhecpp.models import registry
    from easyhecpp.models.runtime import Runtime
    from easyhecpp.segment import AutoSam

    registry.find(name)
    runtime = None if device is None else Runtime(device)
    loaded = registry.load(
        name, text_weights=text_weights, box_weights=box_weights, runtime=runtime
    )
    source: MaskSource = AutoSam(loaded.boxes, loaded.text)
    if loaded.text is None:
        source = _FirstPoseElsewhere(source)
    return ChosenSource(source, name, f"{name}, {why}", True)


class _FirstPoseElsewhere:
    """A box model without a text model: the classical way finds the first masks and pose."""

    def __init__(self, boxes: MaskSource) -> None:
        self._boxes = boxes
        self.name = boxes.name

    def masks(self, capture: Capture, belief: PoseBelief | None = None) -> CaptureMasks:
        """Masks by boxes once a pose is known, classical ones before."""
        if belief is not None:
            return self._boxes.masks(capture, belief)
        from easyhecpp.segment.classical import calibrate_from_images

        images = [image_of(capture, i) for i in range(len(capture.views))]
        found = calibrate_from_images(
            capture.rig,
            capture.camera,
            images,
            [view.joints for view in capture.views],
            ids=capture.view_ids,
        )
        return CaptureMasks(
            found.masks, PoseBelief(found.T_mount_cam, found.estimate.covariance), found.reasons
        )
