"""The largest set of views that one pose explains, when most views contradict each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from easyhecpp.errors import CalibrationError
from easyhecpp.solve.agreement import Agreement, agreement, pixel_unit, settle, subproblem
from easyhecpp.solve.problem import PoseProblem

F64 = NDArray[np.float64]
Flags = NDArray[np.bool_]

_PAIRS = 14
"""How many of the most promising pairs are tried."""

_FITTED_VIEWS = 12
"""How many views are fitted alone; of more, these are taken evenly."""


@dataclass(frozen=True)
class ConsistentSet:
    """Views that agree with one pose.

    Attributes:
        T_cam_mount: ``(4, 4)``.
        views: ``(V,)`` True for those that agree.
        spread_px: Sum over the agreeing views of their distances: smaller is better.
    """

    T_cam_mount: F64
    views: Flags
    spread_px: float

    def beats(self, other: ConsistentSet) -> bool:
        """More views, or as many that agree better."""
        mine, theirs = int(self.views.sum()), int(other.views.sum())
        return mine > theirs or (mine == theirs and self.spread_px < other.spread_px)


@dataclass(frozen=True)
class Tolerance:
    """How far off a view may be that belongs to a pose: a little more than when fitted alone."""

    distance_px: F64
    mismatch: F64

    def accepts(self, seen: Agreement) -> Flags:
        """``(V,)``."""
        return (seen.distance_px <= self.distance_px) & (seen.mismatch <= self.mismatch)


def largest_consistent_set(problem: PoseProblem, starts: Sequence[F64]) -> ConsistentSet | None:
    """Try the poses of single views and pairs, and keep the one that most views agree with.

    Args:
        problem: All views.
        starts: ``T_cam_mount`` to begin from.

    Returns:
        The set, or None when no two views agree.
    """
    fitted = np.unique(np.linspace(0, len(problem) - 1, _FITTED_VIEWS).round().astype(int))
    singles = _fitted_alone(problem, fitted, starts)
    tolerance = _tolerance(len(problem), fitted, singles, pixel_unit(problem))
    best: ConsistentSet | None = None
    for pair in _promising_pairs(problem, fitted, [s[0] for s in singles]):
        T = _settled(problem, (int(fitted[pair[0]]), int(fitted[pair[1]])), singles[pair[0]][0])
        if T is None:
            continue
        found = _set_at(problem, T, tolerance)
        if found.views.sum() >= 2 and (best is None or found.beats(best)):
            best = found
    if best is None:
        return None
    # The pose on the whole set is better than that of its pair, and may take in another view.
    for _ in range(2):
        T = _settled(problem, tuple(int(v) for v in np.flatnonzero(best.views)), best.T_cam_mount)
        again = _set_at(problem, best.T_cam_mount if T is None else T, tolerance)
        if not again.beats(best):
            break
        best = again
    return best


def _fitted_alone(
    problem: PoseProblem, views: NDArray[np.intp], starts: Sequence[F64]
) -> list[tuple[F64, float, float]]:
    """Per view its own best pose, and distance and mismatch there."""
    found = []
    for view in views.tolist():
        options = [(start, np.inf, np.inf) for start in starts[:1]]
        for start in starts:
            T = _settled(problem, (view,), start)
            if T is not None:
                seen = agreement(subproblem(problem, [view]), T)
                options.append((T, float(seen.distance_px[0]), float(seen.mismatch[0])))
        found.append(min(options, key=lambda o: o[2]))
    return found


def _tolerance(
    n: int,
    fitted: NDArray[np.intp],
    singles: Sequence[tuple[F64, float, float]],
    unit: float,
) -> Tolerance:
    # A view whose joints or mask are wrong is far from its own best pose too: that must not excuse
    # it. The second best view tells what good masks look like, as at least two must be good.
    def capped(values: list[float], factor: float) -> F64:
        cap = factor * sorted(values)[:2][-1]
        full = np.full(n, cap)
        full[fitted] = np.minimum(values, cap)
        return full

    return Tolerance(
        1.3 * capped([s[1] for s in singles], 1.6) + 0.4 * unit,
        1.3 * capped([s[2] for s in singles], 1.8) + 0.015,
    )


def _promising_pairs(
    problem: PoseProblem, fitted: NDArray[np.intp], poses: Sequence[F64]
) -> list[tuple[int, int]]:
    """Pairs of fitted views whose own poses come nearest to explaining each other's masks.

    Indices into ``fitted``; the view with the better pose first.
    """
    among = subproblem(problem, fitted.tolist())
    apart = np.stack([agreement(among, T).distance_px for T in poses])
    rows, columns = np.triu_indices(len(poses), 1)
    order = np.argsort((apart + apart.T)[rows, columns], kind="stable")
    pairs = []
    for k in order[:_PAIRS]:
        a, b = int(rows[k]), int(columns[k])
        pairs.append((a, b) if apart[a, b] <= apart[b, a] else (b, a))
    return pairs


def _settled(problem: PoseProblem, views: tuple[int, ...], start: F64) -> F64 | None:
    try:
        return settle(subproblem(problem, views), start, 20.0)
    except (CalibrationError, np.linalg.LinAlgError):
        return None


def _set_at(problem: PoseProblem, T_cam_mount: F64, tolerance: Tolerance) -> ConsistentSet:
    seen = agreement(problem, T_cam_mount)
    agree = tolerance.accepts(seen)
    return ConsistentSet(T_cam_mount, agree, float(seen.distance_px[agree].sum()))
