"""The residuals of the optimiser, sorted for people: along the contour, by link, by view."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from easyhecpp._parallel import parallel_map
from easyhecpp.report.plots import displacement_plot, histogram
from easyhecpp.solve import ContourFit, PoseEstimate
from easyhecpp.solve.evidence import sample, signed_distance

F64 = NDArray[np.float64]

# A cell of the table needs this length of contour to say something.
_MIN_CELL_PX = 25
# A link is odd when it is off by this much, and by this many times what links usually are.
_ODD_PX, _ODD_RATIO = 3.0, 4.0
_STEP_PX = 3
_SMALLEST_LIMIT_PX, _LARGEST_LIMIT_PX = 2.0, 12.0


@dataclass(frozen=True)
class LinkRow:
    """One link's displacement in each view.

    Attributes:
        link: Its name.
        cells: Median displacement by view, pixels; None where too little of it is on the contour.
        overall: Median over all views, None likewise.
    """

    link: str
    cells: tuple[float | None, ...]
    overall: float | None


def displacements(fit: ContourFit) -> F64:
    """How far the observed outline lies outside of the rendered one, ``(N,)`` pixels.

    The distances, since the residuals saturate at the smoothing's reach.
    """
    return fit.distances


def axis_limit_px(estimate: PoseEstimate) -> float:
    """One end for all displacement axes, so that the views can be compared at a glance."""
    used = [np.abs(displacements(fit)[fit.weights >= 0.5]) for fit in estimate.contours]
    values = np.concatenate([*used, np.zeros(1)])
    spread = float(np.ceil(1.3 * np.percentile(values, 99)))
    return float(np.clip(spread, _SMALLEST_LIMIT_PX, _LARGEST_LIMIT_PX))


def contour_plot(
    fit: ContourFit, lines: Sequence[F64], names: Sequence[str], limit_px: float
) -> str:
    """Displacement along the contour of one view as SVG; "" where there is no contour.

    Args:
        fit: The view's residuals.
        lines: The outline at the same pose, which gives the order; pixels.
        names: Link names.
        limit_px: End of the vertical axis.
    """
    if len(fit.points) < 2 or not lines:
        return ""
    position = _way(lines, fit.points)
    order = np.argsort(position, kind="stable")[::_STEP_PX]
    return displacement_plot(
        position[order],
        displacements(fit)[order],
        fit.weights[order],
        [names[int(i)] for i in fit.links[order]],
        limit_px,
    )


def all_views_histogram(estimate: PoseEstimate, limit_px: float) -> str:
    """Histogram of all displacements as SVG."""
    return histogram(
        np.concatenate([displacements(fit) for fit in estimate.contours]),
        np.concatenate([fit.weights for fit in estimate.contours]),
        limit_px,
    )


def link_table(estimate: PoseEstimate, names: Sequence[str]) -> list[LinkRow]:
    """Median displacement by link and view; links that are on no contour are left out."""
    return _by_link(estimate.contours, [displacements(fit) for fit in estimate.contours], names)


def mask_table(
    estimate: PoseEstimate, masks: Mapping[str, NDArray[np.bool_]], names: Sequence[str]
) -> list[LinkRow]:
    """The same against the masks themselves, whatever the pose was fitted to in the end.

    The last stage may fit edges, and sees only those near the arm: a tool that the URDF lacks shows
    in the masks alone.
    """
    masked = [
        (fit, masks[view.id])
        for view, fit in zip(estimate.views, estimate.contours, strict=True)
        if view.id in masks
    ]
    distances = parallel_map(
        lambda view: sample(signed_distance(view[1].astype(np.float32)), view[0].points), masked
    )
    return _by_link([fit for fit, _ in masked], distances, names)


def _by_link(
    fits: Sequence[ContourFit], distances: Sequence[F64], names: Sequence[str]
) -> list[LinkRow]:
    rows: list[LinkRow] = []
    for index, name in enumerate(names):
        parts = [d[fit.links == index] for fit, d in zip(fits, distances, strict=True)]
        together = np.concatenate([np.zeros(0), *parts])
        if len(together) >= _MIN_CELL_PX:
            rows.append(LinkRow(name, tuple(_median(part) for part in parts), _median(together)))
    return rows


def odd_links(rows: Sequence[LinkRow]) -> list[LinkRow]:
    """Links that are off in the same direction in most views, and far more so than the others."""
    middles = [abs(row.overall) for row in rows if row.overall is not None]
    bound = max(_ODD_PX, _ODD_RATIO * float(np.median(middles))) if middles else np.inf
    found: list[LinkRow] = []
    for row in rows:
        cells = [cell for cell in row.cells if cell is not None]
        if row.overall is None or len(cells) < 2:
            continue
        same = [cell for cell in cells if cell * row.overall > 0 and abs(cell) > 0.5 * bound]
        if abs(row.overall) > bound and 2 * len(same) > len(cells):
            found.append(row)
    return found


def _median(values: F64) -> float | None:
    return float(np.median(values)) if len(values) >= _MIN_CELL_PX else None


def _way(lines: Sequence[F64], points: F64) -> F64:
    """How far along the lines, laid end to end, the nearest point of them is; ``(N,)`` pixels."""
    steps = [np.r_[0.0, np.linalg.norm(np.diff(line, axis=0), axis=1)] for line in lines]
    way = np.cumsum(np.concatenate(steps))
    _, nearest = KDTree(np.concatenate(lines)).query(points)
    return way[nearest]
