"""Damped Gauss-Newton on one level of the optimisation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from easyhecpp.geometry import perturb_about
from easyhecpp.solve.evidence import Evidence
from easyhecpp.solve.problem import PoseProblem
from easyhecpp.solve.robust import consistent_scale, inlier_weights, redescending_weights

F64 = NDArray[np.float64]

MIN_SAMPLES = 12
"""Fewer contour samples than this cannot carry six unknowns."""

_SETTLED_PX = 0.05
"""A step that moves the contours by less, in pixels of the level, ends the level."""

_SLACK = 1.01
"""The loss may rise by this factor over the best: robust weights have another minimum than it."""


@dataclass(frozen=True)
class Level:
    """One stage of the optimisation.

    Attributes:
        reduction: Integer by which the image is reduced.
        scale_px: Robust scale of the signed distances, full-size pixels. 0 takes the smoothed
            difference of the masks for the residual instead, with a scale from the data.
        smoothing_px: Standard deviation of the smoothing, pixels of the level.
        spacing: Distance of the contour samples, pixels of the level.
    """

    reduction: int
    scale_px: float = 0.0
    smoothing_px: float = 1.5
    spacing: float = 1.0

    @property
    def name(self) -> str:
        """What the level is called in timings."""
        return f"{'distance' if self.scale_px else 'difference'}_{self.reduction}"


@dataclass(frozen=True)
class Descent:
    """Where a level ended.

    Attributes:
        T_cam_mount: The pose where the steps came to rest, else the best pose seen. The paper's
            loss decides what is accepted and what is best: it needs neither robust weights nor a
            contour to be comparable from pose to pose.
        loss: The loss there, full-size pixels.
        mean_iou: Mean over the views of the intersection over union.
        settled: False when the step limit ended it.
    """

    T_cam_mount: F64
    loss: float
    mean_iou: float
    settled: bool


def descend(
    problem: PoseProblem,
    T_cam_mount: F64,
    level: Level,
    max_iterations: int,
    *,
    threads: bool = True,
) -> Descent:
    """Walk downhill from a pose.

    Args:
        problem: The views.
        T_cam_mount: ``(4, 4)`` start.
        level: The stage.
        max_iterations: Renderings of all views allowed, but for the first.
        threads: Whether views are rendered in parallel; not when several descents already are.
    """

    def look(T: F64) -> tuple[list[Evidence], float]:
        seen = problem.gather(
            T,
            level.reduction,
            smoothing_px=0.0 if level.scale_px else level.smoothing_px,
            spacing=level.spacing,
            threads=threads,
        )
        return seen, float(sum(w * e.mismatch for w, e in zip(problem.weights, seen, strict=True)))

    T = T_cam_mount
    seen, loss = look(T)
    best = Descent(T, loss, _mean_iou(seen), False)
    damping = 1e-6
    for _ in range(max_iterations):
        H, g, n = _normal_equations(problem, seen, level)
        if n < MIN_SAMPLES:
            break
        damped = H + damping * np.diag(np.diag(H)) + 1e-9 * np.eye(6)
        step = np.asarray(np.linalg.solve(damped, g), np.float64)
        settled = step_px(seen, step) < _SETTLED_PX * level.reduction
        T_next = perturb_about(T, problem.centre_cam(T), step)
        seen_next, loss_next = look(T_next)
        if loss_next > _SLACK * best.loss:
            if settled:
                return Descent(T, loss, _mean_iou(seen), True)
            damping = max(10.0 * damping, 1e-2)
            continue
        T, seen, loss = T_next, seen_next, loss_next
        if loss < best.loss:
            best = Descent(T, loss, _mean_iou(seen), False)
        damping = max(damping * 0.1, 1e-6)
        if settled:
            return Descent(T, loss, _mean_iou(seen), True)
    return best


def _mean_iou(seen: Sequence[Evidence]) -> float:
    return float(np.mean([e.iou for e in seen]))


def step_px(seen: Sequence[Evidence], step: F64) -> float:
    """Root mean square displacement of the contours by a step, full-size pixels."""
    J = np.concatenate([e.jacobians for e in seen])
    return float(np.sqrt(np.mean(np.square(J @ step)))) if len(J) else 0.0


def _normal_equations(
    problem: PoseProblem, seen: Sequence[Evidence], level: Level
) -> tuple[F64, F64, int]:
    H, g, n = np.zeros((6, 6)), np.zeros(6), 0
    scale = level.scale_px if level.scale_px else consistent_scale(seen, problem.weights)
    for weight, e in zip(problem.weights, seen, strict=True):
        if level.scale_px:
            r, w = e.distances, redescending_weights(e.distances, scale)
        else:
            r, w = e.residuals, inlier_weights(e.distances, scale)
        J = e.jacobians
        w = w * weight * e.length
        H += J.T @ (w[:, None] * J)
        g += J.T @ (w * r)
        n += int(np.count_nonzero(w > 0.05))
    return H, g, n
