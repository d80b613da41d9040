"""Small pictures of numbers as SVG text.

Written by hand: they take a few kilobytes, follow the page's light or dark colours through its
style sheet, and stay sharp in print.
"""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from easyhecpp.report.uncertainty import SIGMAS_95, Uncertainty

F64 = NDArray[np.float64]

_LETTER_PX = 6.2


def displacement_plot(
    position: F64, displacement: F64, weight: F64, links: Sequence[str], limit_px: float
) -> str:
    """Displacement of the observed outline along the rendered contour of one view.

    Args:
        position: ``(N,)`` way along the contour, pixels, ascending.
        displacement: ``(N,)`` pixels, positive outward; cut at the limit.
        weight: ``(N,)``; below one half a sample took no part.
        links: ``(N,)`` names of the links that form the contour.
        limit_px: End of the vertical axis.
    """
    width, height, left, top, floor = 1080.0, 132.0, 44.0, 8.0, 100.0
    end = max(float(position[-1]), 1.0)
    x = left + (width - left - 4.0) * position / end
    middle = 0.5 * (top + floor)
    scale = (floor - top) / (2.0 * limit_px)
    y = middle - scale * np.clip(displacement, -limit_px, limit_px)
    parts = [_open(width, height, "Displacement along the contour")]
    for tick in _ticks(limit_px):
        at = middle - scale * tick
        kind = "axis" if tick == 0 else "grid"
        parts.append(f'<path class="{kind}" d="M{left:.0f} {at:.1f}H{width - 4:.0f}"/>')
        parts.append(f'<text class="tick" x="{left - 7:.0f}" y="{at + 4:.1f}" text-anchor="end">')
        parts.append(f"{tick:+g}</text>" if tick else "0</text>")
    used = weight >= 0.5
    for kind, wanted in (("bars", used), ("bars out", ~used)):
        d = "".join(
            f"M{a:.1f} {middle:.1f}V{b:.1f}"
            for a, b in zip(x[wanted].tolist(), y[wanted].tolist(), strict=True)
        )
        if d:
            parts.append(f'<path class="{kind}" d="{d}"/>')
    parts += _link_band(x, links, floor + 8.0)
    parts.append("</svg>")
    return "".join(parts)


def _link_band(x: F64, links: Sequence[str], y: float) -> list[str]:
    """Which link forms the contour, as alternating strips with the names that fit."""
    starts = [0, *(i for i in range(1, len(links)) if links[i] != links[i - 1]), len(links)]
    parts: list[str] = []
    for number, (a, b) in enumerate(pairwise(starts)):
        begin, end = float(x[a]), float(x[min(b, len(x) - 1)])
        if end - begin < 1.5:
            continue
        name = escape(links[a])
        parts.append(
            f'<rect class="band b{number % 2}" x="{begin:.1f}" y="{y:.0f}" '
            f'width="{end - begin:.1f}" height="16"><title>{name}</title></rect>'
        )
        if len(links[a]) * _LETTER_PX < end - begin - 4.0:
            parts.append(
                f'<text class="tick" x="{0.5 * (begin + end):.1f}" y="{y + 12:.0f}" '
                f'text-anchor="middle">{name}</text>'
            )
    return parts


def histogram(displacement: F64, weight: F64, limit_px: float) -> str:
    """How often which displacement occurs, all views together; the ends collect what is beyond."""
    width, height, left, top, floor = 520.0, 190.0, 16.0, 10.0, 150.0
    edges = np.linspace(-limit_px, limit_px, 42)
    inside = np.clip(displacement, -limit_px + 1e-9, limit_px - 1e-9)
    used = weight >= 0.5
    kept, _ = np.histogram(inside[used], edges)
    out, _ = np.histogram(inside[~used], edges)
    tallest = max(1, int((kept + out).max()))
    bar = (width - 2 * left) / len(kept)
    parts = [_open(width, height, "Histogram of displacements")]
    for kind, low, counts in (("fill", np.zeros_like(kept), kept), ("fill out", kept, out)):
        for i, (base, count) in enumerate(zip(low.tolist(), counts.tolist(), strict=True)):
            if count:
                tall = (floor - top) * count / tallest
                y = floor - (floor - top) * base / tallest - tall
                parts.append(
                    f'<rect class="{kind}" x="{left + i * bar + 0.5:.1f}" y="{y:.1f}" '
                    f'width="{bar - 1:.1f}" height="{tall:.1f}"/>'
                )
    parts.append(f'<path class="axis" d="M{left:.0f} {floor + 0.5:.1f}H{width - left:.0f}"/>')
    for tick in _ticks(limit_px):
        x = left + (width - 2 * left) * (tick + limit_px) / (2 * limit_px)
        label = f"{tick:+g}" if tick else "0"
        parts.append(f'<path class="axis" d="M{x:.1f} {floor:.0f}v5"/>')
        parts.append(f'<text class="tick" x="{x:.1f}" y="{floor + 19:.0f}" text-anchor="middle">')
        parts.append(f"{label}</text>")
    parts.append(
        f'<text class="tick" x="{width / 2:.0f}" y="{height - 4:.0f}" text-anchor="middle">'
        "pixels that the observed outline lies outside (+) or inside (−)</text></svg>"
    )
    return "".join(parts)


