"""Where the masks of a calibration come from."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from easyhecpp._optional import available
from easyhecpp.capture import Capture
from easyhecpp.errors import InputError
from easyhecpp.segment.autosam import DEFAULT_TEXT
from easyhecpp.segment.prompts import DEFAULT_VARIANT, find_variant
from easyhecpp.segment.protocols import (
    CaptureMasks,
    MaskSource,
    PoseBelief,
    ViewMask,
    image_of,
)

if TYPE_CHECKING:
    from easyhecpp.models.runtime import Runtime

GIVEN, CLASSICAL, AUTO = "given", "classical", "auto"
_OTHERS = (AUTO, GIVEN, CLASSICAL)


@dataclass(frozen=True)
class PretrainedConfig:
    """Settings of pretrained segmenters.

    Attributes:
        text_weights: Folder or hub name in place of the text model's own weights.
        box_weights: The same for the box model.
        device: Where the models run: ``auto``, ``cpu``, ``cuda``, ``cuda:1``, ``mps``.
        precision: Of the image encoders: ``float32``, ``bfloat16`` or ``float16``.
        prompts: How the projected links are put to the box model: a row of the paper's table,
            ``a`` to ``f``.
        text: What the text model looks for.
    """

    text_weights: str | Path | None = None
    box_weights: str | Path | None = None
    device: str = "auto"
    precision: str = "float32"
    prompts: str = DEFAULT_VARIANT
    text: str = DEFAULT_TEXT

    @property
    def names_weights(self) -> bool:
        """Whether it names any weights."""
        return self.text_weights is not None or self.box_weights is not None

    @property
    def runtime(self) -> Runtime:
        """Device and precision.

        Raises:
            InputError: No such device or precision.
        """
        from easyhecpp.models.runtime import Runtime

        return Runtime(self.device, self.precision)


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
    segmenter: str, capture: Capture, config: PretrainedConfig | None = None
) -> ChosenSource:
    """The source that a name stands for.

    Args:
        segmenter: ``auto``, ``given``, ``classical``, or a pretrained segmenter's name.
        capture: Decides what ``auto`` takes: its masks, else weights that are on this disk, else
            the classical way. ``auto`` never downloads.
        config: Settings of pretrained segmenters; they are checked whatever is taken.

    Raises:
        InputError: Unknown name, weights that cannot be had, or settings that cannot be used.
        MissingExtraError: A pretrained name without torch and transformers.
    """
    config = config or PretrainedConfig()
    _check(segmenter, config)
    if segmenter == AUTO and any(view.has_mask for view in capture.views):
        unused = "; the weights that were named are not used" if config.names_weights else ""
        return ChosenSource(GivenMasks(), GIVEN, f"masks from the capture{unused}", False)
    if segmenter == GIVEN:
        return ChosenSource(GivenMasks(), GIVEN, "masks from the capture, as asked", False)
    taken = segmenter_for_images(segmenter, config)
    if taken != CLASSICAL:
        why = "as asked" if segmenter != AUTO else "its weights are on this disk"
        return _pretrained(taken, why, config)
    return _classical(
        "classical segmentation, as asked"
        if segmenter == CLASSICAL
        else "classical segmentation: the capture holds no masks, and no weights are on this disk"
    )


def check_segmenter(segmenter: str, config: PretrainedConfig | None = None) -> None:
    """Raise what `choose_source` would raise for any capture, before work on many of them.

    Args:
        segmenter: A segmenter's name.
        config: Settings of pretrained segmenters.

    Raises:
        InputError: Unknown name, weights that cannot be had, or settings that cannot be used.
        MissingExtraError: A pretrained name without torch and transformers.
    """
    config = config or PretrainedConfig()
    _check(segmenter, config)
    if segmenter not in _OTHERS:
        _pretrained(segmenter, "as asked", config)


def segmenter_for_images(segmenter: str, config: PretrainedConfig | None = None) -> str:
    """What ``auto`` stands for where masks are to be made: weights on this disk, else classical.

    Args:
        segmenter: A segmenter's name; any but ``auto`` stands for itself.
        config: Names weights that what is taken must run with.

    Raises:
        InputError: Weights were named, and no segmenter is ready to run with them.
    """
    if segmenter != AUTO:
        return segmenter
    from easyhecpp.models import registry

    config = config or PretrainedConfig()
    _check(segmenter, config)
    weights = {"text_weights": config.text_weights, "box_weights": config.box_weights}
    ready = registry.first_ready(**weights)
    if ready is None and config.names_weights:
        lacking = {name: registry.missing(name, **weights) for name in registry.names()}
        nearest = min(lacking, key=lambda name: len(lacking[name]))
        raise InputError(
            "No segmenter is ready to run with the weights that were named",
            where=f"{nearest} lacks {' and '.join(lacking[nearest])}",
            expected="weights on this disk that make a whole segmenter; auto downloads none",
            fix=f"choose --segmenter {nearest}, or leave --text-weights and --box-weights out",
        )
    return ready or CLASSICAL


def _check(segmenter: str, config: PretrainedConfig) -> None:
    """Raises InputError for an unknown name, and for settings that no segmenter could use."""
    from easyhecpp.models import registry
    from easyhecpp.models.checkpoint import find

    entry = None if segmenter in _OTHERS else registry.find(segmenter, _OTHERS)
    find_variant(config.prompts)
    if not config.text.strip():
        raise InputError(
            "The text that names the arm is empty",
            expected='what a text model is to look for, such as "robot arm"',
            fix="leave --text out for that one",
        )
    runtime = config.runtime
    # Looking for a device loads torch, which nobody needs to have for other segmenters.
    if runtime.device != "auto" and available("torch"):
        runtime.torch_device()
    models = {
        "--text-weights": (config.text_weights, entry and entry.text),
        "--box-weights": (config.box_weights, entry and entry.boxes),
    }
    for option, (weights, model) in models.items():
        # Those of a model that will be loaded may be downloaded; whoever loads it looks.
        if weights is None or model is not None or find(weights) is not None:
            continue
        raise InputError(
            f"The weights {str(weights)!r} of {option} are not on this disk",
            expected="a folder, or a name on the Hugging Face hub whose weights are in the cache",
            fix=f"--segmenter {segmenter} downloads none for {option}: name a folder that exists, "
            f"or leave {option} out",
        )


def _classical(why: str) -> ChosenSource:
    return ChosenSource(None, CLASSICAL, why, True)


def _pretrained(name: str, why: str, config: PretrainedConfig) -> ChosenSource:
    from easyhecpp.models import registry
    from easyhecpp.segment import AutoSam, AutoSamConfig

    loaded = registry.load(
        name,
        text_weights=config.text_weights,
        box_weights=config.box_weights,
        runtime=config.runtime,
    )
    how = AutoSamConfig(variant=config.prompts, text=config.text)
    source: MaskSource = AutoSam(loaded.boxes, loaded.text, how)
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
            found.masks,
            PoseBelief(found.T_mount_cam, found.estimate.covariance),
            doubts=found.reasons,
            margin=found.margin,
        )
