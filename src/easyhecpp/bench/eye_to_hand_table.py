"""The table and the plot of `easyhecpp bench eye-to-hand`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from easyhecpp.bench.eye_to_hand import EyeToHandBench, Step
from easyhecpp.bench.metrics import ErrorSummary, summarise
from easyhecpp.bench.plots import curves_plot
from easyhecpp.bench.published import EYE_TO_HAND
from easyhecpp.bench.table import Cell, Table, describe_machine, failure_notes, machine_sentence
from easyhecpp.sim.studio import tracer


def eye_to_hand_table(bench: EyeToHandBench, steps: Sequence[Step]) -> Table:
    """Ours beside the published rows, by number of views."""
    counts = range(1, bench.views + 1)
    lines: list[tuple[Cell, ...]] = []
    for method in bench.choose:
        lines += _own_lines(_name(bench, method), [_at(steps, method, n) for n in counts])
    for paper in EYE_TO_HAND:
        lines += [
            (f"published {paper.name}", kind, *_padded(values, bench.views))
            for kind, values in (("deg mean", paper.rotation_deg), ("mm mean", paper.position_mm))
        ]
    scenes = len({step.scene for step in steps})
    blind = sum(step.blind for step in steps)
    width, height = bench.size
    return Table(
        title=f"Eye-to-hand, {bench.robot}, {scenes} scenes from {bench.source}, seed {bench.seed}",
        columns=("method", "error", *(f"{n} view{'s'[: n > 1]}" for n in counts)),
        rows=tuple(lines),
        notes=(
            _source_sentence(bench),
            f"{width}x{height}. First joint pose: {bench.first}; every scene counts. Means are "
            "over the right poses (within 20 mm and 2 deg), medians and percentiles over all. The "
            "published rows leave out scenes in which the marker way or DREAM fails.",
            f"Joint poses for an unknown camera instead of chosen ones: {blind} of {len(steps)}.",
            *failure_notes(
                [
                    (f"scene {s.scene}, {s.choose}, view {s.views}", s.status)
                    for s in steps
                    if s.error is None
                ]
            ),
            machine_sentence(describe_machine()),
        ),
    )


def eye_to_hand_plot(bench: EyeToHandBench, steps: Sequence[Step]) -> Figure:
    """Mean errors over the number of views."""
    counts = range(1, bench.views + 1)
    panels: dict[str, dict[str, dict[float, float | None]]] = {}
    for label, attribute in (("mm, mean", "position_mm"), ("deg, mean", "rotation_deg")):
        curves: dict[str, dict[float, float | None]] = {
            _name(bench, method): {
                float(n): getattr(_summary(_at(steps, method, n)), attribute).mean for n in counts
            }
            for method in bench.choose
        }
        for paper in EYE_TO_HAND:
            values = getattr(paper, attribute)[: bench.views]
            curves[f"published {paper.name}"] = {float(n): v for n, v in enumerate(values, 1)}
        panels[label] = curves
    return curves_plot(panels, title=f"From {bench.source}", label="views")


def _own_lines(name: str, by_views: Sequence[Sequence[Step]]) -> list[tuple[Cell, ...]]:
    sums = [_summary(steps) for steps in by_views]
    lines: list[tuple[Cell, ...]] = [
        (name, f"{unit} {label}", *(getattr(getattr(s, attribute), key) for s in sums))
        for unit, attribute in (("deg", "rotation_deg"), ("mm", "position_mm"))
        for label, key in (("mean", "mean"), ("median", "median"), ("95 %", "p95"))
    ]
    seconds = [float(np.median([s.seconds for s in steps])) for steps in by_views]
    choosing = [[s.choosing_s for s in steps if s.choosing_s is not None] for steps in by_views]
    return [
        *lines,
        (name, "failures", *(s.failures for s in sums)),
        (name, "calibration, s", *seconds),
        (name, "choice, s", *(float(np.median(c)) if c else None for c in choosing)),
    ]


def _at(steps: Sequence[Step], method: str, views: int) -> list[Step]:
    return [s for s in steps if s.choose == method and s.views == views]


def _summary(steps: Sequence[Step]) -> ErrorSummary:
    return summarise([step.error for step in steps])


def _name(bench: EyeToHandBench, method: str) -> str:
    return "ours, random views" if method == "random" else f"ours, chosen by {method}"


def _padded(values: Sequence[float], count: int) -> list[float | None]:
    return [values[i] if i < len(values) else None for i in range(count)]


def _source_sentence(bench: EyeToHandBench) -> str:
    if bench.source == "masks":
        return (
            "Masks: exact ones whose boundaries wander to an IoU of 0.982, the paper's, in each "
            "view; SAM itself was not used."
        )
    return (
        f"Images alone, no masks, no weights, {bench.samples} samples a pixel by Mitsuba's "
        f"{tracer()}. Beside the views counted here, {bench.extra} more pictures with the arm "
        "elsewhere tell the background and help to find the arm; the pose rests on the outlines of "
        "the counted views."
    )
