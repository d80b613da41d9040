"""The table and the plot of `easyhecpp bench solve`."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from easyhecpp.bench.metrics import ellipsoid_share, summarise
from easyhecpp.bench.plots import cumulative_plot
from easyhecpp.bench.solve import SolveBench
from easyhecpp.bench.table import Table, machine_sentence


def solve_plot(bench: SolveBench) -> Figure:
    """Share of scenes over the error, one line a case."""
    names = [case.name for case in bench.cases if case.fault is None]
    series = {
        name: [
            math.inf if row.error is None else row.error.position_mm
            for row in bench.rows
            if row.case == name
        ]
        for name in names
    }
    return cumulative_plot(
        series,
        title=f"{bench.robot}, {_scene_count(bench)} simulated scenes",
        label="error of the camera's centre, mm",
    )


def solve_table(bench: SolveBench) -> Table:
    """Sum up a benchmark, one line a case."""
    lines = []
    for case in bench.cases:
        rows = [row for row in bench.rows if row.case == case.name]
        if not rows:
            continue
        summary = summarise([row.error for row in rows])
        low, high = summary.failure_interval
        chi_squares = [row.chi_square for row in rows if row.chi_square is not None]
        lines.append(
            (
                case.name,
                rows[0].n_views,
                f"{summary.failures} of {summary.count} ({100 * low:.0f}-{100 * high:.0f} %)",
                summary.position_mm.mean,
                summary.position_mm.median,
                summary.position_mm.p95,
                summary.rotation_deg.mean,
                summary.rotation_deg.median,
                summary.rotation_deg.p95,
                100.0 * ellipsoid_share(chi_squares),
                _median([row.first_pose_s for row in rows]),
                _median([row.solve_s for row in rows]),
            )
        )
    return Table(
        title=f"{bench.robot}, {_scene_count(bench)} simulated scenes, seed {bench.seed}",
        columns=(
            "masks",
            "views",
            "failures (95 % interval)",
            "mm mean",
            "mm median",
            "mm 95 %",
            "deg mean",
            "deg median",
            "deg 95 %",
            "truth in 95 % ellipsoid, %",
            "first pose, s",
            "solve, s",
        ),
        rows=tuple(lines),
        notes=(
            "Right: camera centre within 20 mm and 2 deg; means over the right ones, medians and "
            "percentiles over all. Seconds are medians.",
            machine_sentence(bench.machine),
        ),
    )


def _median(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.median(known)) if known else None


def _scene_count(bench: SolveBench) -> int:
    """Number of scenes."""
    return len({row.scene for row in bench.rows})
