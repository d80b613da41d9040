"""How well colour, edges and kinematics agree, for each view and link."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from easyhecpp.segment._edge_kernel import AGAINST_PLATE, COLOUR
from easyhecpp.segment.backgrounds import Backgrounds
from easyhecpp.segment.edge_reading import EdgeReader, EdgeReading

F64 = NDArray[np.float64]

_REACH_PX = 6.0
_NEAR_PX = 1.5
_FEWEST_SAMPLES = 20
_ENOUGH = 0.5
"""Share of a view's or link's contour on an edge from which on it is fully trusted."""

_OFF_PX = 3.0
"""A view whose edges all lie this far off on average contradicts the others."""


@dataclass(frozen=True)
class LinkQuality:
    """Agreement along the visible contour of one link in one view.

    Attributes:
        link: Name of the link.
        length_px: Length of its visible contour.
        edge: Share of it with an image edge within 1.5 px.
        colour: Share of it where the picture differs from the background on the inside only.
        offset_px: Median outward displacement of its edges, nan where it has none.
        score: In [0, 1].
    """

    link: str
    length_px: float
    edge: float
    colour: float
    offset_px: float
    score: float


@dataclass(frozen=True)
class ViewQuality:
    """Agreement of one view.

    Attributes:
        view_id: The view.
        links: One entry per link with enough visible contour.
        edge: Share of the contour that moves with an image edge within 1.5 px.
        spread_px: Robust spread of the edges' displacements.
        weight: Trust in [0, 1] for the pose fit.
        notes: Sentences for the user, the weightiest first.
    """

    view_id: str
    links: tuple[LinkQuality, ...]
    edge: float
    spread_px: float
    weight: float
    notes: tuple[str, ...] = ()


def assess_at(
    backgrounds: Backgrounds,
    T_mount_cam: F64,
    ids: Sequence[str],
    ignore: Sequence[NDArray[np.bool_] | None] | None = None,
) -> tuple[ViewQuality, ...]:
    """Judge every view at a pose.

    Args:
        backgrounds: The pictures and what is behind the arm.
        T_mount_cam: ``(4, 4)``.
        ids: Names of the views.
        ignore: Per view ``(H, W)`` bool where the image says nothing, or None.
    """
    readings = EdgeReader(backgrounds, ignore).read(T_mount_cam, _REACH_PX, spacing_px=2.0)
    return assess(readings, ids, backgrounds.scene.rig.robot.link_names)


def assess(
    readings: Sequence[EdgeReading], ids: Sequence[str], link_names: Sequence[str]
) -> tuple[ViewQuality, ...]:
    """Judge every view by the edges along its contour, the other views being the measure.

    Args:
        readings: Edges read with a reach of several pixels, at the pose to judge.
        ids: Names of the views.
        link_names: Names of the links.
    """
    shares = np.array([_share(r) for r in readings])
    usual = float(np.nanmedian(shares)) if np.isfinite(shares).any() else 0.0
    return tuple(
        _view(reading, view_id, link_names, usual)
        for reading, view_id in zip(readings, ids, strict=True)
    )


def _share(reading: EdgeReading) -> float:
    """Share of the outline on an edge, nan where too little is seen.

    What stands still is left out: it agrees with any picture, whatever the joints.
    """
    moving = reading.kind != COLOUR
    if np.count_nonzero(moving) < _FEWEST_SAMPLES:
        return np.nan
    return float(np.mean((reading.found & (np.abs(reading.offset) < _NEAR_PX))[moving]))


def _view(
    reading: EdgeReading, view_id: str, link_names: Sequence[str], usual: float
) -> ViewQuality:
    edge = _share(reading)
    if np.isnan(edge):
        return ViewQuality(
            view_id, (), 0.0, 0.0, 0.0, ("The outline of what moves is not visible in this view.",)
        )
    found = reading.offset[reading.found]
    middle = float(np.median(found)) if len(found) else np.nan
    spread = 1.4826 * float(np.median(np.abs(found - middle))) if len(found) else np.nan
    weight = float(np.clip(edge / max(_ENOUGH * usual, 1e-6), 0.0, 1.0)) if usual > 0 else 0.0
    notes = []
    if weight < 0.75:
        notes.append(
            f"Only {edge:.0%} of the outline lies on an edge of the picture, {usual:.0%} in the "
            "usual view: check that the joints belong to this picture."
        )
    if len(found) and abs(middle) > _OFF_PX:
        weight *= 0.25
        notes.append(f"The edges lie {middle:+.1f} px outside of the predicted outline.")
    links = tuple(
        quality
        for index, name in enumerate(link_names)
        if (quality := _link(reading, index, name)) is not None
    )
    for quality in sorted(links, key=lambda link: link.score):
        if quality.score < 0.2 and quality.length_px > 150.0:
            notes.append(f"Link {quality.link} hardly agrees with the picture.")
    return ViewQuality(view_id, links, edge, spread, weight, tuple(notes))


def _link(reading: EdgeReading, index: int, name: str) -> LinkQuality | None:
    own = reading.contour.links == index
    if np.count_nonzero(own) < _FEWEST_SAMPLES:
        return None
    found, offset = reading.found[own], reading.offset[own]
    edge = float(np.mean(found & (np.abs(offset) < _NEAR_PX)))
    colour = float(np.mean(reading.kind[own] == AGAINST_PLATE))
    middle = float(np.median(offset[found])) if found.any() else np.nan
    together = 1.0 if np.isnan(middle) else float(np.exp(-0.5 * (middle / _OFF_PX) ** 2))
    return LinkQuality(
        name,
        float(np.count_nonzero(own) * reading.contour.spacing),
        edge,
        colour,
        middle,
        float(np.clip(edge / _ENOUGH, 0.0, 1.0)) * together,
    )
