"""The plots beside the tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

_SIZE = (7.2, 4.2)


def cumulative_plot(
    series: Mapping[str, Sequence[float]],
    *,
    title: str,
    label: str,
    marks: Mapping[str, float] | None = None,
) -> Figure:
    """Share of scenes whose error is at most so large.

    Args:
        series: Errors by name; one that is not finite counts, but is never reached.
        title: Above the plot.
        label: Of the horizontal axis, with unit.
        marks: Values to compare with, drawn upright, by name.
    """
    figure = Figure(figsize=_SIZE, layout="constrained")
    axes = figure.add_subplot()
    for name, errors in series.items():
        known = np.sort([e for e in errors if np.isfinite(e)])
        share = 100.0 * np.arange(1, len(known) + 1) / max(1, len(errors))
        axes.step(known, share, where="post", label=name)
    for i, (name, value) in enumerate((marks or {}).items()):
        axes.axvline(value, color=f"C{len(series) + i}", linestyle="--", label=name)
    axes.set(title=title, xlabel=label, ylabel="share of scenes, %", xscale="log", ylim=(0, 101))
    _plain_numbers(axes.xaxis)
    axes.grid(alpha=0.3, which="both")
    axes.legend(loc="best", fontsize="small")
    return figure


def curves_plot(
    panels: Mapping[str, Mapping[str, Mapping[float, float | None]]],
    *,
    title: str,
    label: str,
    log: bool = True,
) -> Figure:
    """Values over a quantity such as the number of views, one panel for each kind of value.

    Args:
        panels: By the label of the vertical axis: by name of the curve: value by abscissa.
        title: Above the plot.
        label: Of the horizontal axis.
        log: Whether the vertical axes are logarithmic.
    """
    figure = Figure(figsize=(4.6 * len(panels), _SIZE[1]), layout="constrained")
    figure.suptitle(title)
    for i, (kind, curves) in enumerate(panels.items(), start=1):
        axes = figure.add_subplot(1, len(panels), i)
        for name, points in curves.items():
            known = sorted((x, y) for x, y in points.items() if y is not None and np.isfinite(y))
            x, y = [x for x, _ in known], [y for _, y in known]
            style = "--." if name.startswith("published") else "-o"
            axes.plot(x, y, style, label=name, markersize=5)
        axes.set(xlabel=label, ylabel=kind, yscale="log" if log else "linear")
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        if log:
            _plain_numbers(axes.yaxis)
        axes.grid(alpha=0.3, which="both")
        if i == len(panels):
            axes.legend(fontsize="small")
    return figure


def _plain_numbers(axis: Axis) -> None:
    """0.1, 0.2, 0.5, 1, 2 instead of powers of ten."""
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0), numticks=15))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())
