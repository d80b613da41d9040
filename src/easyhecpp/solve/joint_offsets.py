"""What joints are off by in all views alike, told from the outlines.

Two things are. An arm sags: each joint hangs lower than it reads by its load over its stiffness,
and one number says by how much (`easyhecpp.robot.gravity`). And joints are mastered by eye: their
zeros may be a few tenths of a degree off. Either is freed beside the pose only where the evidence
for it, the pose, the lens and fresh errors of the joints (`JointNoise`) integrated out, is there
(MacKay 1992, "Bayesian interpolation"): where the joints stand as recorded, nothing is.

Zeros that the outlines do not tell stay as they are: that of the first joint mostly turns the whole
arm, as the pose does, and the pose is then that in the base which the recorded joint defines.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from easyhecpp.robot import Robot
from easyhecpp.solve.joint_noise import UNDERSTATED, JointNoise
from easyhecpp.solve.lens import LENS_PRIOR

F64 = NDArray[np.float64]

SAG = "sag"
"""The arm's give, radians at its most loaded joint when stretched out."""

SAG_PRIOR = 8e-3
"""Standard deviation of it: two recorded arms, of 14 and of 26 kg, give way by 7 to 9 mrad."""

AS_RECORDED = 0.8e-3
"""Spread of the joints, rad, that is found of arms that stand as recorded: 0.01 mrad in simulation,
up to 1 mrad in parts of a recording, whose meshes are right to half a millimetre."""

_LARGEST_ZERO = 6e-3
_FEWEST_VIEWS = 4
_TOLD = 0.5
"""Share of the variance expected of an unknown that may be left once the outlines are seen."""

_SAG_ODDS, _ZEROS_ODDS = 2.0, 0.1
"""Odds before any picture. Every arm sags, if maybe by less than matters; joints are mastered once,
with care. The evidence counts against a value near 0 how much smaller it is than was expected, so
exact joints are far from being taken for either."""

_POSE, _FOCAL, _SHARED = 7, 7, 10
_HELD = 1e14


@dataclass(frozen=True)
class JointOffsets:
    """Unknowns that the joints of all views are off by.

    Attributes:
        names: `SAG`, or the joint whose zero it is; m of them.
        shapes: ``(V, n, m)`` what one unit of each adds to the joints of each view.
        spread: ``(m,)`` standard deviation that each is expected to have.
    """

    names: tuple[str, ...]
    shapes: F64
    spread: F64

    def of(self, values: F64) -> F64:
        """What is added to the recorded joints, ``(V, n)``, when the unknowns are ``(m,)``."""
        return self.shapes @ values

    def beside(self, other: JointOffsets) -> JointOffsets:
        """These unknowns, then those of the other."""
        return JointOffsets(
            (*self.names, *other.names),
            np.concatenate([self.shapes, other.shapes], axis=2),
            np.r_[self.spread, other.spread],
        )

    def where(self, kept: NDArray[np.bool_]) -> JointOffsets:
        """Those of the unknowns that ``(m,)`` marks."""
        names = tuple(name for name, keep in zip(self.names, kept, strict=True) if keep)
        return JointOffsets(names, self.shapes[:, :, kept], self.spread[kept])

    def equations(self, information: F64, vectors: F64) -> tuple[F64, F64]:
        """Normal equations of each view on ``[delta, dilation, focal, k1, k2, these, joints]``.

        Args:
            information: ``(V, 10 + n, 10 + n)`` on ``[delta, dilation, focal, k1, k2, joints]``.
            vectors: ``(V, 10 + n)``.
        """
        n_views, n, m = self.shapes.shape
        A = np.zeros((n_views, _SHARED + n, _SHARED + m + n))
        A[:, :_SHARED, :_SHARED] = np.eye(_SHARED)
        A[:, _SHARED:, _SHARED : _SHARED + m] = self.shapes
        A[:, _SHARED:, _SHARED + m :] = np.eye(n)
        At = A.transpose(0, 2, 1)
        return At @ information @ A, np.einsum("vij,vj->vi", At, vectors)

    def prior(self, of_pose: F64, *, lens: bool) -> F64:
        """``(10 + m, 10 + m)`` information on all but the joints before any view.

        Args:
            of_pose: ``(7, 7)`` on ``[delta, dilation]``.
            lens: Whether ``k1`` and ``k2`` are free; the focal length is held.
        """
        of_lens = (LENS_PRIOR**-2, (2.0 * LENS_PRIOR) ** -2) if lens else (_HELD, _HELD)
        whole = np.diag([*np.zeros(_POSE), _HELD, *of_lens, *self.spread**-2])
        whole[:_POSE, :_POSE] = of_pose
        return whole


