"""The last stage: generalised least squares with an honest model of the errors.

Masks err along the contour (`correlation`), by one dilation common to all, in the same way wherever
they show the same scene (`repeats`); the arm stands a little off its joints (`joint_noise`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

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
from easyhecpp.solve.joint_noise import JointNoise
from easyhecpp.solve.joint_twists import by_joints, joint_twists
from easyhecpp.solve.problem import PoseProblem
from easyhecpp.solve.repeats import Repeats
from easyhecpp.solve.robust import consistent_scale, inlier_weights

F64 = NDArray[np.float64]

COVARIANCE_INFLATION, _INFLATION_BY_FEW_VIEWS = 1.1, 1.4
"""Factor on the covariance for what the noise model leaves out: its variances are estimates, and
where contours bend or meet, residuals follow the pose by less than the Jacobian says. It grows by
the second number over the number of views: few contours, few independent errors to learn from. Set
on simulated calibrations of 640x360 (seeds 89000, 63000 and 73000 of the families of `bench
trust`), so that these families need fresh scenes to be measured on."""


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
        noise: The fitted noise along the contour.
        joint_noise: That of the recorded joints.
        shared: Share of the errors' variance that views of the same outline have in common.
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
    joint_noise: JointNoise
    shared: float
    seen: list[Evidence]
    weights: list[F64]


def covariance_inflation(n_views: int) -> float:
    """Factor on the covariance of a pose from so many views."""
    return COVARIANCE_INFLATION * (1.0 + _INFLATION_BY_FEW_VIEWS / max(n_views, 1))


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
    joint_noise, shared = JointNoise(), 0.0
    joints = np.stack([o.joints for o in problem.observations])
    for last in (False, False, True):
        centre = problem.centre_cam(T)
        seen = problem.gather(T, 1, smoothing_px=_SMOOTHING_PX, spacing=1.0)
        scale = consistent_scale(seen, problem.weights)
        weights = [inlier_weights(e.distances, scale) for e in seen]
        points = parallel_map(lambda ew: average_samples(*ew), zip(seen, weights, strict=True))
        _require_contour(points, problem.weights)
        fresh = noise is None
        if noise is None:
            noise = fit_noise(points, problem.weights, _SMOOTHING_PX)
        twists = joint_twists(problem.rig, joints, T, centre)
        designs = [
            np.column_stack([noise.design(p), noise.gain * by_joints(p.jacobians, p.links, t)])
            for p, t in zip(points, twists, strict=True)
        ]
        repeats = Repeats.among(points, problem.weights)
        repeat_factors = [1.0 + shared * n for n in repeats.others()]
        whole, sides = _information(points, designs, repeat_factors, noise, problem.weights)
        prior = np.zeros((7, 7))
        prior[6, 6] = 1.0 / dilation_prior_px**2
        count = np.array([len(p) > 0 for p in points]) & (problem.weights > 0.0)
        joint_noise = joint_noise.fitted(whole[count], sides[count], prior)
        information, vectors = whole[:, :7, :7], sides[:, :7]
        N = information.sum(axis=0) + prior
        solution = np.linalg.solve(N, vectors.sum(axis=0))
        settled = not fresh and step_px(seen, solution[:6]) < _SETTLED_PX
        if not settled:
            T = perturb_about(T, centre, solution[:6])
        if settled or last:
            pulls = N + joint_noise.pulls(whole[count])
            spread = between_views(N, pulls, information, vectors, solution)
            covariance = covariance_inflation(int(np.count_nonzero(count))) * spread[:6, :6]
            return Solution(
                T, centre, covariance, information, vectors, float(solution[6]), noise,
                joint_noise, shared, seen, weights,
            )  # fmt: skip
        # The variances belong to the residuals at the pose that they are used for.
        effects, doubt = joint_noise.effects(whole, sides, prior)
        left = [
            replace(p, residuals=p.residuals - A @ u)
            for p, A, u in zip(points, designs, effects, strict=True)
        ]
        taken = [A @ _root(C) for A, C in zip(designs, doubt, strict=True)]
        noise = fit_noise(left, problem.weights, _SMOOTHING_PX, taken)
        shared = repeats.shared([p.residuals for p in left])
    raise AssertionError("the last round returns")


def _root(covariance: F64) -> F64:
    """A matrix whose square is a covariance that may be singular."""
    values, axes = np.linalg.eigh(0.5 * (covariance + covariance.T))
    return (axes * np.sqrt(np.maximum(values, 0.0))).astype(np.float64)


def _require_contour(points: Sequence[ContourPoints], view_weights: F64) -> None:
    left = sum(len(p) for p, w in zip(points, view_weights, strict=True) if w > 0.0)
    if left < MIN_SAMPLES:
        raise CalibrationError(
            "No view shows enough of the arm's outline to fit a pose to. Check that the first "
            "pose, the joints and the masks belong together."
        )


def _information(
    points: Sequence[ContourPoints],
    designs: Sequence[F64],
    repeat_factors: Sequence[F64],
    noise: NoiseModel,
    view_weights: F64,
) -> tuple[F64, F64]:
    """Per view the information ``(V, k, k)`` on the design's unknowns, and the vector ``(V, k)``.

    Args:
        points: Of each view.
        designs: ``(N, k)`` of each view.
        repeat_factors: ``(N,)`` of each view, on the variance of errors that other views repeat.
        noise: Of the residuals.
        view_weights: ``(V,)``.
    """

    def one(view: int) -> tuple[F64, F64]:
        p, A = points[view], designs[view]
        if len(p) == 0:
            return np.zeros((A.shape[1], A.shape[1])), np.zeros(A.shape[1])
        scale = np.sqrt(repeat_factors[view])
        C = noise.covariance(p, view) * (scale[:, None] * scale)
        factor = cho_factor(C, lower=True, check_finite=False)
        CA = cho_solve(factor, A, check_finite=False)
        return view_weights[view] * (A.T @ CA), view_weights[view] * (CA.T @ p.residuals)

    parts = parallel_map(one, range(len(points)))
    return np.stack([p[0] for p in parts]), np.stack([p[1] for p in parts])
