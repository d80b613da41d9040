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
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from easyhecpp.camera import Camera
from easyhecpp.errors import InputError
from easyhecpp.geometry import inverse, pose_covariance_from_centred
from easyhecpp.rig import Rig
from easyhecpp.solve.correlated import Solution, generalised_least_squares
from easyhecpp.solve.descend import Level, descend
from easyhecpp.solve.problem import PoseProblem
from easyhecpp.solve.types import (
    ContourFit,
    Observation,
    PoseEstimate,
    SolveConfig,
    ViewFit,
)

F64 = NDArray[np.float64]


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
        The pose of the last stage, its covariance and how each view agrees with it.

    Raises:
        InputError: No view, sizes that do not fit, or a start that is no transform.
        CalibrationError: The arm is in no view at the start.
    """
    clock = time.perf_counter()
    problem = PoseProblem(rig, camera, observations)
    prepared = {"prepare": time.perf_counter() - clock}
    estimate = solve_prepared(problem, T_mount_cam_init, config or SolveConfig())
    return replace(estimate, timings_s={**prepared, **estimate.timings_s})


def solve_prepared(
    problem: PoseProblem, T_mount_cam_init: F64, config: SolveConfig
) -> PoseEstimate:
    """The same for views whose masks have been prepared; see `solve_pose`."""
    T = inverse(_checked(T_mount_cam_init))
    timings: dict[str, float] = {}
    converged = True
    for level in _levels(config.start_error_px):
        clock = time.perf_counter()
        end = descend(problem, T, level, config.max_iterations)
        T, converged = end.T_cam_mount, end.settled
        timings[level.name] = timings.get(level.name, 0.0) + time.perf_counter() - clock
    clock = time.perf_counter()
    final = generalised_least_squares(problem, T, config.dilation_prior_px)
    timings["correlated"] = time.perf_counter() - clock
    return _estimate(problem, final, converged, timings)


def _checked(T_mount_cam_init: F64) -> F64:
    T = np.asarray(T_mount_cam_init, np.float64)
    if T.shape != (4, 4) or not np.isfinite(T).all():
        raise InputError(
            "The pose to start from is no transform",
            where=f"T_mount_cam_init = {T.tolist()}",
            expected="a (4, 4) matrix of finite numbers",
        )
    return T


def _levels(start_error_px: float) -> list[Level]:
    fine = [Level(4, scale_px=4.0), Level(2), Level(1, smoothing_px=1.2)]
    if start_error_px <= 8.0:
        return fine
    return [Level(4, scale_px=max(6.0, 0.5 * start_error_px)), *fine]


def _estimate(
    problem: PoseProblem, final: Solution, converged: bool, timings: dict[str, float]
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
            )
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
        vectors=final.vectors,
        timings_s=timings,
        joint_noise=float(np.sqrt(final.joint_noise.variance)),
    )
