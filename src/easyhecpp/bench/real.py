"""Recordings whose truth is known: `easyhecpp bench real FOLDER`.

Every folder that holds a `truth.json` beside its capture is calibrated and compared: with the
camera's known pose, or, for one camera of a stereo pair, with what the factory says of the pair.
A stereo pair tests two calibrations at once, and neither knows of the other.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from easyhecpp.bench.metrics import PoseError, chi_square, summarise
from easyhecpp.bench.plots import cumulative_plot
from easyhecpp.bench.table import Cell, Table, describe_machine, machine_sentence
from easyhecpp.bench.truth_file import TRUTH, TruthFile, read_truth
from easyhecpp.capture import Capture
from easyhecpp.errors import CalibrationError, InputError
from easyhecpp.geometry import inverse
from easyhecpp.session import Calibration, CalibrationConfig, calibrate
from easyhecpp.session.masks import check_segmenter

F64 = NDArray[np.float64]


@dataclass(frozen=True)
class RealRow:
    """One recording.

    Attributes:
        name: Its folder, below the one that was asked for.
        robot: The arm.
        views: Their number.
        truth: ``pose`` or ``stereo``.
        error: Of the camera's pose, or of the pair's; None where there is none.
        verdict: ``ok``, ``doubtful``, ``failed``, of a pair the worse one; ``error``.
        sigma_mm: Stated standard deviation of the position, of a pair that of the difference.
        chi_square: Of the true error under the stated uncertainty; for a known pose only.
        seconds: Of the calibration, of a pair both.
        status: The error's text.
    """

    name: str
    robot: str = ""
    views: int = 0
    truth: str = ""
    error: PoseError | None = None
    verdict: str = "error"
    sigma_mm: float | None = None
    chi_square: float | None = None
    seconds: float | None = None
    status: str = ""


_ORDER = ("ok", "doubtful", "failed")


def run_real_bench(
    folder: Path,
    config: CalibrationConfig | None = None,
    *,
    progress: Callable[[str], None] | None = None,
) -> tuple[RealRow, ...]:
    """Calibrate every recording below a folder whose truth is known.

    Args:
        folder: Holds captures with a truth file each, or is one.
        config: Of the calibrations.
        progress: Told which recording is calibrated.

    Raises:
        InputError: There is no recording with a truth file, or no such segmenter. A recording or
            a truth file that cannot be read is a row with its text, as is a calibration that fails.
        MissingExtraError: The segmenter's packages are not installed.
    """
    places = sorted(path.parent for path in folder.rglob(TRUTH))
    if not places:
        raise InputError(
            f"No capture below this folder has a {TRUTH}",
            where=folder,
            expected="captures with a truth file each; docs/benchmarks.md describes it",
        )
    config = config or CalibrationConfig()
    check_segmenter(config.segmenter, config.pretrained)
    known: dict[Path, tuple[Calibration, float]] = {}
    rows = []
    for place in places:
        name = str(place.relative_to(folder)) if place != folder else place.name
        if progress is not None:
            progress(name)
        rows.append(_row(place, name, config, known))
    return tuple(rows)


def real_table(folder: Path, rows: Sequence[RealRow]) -> Table:
    """One line a recording, and one for all."""
    summary = summarise([row.error for row in rows])
    lines: list[tuple[Cell, ...]] = [
        (
            row.name,
            row.robot,
            row.views,
            row.truth,
            row.error and row.error.position_mm,
            row.error and row.error.rotation_deg,
            row.sigma_mm,
            row.verdict,
            row.seconds,
        )
        for row in rows
    ]
    lines.append(
        (
            "all, median",
            "",
            sum(row.views for row in rows),
            "",
            summary.position_mm.median,
            summary.rotation_deg.median,
            None,
            f"{summary.failures} of {summary.count} wrong",
            None,
        )
    )
    chi = [row.chi_square for row in rows if row.chi_square is not None]
    return Table(
        title=f"Recordings with a known truth in {folder.name}",
        columns=("recording", "arm", "views", "truth", "mm", "deg", "sigma, mm", "verdict", "s"),
        rows=tuple(lines),
        notes=(
            "truth pose: camera's centre and orientation against the known ones. truth stereo: two "
            "cameras calibrated apart, their relative pose against the factory's.",
            *((f"Chi-square, median: {np.median(chi):.1f} of 6 expected.",) if chi else ()),
            *(f"{row.name}: {row.status}" for row in rows if row.status),
            machine_sentence(describe_machine()),
        ),
    )


def real_plot(rows: Sequence[RealRow]) -> Figure:
    """Share of recordings over the error."""
    return cumulative_plot(
        {
            kind: [row.error.position_mm if row.error else float("inf") for row in mine]
            for kind in ("pose", "stereo", "")
            if (mine := [row for row in rows if row.truth == kind])
        },
        title="Recordings with a known truth",
        label="error, mm",
    )


def _row(
    place: Path,
    name: str,
    config: CalibrationConfig,
    known: dict[Path, tuple[Calibration, float]],
) -> RealRow:
    row = RealRow(name)
    try:
        truth = read_truth(place)
        row = replace(row, truth="pose" if truth.other is None else "stereo")
        found, seconds = _calibrated(place, config, known)
        row = replace(
            row,
            robot=found.capture.robot.name,
            views=len(found.capture.views),
            seconds=seconds,
            verdict=found.result.verdict,
        )
        if truth.T_mount_cam is not None:
            return _against_pose(row, found, truth.T_mount_cam)
        return _against_stereo(row, found, truth, config, known)
    except (CalibrationError, InputError) as error:
        return replace(row, verdict="error", status=str(error))


def _against_pose(row: RealRow, found: Calibration, T_mount_cam: F64) -> RealRow:
    return replace(
        row,
        error=PoseError.between(found.T_mount_cam, T_mount_cam),
        sigma_mm=_sigma_mm(found),
        chi_square=chi_square(found.T_mount_cam, found.estimate.covariance, T_mount_cam),
    )


def _against_stereo(
    row: RealRow,
    found: Calibration,
    truth: TruthFile,
    config: CalibrationConfig,
    known: dict[Path, tuple[Calibration, float]],
) -> RealRow:
    assert truth.other is not None  # the reader gives one of the two
    assert truth.T_other_cam is not None
    other, seconds = _calibrated(truth.other, config, known)
    T_other_cam = inverse(other.T_mount_cam) @ found.T_mount_cam
    return replace(
        row,
        error=PoseError.between(T_other_cam, truth.T_other_cam),
        sigma_mm=float(np.hypot(_sigma_mm(found), _sigma_mm(other))),
        verdict=max(found.result.verdict, other.result.verdict, key=_ORDER.index),
        seconds=(row.seconds or 0.0) + seconds,
    )


def _calibrated(
    place: Path, config: CalibrationConfig, known: dict[Path, tuple[Calibration, float]]
) -> tuple[Calibration, float]:
    """Calibrate a folder once, however many pairs it belongs to."""
    key = place.resolve()
    if key not in known:
        capture = Capture.load(place)
        clock = time.perf_counter()
        found = calibrate(capture, config)
        known[key] = found, time.perf_counter() - clock
    return known[key]


def _sigma_mm(found: Calibration) -> float:
    return 1e3 * float(np.sqrt(np.trace(found.estimate.covariance[:3, :3])))
