"""What goes into the pose optimisation and what comes out."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]


@dataclass(frozen=True)
class Observation:
    """One view as the optimiser sees it.

    Attributes:
        joints: ``(n,)`` in the robot's actuated order, radians and metres.
        mask: ``(H, W)`` bool, or float in [0, 1].
        ignore: ``(H, W)`` bool; True where the mask says nothing (a gripper, a logo).
        weight: Trust in this view relative to the others.
        id: Name of the view in results and messages.
    """

    joints: F64
    mask: NDArray[np.bool_] | NDArray[np.float32]
    ignore: NDArray[np.bool_] | None = None
    weight: float = 1.0
    id: str = ""


@dataclass(frozen=True)
class SolveConfig:
    """Settings of the pose optimisation.

    Attributes:
        start_error_px: Contour error that the start may have; opens the capture range.
        dilation_prior_px: Standard deviation of the masks' common dilation or erosion.
        max_iterations: Steps allowed on each level.
    """

    start_error_px: float = 40.0
    dilation_prior_px: float = 0.5
    max_iterations: int = 12


@dataclass(frozen=True)
class ViewFit:
    """How one view agrees with the pose.

    Attributes:
        id: Name of the view.
        weight: Share of the visible contour that took part, times the given weight, in [0, 1]-ish.
        rms_px: Root mean square of the contour's displacement where it took part.
        iou: Intersection over union of the rendered and the observed mask.
        contour_px: Length of the visible contour in the image, pixels.
        outliers: Share of the visible contour that does not agree with the mask.
        outlier_px: Median absolute distance of all the contour to the mask's outline, pixels.
        noise_px: Standard deviation of the contour noise that was estimated for this view.
        prediction_px: Displacement of its contour as predicted by the other views, root mean
            square; None where they cannot predict it.
        flags: Findings, one word each.
    """

    id: str
    weight: float
    rms_px: float
    iou: float
    contour_px: float
    outliers: float
    outlier_px: float
    noise_px: float
    prediction_px: float | None = None
    flags: tuple[str, ...] = ()


@dataclass(frozen=True)
class ContourFit:
    """Residuals of one view at the solution, the ground of all statements about trust.

    Attributes:
        points: ``(N, 2)`` pixels.
        normals: ``(N, 2)`` outward.
        residuals: ``(N,)`` pixels that the observed outline lies outside of the rendered one.
        distances: ``(N,)`` signed distance to the observed outline, pixels, not saturating.
        weights: ``(N,)`` in [0, 1], zero for outliers.
        jacobians: ``(N, 6)`` by ``delta`` about ``centre_cam``.
        links: ``(N,)`` link index.
    """

    points: F64
    normals: F64
    residuals: F64
    distances: F64
    weights: F64
    jacobians: F64
    links: NDArray[np.int32]


@dataclass(frozen=True)
class PoseEstimate:
    """The optimised pose with its uncertainty.

    Attributes:
        T_mount_cam: ``(4, 4)`` pose of the camera in the mount (the base for eye-to-hand).
        covariance: ``(6, 6)`` of the tangent ``[v, w]`` in ``T_mount_cam @ exp([v, w])``.
        views: One entry per observation.
        dilation_px: Common dilation of the masks; positive when they are too large.
        status: ``converged`` or ``stopped`` (at the step limit).
        message: The status in a sentence.
        centre_cam: ``(3,)`` the arm's middle in the camera frame, about which ``delta`` is taken.
        contours: Residuals of each view at the solution.
        information: ``(V, 7, 7)`` per view on ``[delta, dilation]``; zero for a view left out.
        vectors: ``(V, 7)`` per view, of the same normal equations at the solution.
        timings_s: Seconds per stage.
        joint_noise: Standard deviation of the joints' errors, a fresh one in every view, that the
            outlines speak for; rad (m for prismatic joints).
    """

    T_mount_cam: F64
    covariance: F64
    views: tuple[ViewFit, ...]
    dilation_px: float
    status: str
    message: str
    centre_cam: F64
    contours: tuple[ContourFit, ...]
    information: F64
    vectors: F64
    timings_s: dict[str, float] = field(default_factory=dict)
    joint_noise: float = 0.0
