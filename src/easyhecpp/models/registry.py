"""The pretrained segmenters by name: each a pair of a text model and a box model.

A name without a text model (``sam``, ``sam2``, ``sam-hq``) needs a first pose from elsewhere: it
makes masks at a known pose, not from nothing.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from easyhecpp._optional import available, require
from easyhecpp.errors import InputError
from easyhecpp.models import checkpoint
from easyhecpp.models.checkpoint import WeightsSpec
from easyhecpp.models.grounding_dino import GROUNDING_DINO, GroundingDino
from easyhecpp.models.runtime import Runtime
from easyhecpp.models.sam import SAM, load_sam
from easyhecpp.models.sam2 import SAM2, load_sam2
from easyhecpp.models.sam3 import SAM3_BOXES, SAM3_TEXT, Sam3Text, load_sam3
from easyhecpp.models.sam_hq import SAM_HQ, load_sam_hq
from easyhecpp.models.weights import fetch
from easyhecpp.segment.encoding import RememberingSegmenter
from easyhecpp.segment.grounded import GroundedSegmenter
from easyhecpp.segment.protocols import PromptableSegmenter, TextSegmenter


@dataclass(frozen=True)
class ModelEntry:
    """One pretrained model.

    Attributes:
        spec: what it loads.
        loader: what to call with (weights, runtime).
        weights: name on the hub.
    """

    spec: WeightsSpec
    loader: Callable[[str | Path | None, Runtime | None], Any]
    weights: str


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
    return ModelEntry(SAM.weights, load_sam, f"facebook/sam-vit-{size}")


def _sam2(size: str) -> ModelEntry:
    return ModelEntry(SAM2.weights, load_sam2, f"facebook/sam2.1-hiera-{size}")


_DINO = ModelEntry(GROUNDING_DINO, GroundingDino, "IDEA-Research/grounding-dino-base")
_DINO_TINY = ModelEntry(GROUNDING_DINO, GroundingDino, "IDEA-Research/grounding-dino-tiny")
_SAM_HQ = ModelEntry(SAM_HQ.weights, load_sam_hq, SAM_HQ.weights.default)
_SAM3_TEXT = ModelEntry(SAM3_TEXT, Sam3Text, SAM3_TEXT.default)
_SAM3 = ModelEntry(SAM3_BOXES.weights, load_sam3, SAM3_BOXES.weights.default)

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


def find(name: str, others: Sequence[str] = ()) -> SegmenterEntry:
    """The segmenter of a name.

    Args:
        name: one of ``names()``.
        others: names that would be right as well where the user gave this one, for the error.

    Raises:
        InputError: there is none; the text lists all.
    """
    if name in SEGMENTERS:
        return SEGMENTERS[name]
    known = (*others, *SEGMENTERS)
    close = difflib.get_close_matches(name.lower().replace("_", "-"), known, n=1)
    raise InputError(
        f"unknown {'' if others else 'pretrained '}segmenter {name!r}",
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
    entry = find(name) if with_text else replace(find(name), text=None)
    runtime = runtime or Runtime()
    # Before gigabytes are fetched.
    runtime.torch_device()
    require("transformers", "models", f"The segmenter {name}")
    wanted = _models(entry, text_weights, box_weights)
    fetch([(model.spec, weights) for model, weights in wanted])
    *text_models, boxes = (model.loader(weights, runtime) for model, weights in wanted)
    boxes = RememberingSegmenter(boxes)
    text = None
    if text_models:
        text = (
            GroundedSegmenter(text_models[0], boxes) if entry.text_gives_boxes else text_models[0]
        )
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
    lacking = [
        f'the package {package} (pip install "easyhecpp[models]")'
        for package in ("torch", "transformers")
        if not available(package)
    ]
    for model, weights in _models(find(name), text_weights, box_weights):
        folder = checkpoint.find(weights)
        problem = None if folder is None else checkpoint.problem(model.spec, folder)
        if folder is None:
            gated = " (gated)" if model.spec.gated and weights == model.spec.default else ""
            lacking.append(f"the weights {weights}{gated}")
        elif problem is not None:
            lacking.append(f"a part of the weights {weights} ({problem})")
    return tuple(dict.fromkeys(lacking))


def first_ready(
    *, text_weights: str | Path | None = None, box_weights: str | Path | None = None
) -> str | None:
    """The first segmenter that runs on this machine without a download.

    One without a text model counts only where weights were named for its box model alone: nobody
    has asked for it otherwise.

    Args:
        text_weights: weights that must be among those it runs with.
        box_weights: the same for the box model.
    """
    alone = box_weights is not None and text_weights is None
    for name, entry in SEGMENTERS.items():
        if entry.text is None and not alone:
            continue
        if not missing(name, text_weights=text_weights, box_weights=box_weights):
            return name
    return None


def _models(
    entry: SegmenterEntry, text_weights: str | Path | None, box_weights: str | Path | None
) -> list[tuple[ModelEntry, str | Path]]:
    """A segmenter's models, the box model last, and the weights that each is to have."""
    models = ((entry.text, text_weights), (entry.boxes, box_weights))
    return [(m, m.weights if weights is None else weights) for m, weights in models if m]