def joints_as_they_stand(robot: Robot, recorded: F64, corrections: Mapping[str, float]) -> F64:
    """Recorded joints, ``(..., n)``, with their sag and their zeros corrected.

    Args:
        robot: The arm.
        recorded: ``(..., n)``.
        corrections: Values by `SAG` or a joint's name; others are of no concern here.
    """
    zeros = np.array([corrections.get(name, 0.0) for name in robot.joint_names])
    sag = corrections.get(SAG, 0.0)
    return recorded + zeros + (sag * robot.sag(recorded) if sag else 0.0)


def offsets_asked(
    information: F64,
    vectors: F64,
    prior: F64,
    *,
    sag: F64,
    joint_names: Sequence[str] = (),
) -> JointOffsets:
    """The unknowns that the outlines ask for: the arm's sag, zeros of joints, both or neither.

    Args:
        information: ``(V, 10 + n, 10 + n)`` on ``[delta, dilation, focal, k1, k2, joints]``; all 0
            for a view that does not count.
        vectors: ``(V, 10 + n)``.
        prior: ``(7, 7)`` information on ``[delta, dilation]``.
        sag: ``(V, n)`` joints by one unit of sag.
        joint_names: Of the n joints; of none where their zeros are not to be asked for.
    """
    asked = JointOffsets((), np.zeros((*sag.shape, 0)), np.zeros(0))
    if np.count_nonzero(information.any(axis=(1, 2))) < _FEWEST_VIEWS:
        return asked
    noise, evidence = _evidence(asked, information, vectors, prior)
    kinds = [(_sag, np.log(_SAG_ODDS))]
    if joint_names:
        kinds.append((_zeros, np.log(_ZEROS_ODDS)))
    while kinds:
        trials, log_odds = [], []
        for kind, log_odds_before in kinds:
            trial = asked.beside(kind(sag, tuple(joint_names), noise))
            told = np.diag(np.linalg.inv(_summed(trial, information, prior)))[_SHARED:]
            trial = trial.where(told < _TOLD * np.square(trial.spread))
            trials.append((trial, *_evidence(trial, information, vectors, prior)))
            more = len(trial.names) > len(asked.names)
            log_odds.append(trials[-1][-1] - evidence + log_odds_before if more else -np.inf)
        best = int(np.argmax(log_odds))
        if log_odds[best] <= 0.0:
            break
        asked, noise, evidence = trials[best]
        del kinds[best]
    return asked


def _sag(sag: F64, joint_names: tuple[str, ...], noise: JointNoise) -> JointOffsets:
    return JointOffsets((SAG,), sag[:, :, None], np.array([SAG_PRIOR]))


def _zeros(sag: F64, joint_names: tuple[str, ...], noise: JointNoise) -> JointOffsets:
    """Zeros about as large as the errors that are fresh in every view; none where there are none.

    An arm whose joints err from view to view hardly has perfect zeros.
    """
    n_views, n = sag.shape
    beyond = max(noise.variance - AS_RECORDED**2, 0.0)
    if beyond == 0.0:
        return JointOffsets((), np.zeros((n_views, n, 0)), np.zeros(0))
    spread = min(np.sqrt(UNDERSTATED * beyond), _LARGEST_ZERO)
    shapes = np.broadcast_to(np.eye(n), (n_views, n, n))
    return JointOffsets(joint_names, shapes, np.full(n, spread))


