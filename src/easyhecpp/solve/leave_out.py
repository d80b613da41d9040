"""What the other views predict for each view: leave-one-out, from the stored normal equations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from easyhecpp.solve.types import PoseEstimate

F64 = NDArray[np.float64]

_DILATION_INFORMATION = 4.0
_FAR_ENOUGH_TO_SAY_PX = 30.0


@dataclass(frozen=True)
class Prediction:
    """A view as predicted by the others.

    Attributes:
        rms_px: Root mean square displacement of its outline from the prediction, noise included;
            None where the others cannot predict it.
        moved_px: The part of it that a change of pose would explain.
        surprise: Squared distance between its own pose and the others', in standard deviations;
            six degrees of freedom.
    """

    rms_px: float | None
    moved_px: float
    surprise: float


def leave_one_out(estimate: PoseEstimate) -> list[Prediction]:
    """Predict every view's outline from the pose of the others.

    Linear about the joint solution: exact as long as views agree to a few pixels, and a view that
    took no part is simply compared with the pose.

    Args:
        estimate: The pose with its views' information.
    """
    total = estimate.information.sum(axis=0)
    total[6, 6] += _DILATION_INFORMATION
    vector = estimate.vectors.sum(axis=0)
    found = []
    for view, contour in enumerate(estimate.contours):
        if not len(contour.distances):
            found.append(Prediction(None, 0.0, 0.0))
            continue
        own, own_vector = estimate.information[view], estimate.vectors[view]
        if estimate.views[view].weight <= 0.0 or not own.any():
            rms = 1.4826 * float(np.median(np.abs(contour.distances)))
            found.append(Prediction(rms, 0.0, 0.0))
            continue
        others = total - own
        x, spread = _solved(others, vector - own_vector)
        J = np.column_stack([contour.jacobians, np.ones(len(contour.points))])
        expected = float(np.sqrt(np.mean(np.einsum("nk,kl,nl->n", J, spread, J))))
        if expected > _FAR_ENOUGH_TO_SAY_PX:
            found.append(Prediction(None, 0.0, 0.0))
            continue
        w = contour.weights / max(float(contour.weights.sum()), 1e-9)
        rms = float(np.sqrt(w @ np.square(contour.residuals - J @ x)))
        own_x, _ = _solved(own + 1e-9 * np.diag(np.diag(total)), own_vector)
        moved = float(np.sqrt(w @ np.square(J[:, :6] @ (own_x - x)[:6])))
        gap = own_vector - own @ x
        covariance = own + own @ spread @ own
        surprise = float(gap @ np.linalg.pinv(covariance, rcond=1e-9, hermitian=True) @ gap)
        found.append(Prediction(rms, moved, surprise))
    return found


def _solved(information: F64, vector: F64) -> tuple[F64, F64]:
    """Solution and covariance, with units scaled away before inverting."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(information), 1e-30))
    inverse = np.linalg.pinv(information * np.outer(scale, scale), rcond=1e-10, hermitian=True)
    covariance = inverse * np.outer(scale, scale)
    return covariance @ vector, covariance
