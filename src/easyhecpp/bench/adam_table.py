"""What `easyhecpp bench adam` prints and draws."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from easyhecpp._parallel import usable_cores
from easyhecpp.bench.adam import LAST, METHODS, OURS, START, AdamBench, AdamRow
from easyhecpp.bench.metrics import summarise
from easyhecpp.bench.plots import curves_plot
from easyhecpp.bench.table import Cell, Table, describe_machine, machine_sentence


def adam_table(bench: AdamBench, rows: Sequence[AdamRow]) -> Table:
    """Errors and seconds of both."""
    ours_s = _median([row.seconds for row in rows if row.method == OURS])
    lines: list[tuple[Cell, ...]] = []
    for method in METHODS:
        mine = [row for row in rows if row.method == method]
        summary = summarise([row.error for row in mine])
        degrees, mm = summary.rotation_deg, summary.position_mm
        reached = [row.reached_s for row in mine if row.reached_s is not None]
        seconds = _median([row.seconds for row in mine])
        is_last = method == LAST
        lines.append(
            (
                method,
                f"{summary.failures} of {summary.count}",
                degrees.mean,
                degrees.median,
                degrees.p95,
                mm.mean,
                mm.median,
                mm.p95,
                seconds,
                seconds / ours_s if seconds and ours_s else None,
                f"{len(reached)} of {len(mine)}" if is_last else "",
                _median(reached) if is_last else None,
            )
        )
    scenes = len({row.scene for row in rows})
    return Table(
        title=f"Ours against Adam, {bench.robot}, {scenes} scenes, {bench.views} random views, "
        f"seed {bench.seed}",
        columns=(
            "method",
            "failures",
            "deg mean",
            "deg median",
            "deg 95 %",
            "mm mean",
            "mm median",
            "mm 95 %",
            "seconds",
            "times ours",
            "reaches our error",
            "after s",
        ),
        rows=tuple(lines),
        notes=(*_notes(bench, rows), machine_sentence(describe_machine())),
    )


def adam_plot(bench: AdamBench, rows: Sequence[AdamRow]) -> Figure:
    """Median error over the seconds."""
    last = [row for row in rows if row.method == LAST and row.curve_mm]
    ours = [row for row in rows if row.method == OURS and row.error is not None]
    curves: dict[str, dict[float, float | None]] = {}
    if last:
        seconds = np.median([row.curve_s for row in last], axis=0)
        errors = np.median([row.curve_mm for row in last], axis=0)
        curves["Adam"] = dict(zip(seconds.tolist(), errors.tolist(), strict=True))
    if ours:
        at = _median([row.seconds for row in ours]) or 0.0
        curves["ours"] = {at: _median([row.position_mm for row in ours])}
    return curves_plot(
        {"error of the camera's centre, mm, median": curves},
        title=f"{bench.steps} steps of Adam, and ours",
        label="seconds",
    )


def _notes(bench: AdamBench, rows: Sequence[AdamRow]) -> tuple[str, ...]:
    last = [row for row in rows if row.method == LAST]
    step, bare = (_median([getattr(r, k) for r in last]) for k in ("step_ms", "bare_ms"))
    width, height = bench.size
    cost = (
        f" A step takes {step:.1f} ms, {step / bare:.2f} times a bare forward and backward pass "
        f"({bare:.1f} ms)."
        if step and bare
        else ""
    )
    links = "its exact union of the links, " if bench.combine == "union" else ""
    summed = "" if bench.combine == "union" else ", min(1, sum) of the links' silhouettes"
    half_pixel = "with" if bench.half_pixel else "without"
    return (
        f"Masks of {width}x{height} at an IoU of 0.982, the same for both, as are the renderer, "
        f"{links}{usable_cores()} threads and the start: the arm turned by "
        f"{START.rotation_deg} deg about its middle and moved by {START.position_mm:.0f} mm, the "
        "published error of PVNet.",
        f"Adam: Eq. 1{summed}, {bench.steps} steps of 0.003, the last one taken, as published; "
        f"{half_pixel} the published half pixel.{cost}",
        "'Reaches our error': at some step, even if only in passing, both errors are no larger "
        "than ours. Means are over the right poses (within 20 mm and 2 deg), medians and "
        "percentiles over all; seconds are medians.",
    )


def _median(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.median(known)) if known else None
