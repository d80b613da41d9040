"""The pose that explains all masks at once: coarse to fine, second order, robust.

1. *Distance levels.* Every contour sample is drawn to the observed outline along its normal
   (signed distance), with a wide and then a narrow robust scale: from tens of pixels to one.
2. *Difference levels*, at half and full size: the smoothed difference of the masks, whose root is
   the minimum of the paper's loss (Eq. 1) without its half-pixel and double-counting biases.
3. *Generalised least squares*: the errors' correlation along the contour is estimated from the
   residuals, and the pose is solved once more with it, together with one dilation common to all
   masks. The covariance comes from this stage.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from easyhecpp._parallel import parallel_map
from easyhecpp.camera import Camera
from easyhecpp.errors import CalibrationError
from easyhecpp.geometry import inverse, perturb_about, pose_covariance_from_centred
from easyhecpp.rig import Rig
from easyhecpp.solve.correlation import ContourPoints, NoiseModel, average_samples, fit_noise
from easyhecpp.solve.evidence import Evidence
from easyhecpp.solve.problem import PoseProblem
from easyhecpp.solve.robust import consistent_scale, inlier_weights, redescending_weights
from easyhecpp.solve.types import (
    ContourFit,
    Observation,
    PoseEstimate,
    SolveConfig,
    ViewFit,
)

F64 = NDArray[np.float64]

COVARIANCE_INFLATION = 1.3
"""Factor on the covariance for what the noise model leaves out (its variances are estimates, and
contours bend). Set on simulated noise families other than those of the published tables."""

_MIN_SAMPLES = 12
_SETTLED_PX = 0.02


@dataclass(frozen=True)
class _Level:
    """One stage: image size, witness, smoothing (pixels of the level), robust scale (full px)."""

    reduction: int
    use_distance: bool
    smoothing_px: float
    spacing: float
    scale_px: float


def solve_pose(
    rig: Rig,
    camera: Camera,
    observations: Sequence[Observation],
    T_mount_cam_init: F64,
    config: SolveConfig | None = None,
) -> PoseEstimate:
    """Optimise the camera's pose on all views at once.

    Args:
        rig: Robot and set-up.
        camera: Intrinsics.
        observations: The views with their masks.
        T_mount_cam_init: ``(4, 4)`` start; its contours may be off by ``config.start_error_px``.
        config: Settings.

    Returns:
        The best pose seen, its covariance and how each view agrees with it.

    Raises:
        InputError: No view, or sizes that do not fit.
        CalibrationError: The arm is in no view at the start.
    """
    config = config or SolveConfig()
    clock = time.perf_counter()
    problem = PoseProblem(rig, camera, observations)
    T = inverse(np.asarray(T_mount_cam_init, np.float64))
    timings = {"prepare": time.perf_counter() - clock}
    converged = True
    for level in _levels(config.start_error_px):
        clock = time.perf_counter()
        T, converged = _descend(problem, T, level, config.max_iterations)
        name = f"{'distance' if level.use_distance else 'difference'}_{level.reduction}"
        timings[name] = timings.get(name, 0.0) + time.perf_counter() - clock
    clock = time.perf_counter()
    final = _generalised_least_squares(problem, T, config)
    timings["correlated"] = time.perf_counter() - clock
    return _estimate(problem, final, converged, timings)


def _levels(start_error_px: float) -> list[_Level]:
    levels = [
        _Level(4, True, 1.5, 1.0, max(6.0, 0.5 * start_error_px)),
        _Level(4, True, 1.5, 1.0, 4.0),
        _Level(2, False, 1.5, 1.0, 0.0),
        _Level(1, False, 1.2, 1.0, 0.0),
    ]
    return levels if start_error_px > 8.0 else levels[1:]


def _descend(
    problem: PoseProblem, T_cam_mount: F64, level: _Level, max_iterations: int
) -> tuple[F64, bool]:
    """Damped Gauss-Newton on one level; returns the best pose seen and whether it settled.

    "Best" is by the paper's loss, which needs no robust weights and no contour to be comparable.
    """

    def look(T: F64) -> tuple[list[Evidence], float]:
        seen = problem.gather(
            T, level.reduction, smoothing_px=level.smoothing_px, spacing=level.spacing
        )
        return seen, float(sum(w * e.mismatch for w, e in zip(problem.weights, seen, strict=True)))

    T = T_cam_mount
    seen, loss = look(T)
    damping = 1e-6
    for _ in range(max_iterations):
        H, g, n = _normal_equations(problem, seen, level)
        if n < _MIN_SAMPLES:
            break
        step = np.linalg.solve(H + damping * np.diag(np.diag(H)) + 1e-9 * np.eye(6), g)
        moved = float(np.sqrt(step @ H @ step / max(np.trace(H), 1e-30) * 6.0))
        moved_px = _step_px(seen, step)
        T_next = perturb_about(T, problem.centre_cam(T), step)
        seen_next, loss_next = look(T_next)
        if loss_next > loss * (1.0 + 1e-4) and moved_px > _SETTLED_PX:
            damping = max(10.0 * damping, 1e-2)
            if damping > 1e3:
                return T, True
            continue
        T, seen, loss = T_next, seen_next, loss_next
        damping = max(damping * 0.1, 1e-6)
        del moved
        if moved_px < _SETTLED_PX * level.reduction:
            return T, True
    return T, False


def _step_px(seen: Sequence[Evidence], step: F64) -> float:
    """Root mean square displacement of the contours by a step, full-size pixels."""
    J = np.concatenate([e.jacobians for e in seen])
    return float(np.sqrt(np.mean(np.square(J @ step)))) if len(J) else 0.0


def _normal_equations(
    problem: PoseProblem, seen: Sequence[Evidence], level: _Level
) -> tuple[F64, F64, int]:
    H, g, n = np.zeros((6, 6)), np.zeros(6), 0
    scale = level.scale_px if level.use_distance else consistent_scale(seen)
    for weight, e in zip(problem.weights, seen, strict=True):
        if level.use_distance:
            r, w = e.distances, redescending_weights(e.distances, scale)
        else:
            r, w = e.residuals, inlier_weights(e.distances, scale)
        J = e.jacobians
        w = w * weight * e.length
        H += J.T @ (w[:, None] * J)
        g += J.T @ (w * r)
        n += int(np.count_nonzero(w > 0.05))
    return H, g, n


@dataclass(frozen=True)
class _Solution:
    T_cam_mount: F64
    centre_cam: F64
    covariance: F64
    information: F64
    dilation: float
    noise: NoiseModel
    seen: list[Evidence]
    weights: list[F64]


def _generalised_least_squares(
    problem: PoseProblem, T_cam_mount: F64, config: SolveConfig
) -> _Solution:
    T = T_cam_mount
    noise: NoiseModel | None = None
    for _ in range(3):
        centre = problem.centre_cam(T)
        seen = problem.gather(T, 1, smoothing_px=1.2, spacing=1.0)
        scale = consistent_scale(seen)
        weights = [inlier_weights(e.distances, scale) for e in seen]
        points = parallel_map(lambda ew: average_samples(*ew), zip(seen, weights, strict=True))
        if sum(len(p) for p in points) < _MIN_SAMPLES:
            raise CalibrationError(
                "No view shows enough of the arm's outline to fit a pose to. Check that the "
                "first pose, the joints and the masks belong together."
            )
        if noise is None:
            noise = fit_noise(points)
        information, vector = _information(points, noise, problem.weights)
        N = information.sum(axis=0)
        N[6, 6] += 1.0 / config.dilation_prior_px**2
        solution = np.linalg.solve(N, vector)
        T_next = perturb_about(T, centre, solution[:6])
        if _step_px(seen, solution[:6]) < 0.003:
            break
        T = T_next
        # The variances belong to the residuals at the pose that they are used for.
        noise = fit_noise([_shifted(p, solution) for p in points])
    covariance = COVARIANCE_INFLATION * np.linalg.inv(N)[:6, :6]
    return _Solution(T, centre, covariance, information, float(solution[6]), noise, seen, weights)


def _shifted(points: ContourPoints, solution: F64) -> ContourPoints:
    """The points with the residuals that a solved step leaves."""
    left = points.residuals - points.jacobians @ solution[:6] - solution[6]
    return ContourPoints(
        points.points, points.normals, points.jacobians, left, points.weights, points.length_px
    )


def _information(
    points: Sequence[ContourPoints], noise: NoiseModel, view_weights: F64
) -> tuple[F64, F64]:
    """Per view the information ``(V, 7, 7)`` on [delta, dilation], and the total vector ``(7,)``."""

    def one(view: int) -> tuple[F64, F64]:
        p = points[view]
        if len(p) == 0:
            return np.zeros((7, 7)), np.zeros(7)
        A = np.column_stack([p.jacobians, np.ones(len(p))])
        factor = cho_factor(noise.covariance(p, view), lower=True, check_finite=False)
        CA = cho_solve(factor, np.column_stack([A, p.residuals]), check_finite=False)
        return view_weights[view] * (A.T @ CA[:, :7]), view_weights[view] * (A.T @ CA[:, 7])

    parts = parallel_map(one, range(len(points)))
    return np.stack([p[0] for p in parts]), np.sum([p[1] for p in parts], axis=0)


def _estimate(
    problem: PoseProblem, final: _Solution, converged: bool, timings: dict[str, float]
) -> PoseEstimate:
    views, contours = [], []
    for i, (o, e, w) in enumerate(
        zip(problem.observations, final.seen, final.weights, strict=True)
    ):
        total = float(w.sum())
        views.append(
            ViewFit(
                id=o.id or str(i),
                weight=o.weight * (total / len(w) if len(w) else 0.0),
                rms_px=float(np.sqrt((w * e.residuals**2).sum() / total)) if total > 0 else 0.0,
                iou=e.iou,
                contour_px=len(w) * e.length,
                outliers=float(np.mean(w < 0.5)) if len(w) else 0.0,
                outlier_px=float(np.median(np.abs(e.distances))) if len(w) else 0.0,
                noise_px=final.noise.sigma_px * float(final.noise.view_scale[i]),
            )
        )
        contours.append(
            ContourFit(
                points=e.points,
                normals=e.contour.normals,
                residuals=e.residuals,
                distances=e.distances,
                weights=w,
                jacobians=e.jacobians,
                links=e.contour.links,
            )  # fmt: skip
        )
    return PoseEstimate(
        T_mount_cam=inverse(final.T_cam_mount),
        covariance=pose_covariance_from_centred(final.covariance, final.centre_cam),
        views=tuple(views),
        dilation_px=final.dilation,
        status="converged" if converged else "stopped",
        message=(
            "The pose settled on the finest level."
            if converged
            else "The step limit was reached before the pose settled; the best pose is returned."
        ),
        centre_cam=final.centre_cam,
        contours=tuple(contours),
        information=final.information,
        timings_s=timings,
    )
