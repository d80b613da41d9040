"""Can the result be trusted? Error bars, view health and verdicts on simulated arms.

`easyhecpp bench trust` runs three kinds of families. *Honesty*: noise of several kinds, chi-square
of the true error under the reported covariance. *Health*: one wrong view of five, or joints that
lag behind in all views but two. *Failing*: scenes built so that the pose comes out wrong; the
verdict must not be `ok` when it does. Everything calibrates from nothing but `lagging` and
`honest ...`, which start near the truth: they measure the last stage. Scene i of seed s is drawn
from `default_rng([s, i])`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from easyhecpp.bench.metrics import PoseError, chi_square, ellipsoid_share
from easyhecpp.bench.plots import cumulative_plot
from easyhecpp.bench.scenes_pool import SCENE_FAILURES, RowFile, resumed
from easyhecpp.bench.table import Table
from easyhecpp.bench.trust_scenes import FAMILIES, TrustCase, build_case
from easyhecpp.errors import InputError
from easyhecpp.geometry import exp_se3
from easyhecpp.initialise import sample_initial_pose
from easyhecpp.session.verdict import judge
from easyhecpp.solve.consistency import solve_consistent

F64 = NDArray[np.float64]


_LEAST_WIDTH = 64


@dataclass(frozen=True)
class TrustRow:
    """One scene of one family.

    Attributes:
        family: Name.
        scene: Number of the scene.
        verdict: ``ok``, ``doubtful`` or ``failed``.
        error: Of the pose; None when there was none.
        chi_square: Of the true error, six degrees of freedom.
        wrong_found: Wrong views that were left out.
        wrong: Wrong views that there were.
        good_flagged: Good views that were left out.
        good: Good views that there were.
        reasons: The verdict's sentences, or the error's text.
    """

    family: str
    scene: int
    verdict: str
    error: PoseError | None = None
    chi_square: float | None = None
    wrong_found: int = 0
    wrong: int = 0
    good_flagged: int = 0
    good: int = 0
    reasons: tuple[str, ...] = ()


def run_trust_bench(
    families: Sequence[str] = tuple(FAMILIES),
    *,
    n_scenes: int,
    seed: int,
    workers: int = 1,
    width: int = 640,
    rows_file: Path | None = None,
    progress: Callable[[int, tuple[TrustRow, ...]], None] | None = None,
) -> tuple[TrustRow, ...]:
    """Calibrate simulated scenes and compare verdict and error bar with the truth.

    Args:
        families: Names from `FAMILIES`.
        n_scenes: Scenes per family.
        seed: Decides all of them.
        workers: Processes side by side.
        width: Of the pictures, pixels; 16 : 9.
        rows_file: Keeps finished scenes; they are not done again.
        progress: Called with the number of scenes done, of every family one, and their rows.

    Raises:
        InputError: No scenes, pictures too small, or a file of other settings.
    """
    for name, value, least in (("scenes", n_scenes, 1), ("width", width, _LEAST_WIDTH)):
        if value < least:
            raise InputError(f"{name} is {value}", expected=f"{least} or more")
    settings = {"families": list(families), "seed": seed, "width": width}
    return resumed(
        partial(_scene_rows, tuple(families), seed, width),
        _read_row,
        n_scenes,
        RowFile(rows_file, settings),
        workers=workers,
        progress=progress,
    )


def trust_plot(rows: Sequence[TrustRow]) -> Figure:
    """Share of scenes over the chi-square of the true error, honest families."""
    honest = [row for row in rows if row.family.startswith("honest, ")]
    series = {
        family.removeprefix("honest, "): [
            math.inf if row.chi_square is None else row.chi_square
            for row in honest
            if row.family == family
        ]
        for family in dict.fromkeys(row.family for row in honest)
    }
    return cumulative_plot(
        series,
        title="Is the error bar honest?",
        label="chi-square of the true error, 6 degrees of freedom",
        marks={"median wanted": 5.35, "95 % wanted": 12.59},
    )


def trust_table(rows: Sequence[TrustRow], title: str) -> Table:
    """Sum up, one line a family."""
    lines = []
    for family in dict.fromkeys(row.family for row in rows):
        mine = [r for r in rows if r.family == family]
        chi = [r.chi_square for r in mine if r.chi_square is not None]
        right = [r for r in mine if r.error is not None and r.error.is_right]
        wrong = [r for r in mine if r not in right]
        bad, good = sum(r.wrong for r in mine), sum(r.good for r in mine)
        lines.append(
            (
                family,
                len(mine),
                float(np.median(chi)) if chi else None,
                100.0 * ellipsoid_share(chi) if chi else None,
                f"{len(wrong)}, {sum(r.verdict == 'ok' for r in wrong)} of them ok",
                f"{len(right)}, {sum(r.verdict == 'doubtful' for r in right)} doubtful, "
                f"{sum(r.verdict == 'failed' for r in right)} failed",
                f"{sum(r.wrong_found for r in mine)} of {bad}" if bad else "",
                f"{sum(r.good_flagged for r in mine)} of {good}",
            )
        )
    return Table(
        title=title,
        columns=(
            "family",
            "scenes",
            "chi-square, median",
            "in 95 % ellipsoid, %",
            "wrong poses",
            "right poses",
            "wrong views found",
            "good views flagged",
        ),
        rows=tuple(lines),
    )


def _read_row(row: dict[str, Any]) -> TrustRow:
    plain = dict(row)
    error, reasons = plain.pop("error"), plain.pop("reasons")
    return TrustRow(
        **plain, error=None if error is None else PoseError(**error), reasons=tuple(reasons)
    )


def _scene_rows(
    families: tuple[str, ...], seed: int, width: int, scene: int
) -> tuple[TrustRow, ...]:
    return tuple(_row(family, scene, seed, width) for family in families)


def _row(family: str, scene: int, seed: int, width: int) -> TrustRow:
    case = build_case(family, np.random.default_rng([seed, scene]), width)
    good = len(case.observations) - len(case.wrong)
    row = TrustRow(family, scene, "failed", wrong=len(case.wrong), good=good)
    try:
        return _calibrated(row, case)
    except SCENE_FAILURES as error:
        return replace(row, reasons=(str(error),))


def _calibrated(row: TrustRow, case: TrustCase) -> TrustRow:
    if case.start_near is None:
        first = sample_initial_pose(case.rig, case.camera, case.observations)
        starts, margin = [T for T, _ in first.candidates[:3]], first.margin
    else:
        starts, margin = [case.T_mount_cam @ exp_se3(case.start_near)], 1.0
    estimate, findings = solve_consistent(case.rig, case.camera, case.observations, starts)
    verdict = judge(estimate, findings, case.rig, case.camera, margin=margin)
    out = set(findings.inconsistent)
    return replace(
        row,
        verdict=verdict.verdict,
        error=PoseError.between(estimate.T_mount_cam, case.T_mount_cam),
        chi_square=chi_square(estimate.T_mount_cam, estimate.covariance, case.T_mount_cam),
        wrong_found=len(out & case.wrong),
        good_flagged=len(out - case.wrong),
        reasons=verdict.reasons,
    )