def ellipsoid_panels(uncertainty: Uncertainty) -> str:
    """The 95 % ellipsoids from three sides, at one scale, in millimetres."""
    shapes = [("camera", uncertainty.camera)]
    if uncertainty.workspace is not None:
        shapes.append(("workspace", uncertainty.workspace))
    longest = max(
        1e3 * SIGMAS_95 * float(np.sqrt(max(np.diag(covariance).max(), 1e-18)))
        for _, covariance in shapes
    )
    step = _nice(longest / 1.5)
    half = 1.15 * max(longest, step)
    side, gap, top = 176.0, 16.0, 22.0
    parts = [_open(3 * side + 2 * gap, side + top + 20.0, "Uncertainty ellipsoids")]
    panels = (
        ("seen from the camera", (0, 1), ("right", "down")),
        ("from above", (0, 2), ("right", "forward")),
        ("from the side", (2, 1), ("forward", "down")),
    )
    for number, (title, axes, names) in enumerate(panels):
        x0 = number * (side + gap)
        parts.append(f'<g transform="translate({x0:.0f} {top:.0f})">')
        parts.append(f'<text class="name" x="0" y="-8">{title}</text>')
        parts += _millimetre_grid(side, half, step)
        # Forward points up on the page where it is seen from above, as on a map.
        flip = -1.0 if axes == (0, 2) else 1.0
        for kind, covariance in shapes:
            parts.append(_ellipse(covariance, axes, flip, side, half, kind))
        parts.append(_axis_names(side, names, upward=flip < 0))
        parts.append("</g>")
    parts.append(
        f'<text class="tick" x="0" y="{side + top + 16:.0f}">one square = {step:g} mm</text></svg>'
    )
    return "".join(parts)


def _millimetre_grid(side: float, half: float, step: float) -> list[str]:
    lines: list[str] = []
    count = int(half / step)
    for i in range(-count, count + 1):
        at = side / 2 * (1 + i * step / half)
        kind = "axis" if i == 0 else "grid"
        lines.append(f'<path class="{kind}" d="M{at:.1f} 0V{side:.0f}M0 {at:.1f}H{side:.0f}"/>')
    return [*lines, f'<rect class="frame" width="{side:.0f}" height="{side:.0f}"/>']


def _ellipse(
    covariance: F64, axes: tuple[int, int], flip: float, side: float, half: float, kind: str
) -> str:
    plane = 1e6 * SIGMAS_95**2 * covariance[np.ix_(axes, axes)]
    plane = plane * np.array([[1.0, flip], [flip, 1.0]])
    squares, vectors = np.linalg.eigh(plane)
    radii = np.sqrt(np.maximum(squares, 0.0)) * side / (2 * half)
    angle = float(np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1])))
    return (
        f'<ellipse class="{kind}" rx="{max(radii[1], 0.6):.1f}" ry="{max(radii[0], 0.6):.1f}" '
        f'transform="translate({side / 2:.0f} {side / 2:.0f}) rotate({angle:.1f})"/>'
    )


def _axis_names(side: float, names: tuple[str, str], *, upward: bool) -> str:
    across, along = names
    y = 11.0 if upward else side - 5.0
    arrow = "↑" if upward else "↓"
    return (
        f'<text class="tick" x="{side - 4:.0f}" y="{side / 2 - 5:.0f}" text-anchor="end">'
        f"{across} →</text>"
        f'<text class="tick" x="{side / 2 + 5:.0f}" y="{y:.0f}">{along} {arrow}</text>'
    )


def _open(width: float, height: float, label: str) -> str:
    return (
        f'<svg class="plot" viewBox="0 0 {width:.0f} {height:.0f}" role="img" aria-label="{label}">'
    )


def _ticks(limit: float) -> list[float]:
    step = _nice(limit / 1.5)
    count = int(limit / step + 1e-9)
    return [i * step for i in range(-count, count + 1)]


def _nice(value: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is not above the value."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(max(f for f in (1.0, 2.0, 5.0) if f * power <= value * (1 + 1e-9)) * power)
