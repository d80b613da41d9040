"""The last stage: generalised least squares with one dilation common to all masks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from easyhecpp._parallel import parallel_map
from easyhecpp.errors import CalibrationError
from easyhecpp.geometry import perturb_about
from easyhecpp.solve.between_views import between_views
from easyhecpp.solve.correlation import ContourPoints, NoiseModel, average_samples, fit_noise
from easyhecpp.solve.descend import MIN_SAMPLES, step_px
from easyhecpp.solve.evidence import Evidence
from easyhecpp.solve.problem import PoseProblem
from easyhecpp.solve.robust import consistent_scale, inlier_weights

F64 = NDArray[np.float64]

COVARIANCE_INFLATION, _INFLATION_BY_FEW_VIEWS = 1.35, 0.2
"""Factor on the covariance for what the noise model leaves out: its variances are estimates, and
where contours bend or meet, residuals follow the pose by less than the Jacobian says. It grows by
the second number over the number of views: few contours, few independent errors to learn from. Set
on 160 simulated calibrations of 640x360 (seed 88000 of the families of `bench trust`), so that
these families need fresh scenes to be measured on."""

_SMOOTHING_PX = 1.2


_SETTLED_PX = 0.003
"""A step that moves the contours by less ends the iteration."""


@dataclass(frozen=True)
class Solution:
    """The last stage's answer.

    Attributes:
        T_cam_mount: ``(4, 4)``.
        centre_cam: ``(3,)`` centre of rotation of ``delta``.
        covariance: ``(6, 6)`` of ``delta``.
        information: ``(V, 7, 7)`` per view on ``[delta, dilation]``.
        vectors: ``(V, 7)`` right-hand sides per view.
        dilation: Pixels.
        noise: The fitted noise.
        seen: Contour samples per view.
        weights: Their robust weights.
    """

    T_cam_mount: F64
    centre_cam: F64
    covariance: F64
    information: F64
    vectors: F64
    dilation: float
    noise: NoiseModel
    seen: list[Evidence]
    weights: list[F64]


def generalised_least_squares(
    problem: PoseProblem, T_cam_mount: F64, dilation_prior_px: float
) -> Solution:
    """Solve for pose and dilation with the correlation of the errors estimated from residuals.

    Args:
        problem: The views.
        T_cam_mount: ``(4, 4)`` start, within a pixel or so.
        dilation_prior_px: Standard deviation of the dilation.

    Raises:
        CalibrationError: Too little contour is left to fit a pose to.
    """
    T = T_cam_mount
    noise: NoiseModel | None = None
    for last in (False, False, True):
        centre = problem.centre_cam(T)
        seen = problem.gather(T, 1, smoothing_px=_SMOOTHING_PX, spacing=1.0)
        scale = consistent_scale(seen, problem.weights)
        weights = [inlier_weights(e.distances, scale) for e in seen]
        points = parallel_map(lambda ew: average_samples(*ew), zip(seen, weights, strict=True))
        _require_contour(points, problem.weights)
        if noise is None:
            noise = fit_noise(points, problem.weights, _SMOOTHING_PX)
        information, vectors = _information(points, noise, problem.weights)
        N = information.sum(axis=0)
        N[6, 6] += 1.0 / dilation_prior_px**2
        solution = np.linalg.solve(N, vectors.sum(axis=0))
        settled = step_px(seen, solution[:6]) < _SETTLED_PX
        if not settled:
            T = perturb_about(T, centre, solution[:6])
        if settled or last:
            n_views = sum(
                len(p) > 0 and w > 0.0 for p, w in zip(points, problem.weights, strict=True)
            )
            inflation = COVARIANCE_INFLATION * (1.0 + _INFLATION_BY_FEW_VIEWS / n_views)
            spread = between_views(N, information, vectors, solution)
            covariance = inflation * spread[:6, :6]
            return Solution(
                T, centre, covariance, information, vectors, float(solution[6]), noise, seen,
                weights,
            )  # fmt: skip
        # The variances belong to the residuals at the pose that they are used for.
        root = np.linalg.cholesky(np.linalg.inv(N))
        noise = fit_noise(
            [_shifted(p, noise, solution) for p in points],
            problem.weights,
            _SMOOTHING_PX,
            [noise.design(p) @ root for p in points],
        )
    raise AssertionError("the last round returns")


def _require_contour(points: Sequence[ContourPoints], view_weights: F64) -> None:
    left = sum(len(p) for p, w in zip(points, view_weights, strict=True) if w > 0.0)
    if left < MIN_SAMPLES:
        raise CalibrationError(
            "No view shows enough of the arm's outline to fit a pose to. Check that the first "
            "pose, the joints and the masks belong together."
        )


def _shifted(points: ContourPoints, noise: NoiseModel, solution: F64) -> ContourPoints:
    """The points with the residuals that a solved step leaves."""
    left = points.residuals - noise.design(points) @ solution
    return ContourPoints(
        points.points, points.normals, points.jacobians, left, points.weights, points.length_px
    )


def _information(
    points: Sequence[ContourPoints], noise: NoiseModel, view_weights: F64
) -> tuple[F64, F64]:
    """Per view the information ``(V, 7, 7)`` on [delta, dilation], and the vector ``(V, 7)``."""

    def one(view: int) -> tuple[F64, F64]:
        p = points[view]
        if len(p) == 0:
            return np.zeros((7, 7)), np.zeros(7)
        A = noise.design(p)
        factor = cho_factor(noise.covariance(p, view), lower=True, check_finite=False)
        CA = cho_solve(factor, np.column_stack([A, p.residuals]), check_finite=False)
        return view_weights[view] * (A.T @ CA[:, :7]), view_weights[view] * (A.T @ CA[:, 7])

    parts = parallel_map(one, range(len(points)))
    return np.stack([p[0] for p in parts]), np.stack([p[1] for p in parts])