def _summed(offsets: JointOffsets, information: F64, prior: F64) -> F64:
    """Information of all views on all but their fresh errors, with what was known before."""
    size = _SHARED + len(offsets.names)
    views, _ = offsets.equations(information, np.zeros(information.shape[:2]))
    return views[:, :size, :size].sum(axis=0) + offsets.prior(prior, lens=True)


def _evidence(
    offsets: JointOffsets, information: F64, vectors: F64, prior: F64
) -> tuple[JointNoise, float]:
    """Fresh errors that go with the unknowns, and the log evidence up to a constant."""
    views, sides = offsets.equations(information, vectors)
    known = offsets.prior(prior, lens=True)
    noise = JointNoise(shared=len(known)).fitted(views, sides, known)
    evidence = noise.log_evidence(views, sides, known) - float(np.log(offsets.spread).sum())
    return noise, evidence


@dataclass(frozen=True)
class FreedStep:
    """A step of the pose with the lens or the joints' offsets free.

    Attributes:
        delta: ``(6,)``.
        k: ``(2,)`` to be added to ``k1`` and ``k2``.
        offsets: ``(m,)`` to be added to the offsets.
        pose_covariance: ``(6, 6)`` that not knowing the lens and the offsets adds to that of
            ``delta``.
        sigma_k, sigma_offsets: Standard deviations.
    """

    delta: F64
    k: F64
    offsets: F64
    pose_covariance: F64
    sigma_k: F64
    sigma_offsets: F64


def freed_step(
    information: F64,
    vectors: F64,
    prior: F64,
    *,
    lens: bool,
    offsets: JointOffsets,
    values: F64,
    inflation: float,
) -> FreedStep:
    """Solve for the pose and all that is free beside it.

    Lens and offsets are the likeliest with fresh errors of the joints integrated out, or the
    chance of a few views would pass for them; the pose then goes with the joints as they are.

    Args:
        information: ``(V, 10 + n, 10 + n)`` on ``[delta, dilation, focal, k1, k2, joints]``.
        vectors: ``(V, 10 + n)``.
        prior: ``(7, 7)`` information on ``[delta, dilation]``.
        lens: Whether ``k1`` and ``k2`` are free.
        offsets: What the joints may be off by.
        values: ``(m,)`` what the offsets are taken to be so far.
        inflation: Factor on covariances for what the noise model leaves out.
    """
    size = _SHARED + len(offsets.names)
    views, sides = offsets.equations(information, vectors)
    known = offsets.prior(prior, lens=lens)
    noise = JointNoise(shared=size).fitted(views, sides, known)
    noise = replace(noise, variance=UNDERSTATED * noise.variance)
    marginal, marginal_sides = noise.marginal(views, sides)
    # The step is from the offsets so far; what is expected of them is expected of the whole.
    pull = np.r_[np.zeros(_SHARED), -values / np.square(offsets.spread)]
    covariance = np.linalg.inv(marginal.sum(axis=0) + known)
    step = covariance @ (marginal_sides.sum(axis=0) + pull)
    pose, beside = slice(0, _POSE), slice(_POSE, size)
    N = views[:, :size, :size].sum(axis=0) + known
    of_beside = inflation * covariance[beside, beside]
    by = -np.linalg.solve(N[pose, pose], N[pose, beside])
    alone = np.linalg.solve(N[pose, pose], sides[:, pose].sum(axis=0))
    sigma = np.sqrt(np.diag(of_beside))
    return FreedStep(
        delta=(alone + by @ step[beside])[:6],
        k=step[_FOCAL + 1 : _SHARED] if lens else np.zeros(2),
        offsets=step[_SHARED:],
        pose_covariance=(by @ of_beside @ by.T)[:6, :6],
        sigma_k=sigma[1:3],
        sigma_offsets=sigma[3:],
    )
