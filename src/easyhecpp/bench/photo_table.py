"""The table and the plot of `easyhecpp bench photo`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from easyhecpp.bench.metrics import Spread, wilson_interval
from easyhecpp.bench.photo import WORSE_MM, WORSE_SHARE, PhotoBench, PhotoRow
from easyhecpp.bench.plots import cumulative_plot
from easyhecpp.bench.table import Cell, Table, describe_machine, machine_sentence
from easyhecpp.sim.studio import tracer


def photo_table(bench: PhotoBench, rows: Sequence[PhotoRow]) -> Table:
    """Sum up: two lines an arm, with the edge stage and without, and two for all arms."""
    lines = []
    groups = {arm: [r for r in rows if r.arm == arm] for arm in bench.arms}
    if len(groups) > 1:
        groups["all"] = list(rows)
    for arm, mine in groups.items():
        if mine:
            lines += [_line(arm, mine, edges=edges) for edges in (False, True)]
    width, height = bench.size
    wrong_ok = [r.scene for r in rows if not r.is_right and r.verdict == "ok"]
    return Table(
        title=f"{len(rows)} photo-real scenes from images alone, seed {bench.seed}",
        columns=(
            "arm",
            "edge stage",
            "failures (95 % interval)",
            "mm per m of reach, mean",
            "median",
            "95 %",
            "deg mean",
            "deg median",
            "deg 95 %",
            "ok / doubtful / failed / error",
            "worse by edges",
            "s",
        ),
        rows=tuple(lines),
        notes=(
            f"{bench.views} views of {width}x{height}, {bench.samples} samples a pixel by "
            f"Mitsuba's {tracer()}, {bench.difficulty} cells; no masks given, no weights. Right: "
            "camera centre within 20 mm and 2 deg; means over the right ones, medians and "
            "percentiles over all.",
            f"Wrong poses called ok: {len(wrong_ok)}"
            + (f" (scenes {', '.join(map(str, wrong_ok))})." if wrong_ok else "."),
            "Worse by edges: the error of a right pose grew by more than "
            f"{WORSE_SHARE:.0%} and {WORSE_MM} mm.",
            machine_sentence(describe_machine()),
        ),
    )


def photo_plot(rows: Sequence[PhotoRow]) -> Figure:
    """Share of scenes over the error per metre of arm."""
    return cumulative_plot(
        {
            "masks only": [_per_metre(r.before_mm, r) for r in rows],
            "with the edge stage": [_per_metre(r.position_mm, r) for r in rows],
        },
        title="Photo-real scenes, from images alone",
        label="error of the camera's centre, mm per metre of the arm's reach",
        marks={"aim": 0.5},
    )


def _line(arm: str, rows: Sequence[PhotoRow], *, edges: bool) -> tuple[Cell, ...]:
    errors = [row.error if edges else row.before for row in rows]
    right = [error is not None and error.is_right for error in errors]
    failures = len(rows) - sum(right)
    low, high = wilson_interval(failures, len(rows))
    metre = Spread.of(
        [_per_metre(e and e.position_mm, r) for e, r in zip(errors, rows, strict=True)], right
    )
    degrees = Spread.of([e and e.rotation_deg for e in errors], right)
    words = [sum(r.verdict == w for r in rows) for w in ("ok", "doubtful", "failed", "error")]
    seconds = [r.seconds for r in rows if r.seconds is not None]
    return (
        arm,
        "yes" if edges else "no",
        f"{failures} of {len(rows)} ({100 * low:.0f}-{100 * high:.0f} %)",
        metre.mean,
        metre.median,
        metre.p95,
        degrees.mean,
        degrees.median,
        degrees.p95,
        " / ".join(map(str, words)) if edges else "",
        sum(r.worse_by_edges for r in rows) if edges else None,
        float(np.median(seconds)) if edges and seconds else None,
    )


def _per_metre(millimetres: float | None, row: PhotoRow) -> float:
    if millimetres is None or row.reach_m is None:
        return float("inf")
    return millimetres / row.reach_m
