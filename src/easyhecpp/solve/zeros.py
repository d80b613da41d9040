"""Zeros of joints that are not as recorded, told from the outlines.

Gears are mounted a tooth off, encoders are referenced by eye, arms sag: a joint may read a few
tenths of a degree wrong, in every view the same way. Errors that are fresh in every view are told
from the pose by their spread (`JointNoise`), and an arm whose joints err like that hardly has
perfect zeros: the zeros are refined with the pose, as unknowns that are expected to be about as
large as that spread. Where the joints stand as recorded, nothing is expected, and nothing refined.
Nor are zeros that the outlines do not tell: that of the first joint mostly turns the whole arm, as
the pose does, and the pose is then that in the base which the recorded joint defines.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from easyhecpp.solve.joint_noise import UNDERSTATED, JointNoise
from easyhecpp.solve.lens import LENS_PRIOR

F64 = NDArray[np.float64]

AS_RECORDED = 0.8e-3
"""Spread of the joints, rad, that is found of arms that stand as recorded: 0.01 mrad in simulation,
up to 1 mrad in parts of a recording, whose meshes are right to half a millimetre."""

_LARGEST = 6e-3
_FEWEST_VIEWS = 4
_TOLD = 0.5
"""Share of the variance expected of a zero that may be left once the outlines are seen."""

_POSE, _FOCAL, _SHARED = 7, 7, 10
_HELD = 1e14


def zeros_spread(information: F64, vectors: F64, prior: F64) -> F64:
    """Standard deviation ``(n,)`` that each joint's zero is expected to have, rad (m).

    It is 0 for a zero that is to be left alone: all of them where the joints stand as recorded, and
    those that the outlines tell next to nothing of.

    Args:
        information: ``(V, 10 + n, 10 + n)`` on ``[delta, dilation, focal, k1, k2, joints]``, of the
            views that count.
        vectors: ``(V, 10 + n)``.
        prior: ``(7, 7)`` information on ``[delta, dilation]``.
    """
    n_joints = information.shape[-1] - _SHARED
    if len(information) < _FEWEST_VIEWS or n_joints == 0:
        return np.zeros(n_joints)
    known = np.diag(_intrinsics_prior(lens=True))
    known[:_POSE, :_POSE] = prior
    apparent = JointNoise(shared=_SHARED).fitted(information, vectors, known).variance
    beyond = max(apparent - AS_RECORDED**2, 0.0)
    if beyond == 0.0:
        return np.zeros(n_joints)
    spread = min(np.sqrt(UNDERSTATED * beyond), _LARGEST)
    N = information.sum(axis=0) + np.diag(np.r_[np.zeros(_SHARED), np.full(n_joints, spread**-2)])
    N[:_SHARED, :_SHARED] += known
    told = np.diag(np.linalg.inv(N))[_SHARED:] < _TOLD * spread**2
    return np.where(told, spread, 0.0)


@dataclass(frozen=True)
class FreedStep:
    """A step of the pose with the lens or the joints' zeros free.

    Attributes:
        delta: ``(6,)``.
        k: ``(2,)`` to be added to ``k1`` and ``k2``.
        zeros: ``(n,)`` to be added to the joints' zeros.
        pose_covariance: ``(6, 6)`` that not knowing the lens and the zeros adds to that of
            ``delta``.
        sigma_k, sigma_zeros: Standard deviations.
    """

    delta: F64
    k: F64
    zeros: F64
    pose_covariance: F64
    sigma_k: F64
    sigma_zeros: F64


def freed_step(
    information: F64,
    vector: F64,
    prior: F64,
    *,
    lens: bool,
    spread: F64,
    zeros: F64,
    inflation: float,
) -> FreedStep:
    """Solve for the pose and all that is free beside it.

    Args:
        information: ``(10 + n, 10 + n)`` on ``[delta, dilation, focal, k1, k2, joints]``, of all
            views.
        vector: ``(10 + n,)``.
        prior: ``(7, 7)`` information on ``[delta, dilation]``.
        lens: Whether ``k1`` and ``k2`` are free.
        spread: ``(n,)`` standard deviations expected of the zeros, 0 for those that are held.
        zeros: ``(n,)`` what they are taken to be so far.
        inflation: Factor on covariances for what the noise model leaves out.
    """
    expected = np.where(spread > 0.0, spread, _HELD**-0.5) ** -2
    N = information + np.diag(np.r_[_intrinsics_prior(lens=lens), expected])
    N[:_POSE, :_POSE] += prior
    b = vector.copy()
    # The step is from the zeros so far; what is expected of them is expected of the whole.
    b[_SHARED:] -= zeros * expected
    pose, beside = slice(0, _POSE), slice(_POSE, len(N))
    by = -np.linalg.solve(N[pose, pose], N[pose, beside])
    covariance = inflation * np.linalg.inv(N[beside, beside] + N[beside, pose] @ by)
    step = np.linalg.solve(N, b)
    sigma = np.sqrt(np.diag(covariance))
    return FreedStep(
        delta=step[:6],
        k=step[_FOCAL + 1 : _SHARED] if lens else np.zeros(2),
        zeros=np.where(spread > 0.0, step[_SHARED:], 0.0),
        pose_covariance=(by @ covariance @ by.T)[:6, :6],
        sigma_k=sigma[1:3],
        sigma_zeros=sigma[3:],
    )


def _intrinsics_prior(*, lens: bool) -> F64:
    """``(10,)`` information on ``[delta, dilation, focal, k1, k2]``; what is held is known."""
    free = (LENS_PRIOR**-2, (2.0 * LENS_PRIOR) ** -2) if lens else (_HELD, _HELD)
    return np.array([0.0] * _POSE + [_HELD, *free])
