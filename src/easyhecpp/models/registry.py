"""The pretrained segmenters by name: each a pair of a text model and a box model.

A name without a text model (``sam``, ``sam2``, ``sam-hq``) needs a first pose from elsewhere: it
makes masks at a known pose, not from nothing.
"""

from __future__ import annotations

import difflib
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from easyhecpp._optional import available
from easyhecpp.errors import InputError
from easyhecpp.models.runtime import Runtime
from easyhecpp.models.weights import on_disk
from easyhecpp.segment.encoding import RememberingSegmenter
from easyhecpp.segment.grounded import GroundedSegmenter
from easyhecpp.segment.protocols import PromptableSegmenter, TextSegmenter

# Segmenters that are not pretrained models: the session knows them, the error text lists them.
OTHER_SEGMENTERS = ("auto", "given", "classical")


@dataclass(frozen=True)
class ModelEntry:
    """One pretrained model.

    Attributes:
        module: where its adapter lives.
        loader: what to call there with (weights, runtime).
        weights: default name on the hub.
        gated: whether the hub asks for an accepted licence.
    """

    module: str
    loader: str
    weights: str
    gated: bool = False


@dataclass(frozen=True)
class SegmenterEntry:
    """What a segmenter's name stands for.

    Attributes:
        name: as given to ``--segmenter``.
        text: model that finds "robot arm"; None for box models alone.
        boxes: model that turns boxes into masks.
        text_gives_boxes: whether the text model finds boxes, which the box model then outlines.
    """

    name: str
    text: ModelEntry | None
    boxes: ModelEntry
    text_gives_boxes: bool = True


@dataclass(frozen=True)
class LoadedSegmenter:
    """A segmenter that is ready to run.

    Attributes:
        name: as given to ``--segmenter``.
        text: finds the arm without a pose; None for box models alone.
        boxes: outlines what the projected links point at.
    """

    name: str
    text: TextSegmenter | None
    boxes: PromptableSegmenter


def _sam(size: str) -> ModelEntry:
    return ModelEntry("sam", "load_sam", f"facebook/sam-vit-{size}")


def _sam2(size: str) -> ModelEntry:
    return ModelEntry("sam2", "load_sam2", f"facebook/sam2.1-hiera-{size}")


_DINO = ModelEntry("grounding_dino", "GroundingDino", "IDEA-Research/grounding-dino-base")
_DINO_TINY = ModelEntry("grounding_dino", "GroundingDino", "IDEA-Research/grounding-dino-tiny")
_SAM_HQ = ModelEntry("sam_hq", "load_sam_hq", "syscv-community/sam-hq-vit-huge")
_SAM3_TEXT = ModelEntry("sam3", "Sam3Text", "facebook/sam3", gated=True)
_SAM3 = ModelEntry("sam3", "load_sam3", "facebook/sam3", gated=True)

# In the order in which `auto` looks for weights on the disk: the paper's pair first.
SEGMENTERS = {
    entry.name: entry
    for entry in (
        SegmenterEntry("grounded-sam", _DINO, _sam("huge")),
        SegmenterEntry("grounded-sam2", _DINO, _sam2("large")),
        SegmenterEntry("grounded-sam-hq", _DINO, _SAM_HQ),
        SegmenterEntry("sam3", _SAM3_TEXT, _SAM3, text_gives_boxes=False),
        SegmenterEntry("grounded-sam-large", _DINO, _sam("large")),
        SegmenterEntry("grounded-sam-base", _DINO_TINY, _sam("base")),
        SegmenterEntry("grounded-sam2-tiny", _DINO_TINY, _sam2("tiny")),
        SegmenterEntry("sam", None, _sam("huge")),
        SegmenterEntry("sam-large", None, _sam("large")),
        SegmenterEntry("sam-base", None, _sam("base")),
        SegmenterEntry("sam2", None, _sam2("large")),
        SegmenterEntry("sam2-tiny", None, _sam2("tiny")),
        SegmenterEntry("sam-hq", None, _SAM_HQ),
    )
}


def names() -> tuple[str, ...]:
    """Names of the pretrained segmenters."""
    return tuple(SEGMENTERS)


def find(name: str) -> SegmenterEntry:
    """The segmenter of a name.

    Raises:
        InputError: there is none; the text lists all.
    """
    if name in SEGMENTERS:
        return SEGMENTERS[name]
    known = (*OTHER_SEGMENTERS, *SEGMENTERS)
    close = difflib.get_close_matches(name.lower().replace("_", "-"), known, n=1)
    raise InputError(
        f"unknown segmenter {name!r}",
        expected=f"one of {', '.join(known)}",
        fix=f"did you mean {close[0]}?" if close else None,
    )


def load(
    name: str,
    *,
    text_weights: str | Path | None = None,
    box_weights: str | Path | None = None,
    runtime: Runtime | None = None,
    with_text: bool = True,
) -> LoadedSegmenter:
    """Load a segmenter by name; weights that are not on this disk are downloaded if possible.

    Args:
        name: one of ``names()``.
        text_weights: folder or name on the hub, in place of the text model's own.
        box_weights: the same for the box model.
        runtime: device and precision of both.
        with_text: False leaves the text model out where only boxes will be asked for.

    Raises:
        InputError: unknown name; weights that cannot be had or read.
        MissingExtraError: torch or transformers is not installed.
    """
    entry = find(name)
    boxes = RememberingSegmenter(_load(entry.boxes, box_weights, runtime))
    text = None
    if entry.text is not None and with_text:
        model = _load(entry.text, text_weights, runtime)
        text = GroundedSegmenter(model, boxes) if entry.text_gives_boxes else model
    return LoadedSegmenter(name, text, boxes)


def missing(
    name: str,
    *,
    text_weights: str | Path | None = None,
    box_weights: str | Path | None = None,
) -> tuple[str, ...]:
    """What keeps a segmenter from running on this machine as it is; empty when it is ready.

    Loads no model and touches no network.

    Raises:
        InputError: unknown name.
    """
    entry = find(name)
    lacking = [
        f'the package {package} (pip install "easyhecpp[models]")'
        for package in ("torch", "transformers")
        if not available(package)
    ]
    for model, weights in ((entry.text, text_weights), (entry.boxes, box_weights)):
        if model is not None and on_disk(weights or model.weights) is None:
            gated = " (gated)" if model.gated and weights is None else ""
            lacking.append(f"the weights {weights or model.weights}{gated}")
    return tuple(dict.fromkeys(lacking))


def first_ready() -> str | None:
    """The first segmenter, text model included, that runs on this machine without a download."""
    for name, entry in SEGMENTERS.items():
        if entry.text is not None and not missing(name):
            return name
    return None


def _load(entry: ModelEntry, weights: str | Path | None, runtime: Runtime | None) -> Any:
    module = import_module(f"easyhecpp.models.{entry.module}")
    return getattr(module, entry.loader)(weights or entry.weights, runtime)
