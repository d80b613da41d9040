"""The page beside new masks: one HTML file with every view's outlines, score and remarks."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from easyhecpp._atomic import write_text
from easyhecpp.capture import Capture
from easyhecpp.formats.result_blocks import MaskResult
from easyhecpp.formats.result_file import ResultFile, Verdict
from easyhecpp.report.pictures import ViewPicture, view_pictures
from easyhecpp.report.templating import template
from easyhecpp.report.wording import HEADLINES, flag_text, split_reasons

_HEADLINES: dict[Verdict, str] = {
    "ok": "The masks agree with each other, with the joints and with the arm.",
    "doubtful": "There are masks, but look at them before you use them.",
    "failed": "The masks do not fit the arm: do not use them.",
}
_LOOK = "Look at the outlines below, the worst come first: does the cyan line follow the arm?"
_COPY = "Copy `masks/` into the capture to use them as given masks, without those that are wrong."


@dataclass(frozen=True)
class MaskCard:
    """One view on the page.

    Attributes:
        picture: Picture and outlines.
        status: ``no mask``, ``left out`` where the other views contradict it, or "".
        score: How well the mask agrees with what it was made from; None without one.
        iou: Overlap of mask and rendered arm, or None.
        flags: Findings, in words.
        notes: Sentences.
    """

    picture: ViewPicture
    status: str
    score: float | None
    iou: float | None
    flags: tuple[str, ...]
    notes: tuple[str, ...]


def write_masks_page(
    path: str | os.PathLike[str],
    result: ResultFile,
    capture: Capture,
    masks: Mapping[str, NDArray[Any]],
) -> None:
    """Write the page, whole or not at all.

    Args:
        path: The file.
        result: Of the calibration that came with the masks.
        capture: What they were made from.
        masks: By view id; bool, or float in [0, 1].

    Raises:
        InputError: A picture cannot be read, or the file cannot be written.
    """
    write_text(path, masks_html(result, capture, masks))


def masks_html(result: ResultFile, capture: Capture, masks: Mapping[str, NDArray[Any]]) -> str:
    """The page's text; see `write_masks_page`."""
    T = None if result.T_mount_cam is None else result.T_mount_cam.array
    hard = {view_id: np.asarray(mask) > 0.5 for view_id, mask in masks.items()}
    cards = [_card(result, picture) for picture in view_pictures(capture, T, hard)]
    why, advice = split_reasons(result.reasons)
    return template("masks.html.j2").render(
        result=result,
        capture=capture,
        word=HEADLINES[result.verdict][0],
        headline=_HEADLINES[result.verdict],
        why=why,
        advice=(*advice, _LOOK, *([_COPY] if result.verdict != "failed" else [])),
        # Worst first; a stable sort keeps the views' order among those that are alike.
        cards=sorted(cards, key=lambda card: (not card.status, card.score or 0.0)),
        size=(capture.camera.width, capture.camera.height),
    )


def _card(result: ResultFile, picture: ViewPicture) -> MaskCard:
    mask = next((m for m in result.masks if m.id == picture.id), MaskResult(id=picture.id))
    fit = next((view for view in result.views if view.id == picture.id), None)
    status = "" if picture.mask else "no mask"
    if fit is not None and fit.weight == 0.0:
        status = "left out"
    return MaskCard(
        picture=picture,
        status=status,
        score=mask.score,
        iou=None if fit is None else fit.iou,
        flags=() if fit is None else tuple(flag_text(flag) for flag in fit.flags),
        notes=mask.notes,
    )
