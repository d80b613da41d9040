"""How well does a recording agree with itself? `easyhecpp bench repeat CAPTURE`.

Where no truth is known, repetition is the next best witness: the views are dealt into two halves
that share none, each half is calibrated from nothing, and the two poses are compared with each
other and with the uncertainty that they state. What both halves have in common (intrinsics, the
URDF, a habit of the masks) does not show.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from easyhecpp.bench.metrics import PoseError, chi_square
from easyhecpp.bench.scenes_pool import SCENE_FAILURES, in_order
from easyhecpp.bench.table import Table, describe_machine, machine_sentence
from easyhecpp.capture import Capture
from easyhecpp.errors import InputError
from easyhecpp.rig import rides_on_arm
from easyhecpp.session import Calibration, CalibrationConfig, calibrate

WAYS = {
    "given masks": CalibrationConfig(segmenter="given", edges=False),
    "given masks, then edges": CalibrationConfig(segmenter="given"),
    "images alone": CalibrationConfig(segmenter="classical"),
}
"""How each half is calibrated."""

FEWEST_VIEWS = 6
"""Three for each half; with fewer there is no background to tell the arm from."""

_THREE_SIGMA = 20.06
"""Chi-square of six degrees of freedom that is exceeded as rarely as three standard deviations."""


@dataclass(frozen=True)
class RepeatRow:
    """One split, one way.

    Attributes:
        split: Its number.
        way: A name in `WAYS`.
        apart: Of the two poses; None when a half gave none.
        chi_square: Of their difference under the sum of their covariances.
        verdicts: Of the two halves, or the error's text.
    """

    split: int
    way: str
    apart: PoseError | None
    chi_square: float | None
    verdicts: tuple[str, ...]


def run_repeat_bench(
    capture: Capture,
    *,
    splits: int,
    seed: int,
    ways: Sequence[str] = tuple(WAYS),
    workers: int = 1,
    progress: Callable[[int], None] | None = None,
) -> tuple[RepeatRow, ...]:
    """Calibrate disjoint halves of a capture and compare them.

    Args:
        capture: The recording.
        splits: How often the views are dealt out.
        seed: Split i of a seed is always the same.
        ways: Names from `WAYS`; those that need what the capture lacks are left out.
        workers: Processes side by side.
        progress: Called with the number of rows done.

    Raises:
        InputError: Too few views, no splits, or nothing that could be run.
    """
    if splits < 1:
        raise InputError(f"splits is {splits}", expected="1 or more")
    if len(capture.views) < FEWEST_VIEWS:
        raise InputError(
            f"The capture has {len(capture.views)} views",
            where=capture.name,
            expected=f"{FEWEST_VIEWS} or more, to make two halves of three",
        )
    possible = [way for way in ways if _is_possible(capture, way)]
    if not possible:
        raise InputError(
            "The capture has neither masks nor images in all of its views", where=capture.name
        )
    jobs = [(split, way) for split in range(splits) for way in possible]
    rows: list[RepeatRow] = []
    for row in in_order(partial(_row, capture, seed), jobs, workers):
        rows.append(row)
        if progress is not None:
            progress(len(rows))
    return tuple(rows)


def repeat_table(capture: Capture, rows: Sequence[RepeatRow], seed: int) -> Table:
    """Sum up, one line a way."""
    lines = []
    for way in dict.fromkeys(row.way for row in rows):
        mine = [row for row in rows if row.way == way]
        apart = [row.apart for row in mine if row.apart is not None]
        chi = [row.chi_square for row in mine if row.chi_square is not None]
        mm, deg = [e.position_mm for e in apart], [e.rotation_deg for e in apart]
        lines.append(
            (
                way,
                len(mine),
                len(mine) - len(apart),
                *(float(np.percentile(values, q)) if apart else None for values in (mm, deg)
                  for q in (50, 95)),
                float(np.median(chi)) if chi else None,
                100.0 * float(np.mean(np.array(chi) < _THREE_SIGMA)) if chi else None,
            )
        )  # fmt: skip
    return Table(
        title=f"{capture.name}: {len(capture.views)} views dealt into two halves, seed {seed}",
        columns=(
            "from",
            "splits",
            "without a pose",
            "mm median",
            "mm 95 %",
            "deg median",
            "deg 95 %",
            "chi-square, median",
            "within 3 sigma, %",
        ),
        rows=tuple(lines),
        notes=(
            "Distance between the poses of two halves that share no view, each from nothing. "
            "Chi-square has six degrees of freedom: 5.3 is its median when the error bars tell "
            "the truth.",
            machine_sentence(describe_machine()),
        ),
    )


def _is_possible(capture: Capture, way: str) -> bool:
    config = WAYS[way]
    masks = all(view.has_mask for view in capture.views)
    images = all(view.has_image for view in capture.views)
    if config.segmenter != "given":
        # On the arm the whole background moves, which the classical way cannot tell from the arm.
        return images and not rides_on_arm(capture.setup)
    return masks and (images or not config.edges)


def _row(capture: Capture, seed: int, job: tuple[int, str]) -> RepeatRow:
    split, way = job
    ids = np.array(capture.view_ids)
    order = np.random.default_rng([seed, split]).permutation(len(ids))
    halves = [sorted(ids[order[k::2]].tolist()) for k in (0, 1)]
    found: list[Calibration] = []
    for half in halves:
        try:
            found.append(calibrate(capture.subset(half), WAYS[way]))
        except SCENE_FAILURES as error:
            return RepeatRow(split, way, None, None, (str(error),))
    a, b = (each.T_mount_cam for each in found)
    # The two camera frames all but coincide, and so do the tangents that the covariances are of.
    covariance = found[0].estimate.covariance + found[1].estimate.covariance
    return RepeatRow(
        split,
        way,
        PoseError.between(a, b),
        chi_square(a, covariance, b),
        tuple(each.result.verdict for each in found),
    )
