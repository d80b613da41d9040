"""What is said of the masks, view by view: all of it for the files, the worst for the console."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from easyhecpp.formats.result_blocks import LinkAgreement, MaskResult
from easyhecpp.segment.protocols import CaptureMasks
from easyhecpp.segment.quality import LinkQuality, ViewQuality

_SHOWN, _NAMED = 3, 3
"""Notes that are shown in short, and views that are named for each."""


def mask_results(masks: CaptureMasks, quality: Sequence[ViewQuality]) -> list[MaskResult]:
    """All that is known of the masks, one entry a view of the capture.

    Args:
        masks: Of all views.
        quality: Of the views whose edges were looked at.
    """
    judged = {view.view_id: view for view in quality}
    found: list[MaskResult] = []
    for view in masks.views:
        own = judged.get(view.view_id)
        found.append(
            MaskResult(
                id=view.view_id,
                score=None if view.mask is None else float(np.clip(view.score, 0.0, 1.0)),
                notes=view.notes if own is None else (*view.notes, *own.notes),
                links=() if own is None else tuple(_agreement(link) for link in own.links),
            )
        )
    return found


def short_mask_notes(masks: CaptureMasks, quality: Sequence[ViewQuality]) -> tuple[str, ...]:
    """The worst notes on the masks, and how many more there are.

    Views without a mask come first, then those with the lowest scores; of each view its weightiest
    note. What is said of several views alike is said once.

    Args:
        masks: Of all views.
        quality: Of the views whose edges were looked at.
    """
    ranked = [
        (place, -1.0 if view.mask is None else view.score, note, view.view_id)
        for view in masks.views
        for place, note in enumerate(view.notes)
    ]
    ranked += [
        (place, min([view.weight, *(link.score for link in view.links)]), note, view.view_id)
        for view in quality
        for place, note in enumerate(view.notes)
    ]
    views: dict[str, list[str]] = {}
    for _, _, note, view_id in sorted(ranked, key=lambda entry: entry[:2]):
        views.setdefault(note, []).append(view_id)
    order = [view.view_id for view in masks.views]
    lines = [
        f"{_named(sorted(ids, key=order.index))}: {note}"
        for note, ids in list(views.items())[:_SHOWN]
    ]
    if len(views) > _SHOWN:
        more = len(views) - _SHOWN
        lines.append(f"and {more} more on the masks, listed by view on the written page")
    return tuple(lines)


def _named(ids: Sequence[str]) -> str:
    if len(ids) == 1:
        return f"view {ids[0]}"
    if len(ids) <= _NAMED:
        return f"views {', '.join(ids[:-1])} and {ids[-1]}"
    return f"views {', '.join(ids[:_NAMED])} and {len(ids) - _NAMED} more"


def _agreement(link: LinkQuality) -> LinkAgreement:
    return LinkAgreement(
        link=link.link,
        score=link.score,
        edge=link.edge,
        colour=link.colour,
        offset_px=link.offset_px if np.isfinite(link.offset_px) else None,
        length_px=link.length_px,
    )
