"""Intrinsics, joint zeros and sag refined together with the pose.

Steps on the normal equations of all unknowns (`all_unknowns`), with a prior on each parameter.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from easyhecpp.camera import Camera
from easyhecpp.errors import CalibrationError, InputError
from easyhecpp.geometry import inverse, perturb_about, pose_covariance_from_centred
from easyhecpp.rig import Rig
from easyhecpp.solve.all_unknowns import (
    JOINTS,
    POSE,
    joint_noise_beside,
    names_of,
    normal_equations_by_view,
    summed,
    without_pose,
)
from easyhecpp.solve.correlated import covariance_inflation
from easyhecpp.solve.joint_offsets import SAG, SAG_PRIOR, joints_as_they_stand
from easyhecpp.solve.lens import FOCAL_PRIOR, LENS, LENS_PRIOR, bent
from easyhecpp.solve.problem import PoseProblem
from easyhecpp.solve.strains import Strain
from easyhecpp.solve.types import Observation

F64 = NDArray[np.float64]

_ROUNDS = 4

_LARGEST_SHARE = 1.0 / 3.0
"""The data must know a parameter that much better than its prior. The outline of the base, say,
which stands still, tells a turn of the first joint from one of the base, but barely: a cover that
the meshes lack would outweigh it."""

_PRIORS = {"focal": FOCAL_PRIOR, "principal_point": 15.0, "lens": LENS_PRIOR, SAG: SAG_PRIOR}
_JOINT_PRIOR = 0.01
"""Standard deviations of what is refined without a number: relative, pixels, of ``k1``, radians or
metres."""

_PARTS = {
    "focal": {"focal": 1.0},
    "principal_point": {"cx": 1.0, "cy": 1.0},
    "lens": dict(zip(LENS, (1.0, 2.0), strict=True)),
}
"""The parameters behind a word, and their standard deviations as multiples of the word's."""


@dataclass(frozen=True)
class Refinement:
    """Refined parameters.

    Attributes:
        T_mount_cam: ``(4, 4)`` pose that goes with them.
        camera: Refined intrinsics.
        corrections: Value and standard deviation of every refined parameter.
        pose_covariance: ``(6, 6)`` that the doubt about these parameters adds to the covariance of
            the tangent ``[v, w]`` in ``T_mount_cam @ exp([v, w])``.
    """

    T_mount_cam: F64
    camera: Camera
    corrections: tuple[Strain, ...]
    pose_covariance: F64


def read_priors(words: Sequence[str], joint_names: Sequence[str]) -> dict[str, float]:
    """What to refine, from words such as ``focal``, ``lens``, ``sag`` or ``joint4=0.02``.

    Args:
        words: Names, each with ``=`` and a standard deviation of its own or without: relative for
            the focal length, pixels for the principal point, of ``k1`` for the lens (``k2`` may be
            twice as far off), radians or metres for sag and joints.
        joint_names: Of the arm.

    Returns:
        Standard deviations by ``focal``, ``cx``, ``cy``, ``k1``, ``k2``, ``sag`` and joint name.

    Raises:
        InputError: A name that is neither, or no positive number after the ``=``.
    """
    priors: dict[str, float] = {}
    for word in words:
        name, equals, number = word.partition("=")
        if name not in _PRIORS and name not in joint_names:
            raise InputError(
                f"'{name}' cannot be refined",
                where="refine",
                expected=f"some of {', '.join((*_PRIORS, *joint_names))}",
            )
        default = _PRIORS.get(name, _JOINT_PRIOR)
        sigma = _positive(number, word) if equals else default
        for parameter, times in _PARTS.get(name, {name: 1.0}).items():
            priors[parameter] = times * sigma
    return priors


def _positive(number: str, word: str) -> float:
    try:
        value = float(number)
    except ValueError:
        value = float("nan")
    if not (np.isfinite(value) and value > 0.0):
        raise InputError(
            f"'{word}' does not say how far off the parameter may be",
            where="refine",
            expected="a number above 0 after the '=', for instance focal=0.02",
        )
    return value


def refine_nuisances(
    rig: Rig,
    camera: Camera,
    observations: Sequence[Observation],
    T_mount_cam: F64,
    priors: Mapping[str, float],
) -> Refinement:
    """Refine pose, intrinsics, joint zeros and sag together.

    Args:
        rig: Robot and set-up.
        camera: Intrinsics.
        observations: The views.
        T_mount_cam: ``(4, 4)`` the solution without them.
        priors: What to refine, and the standard deviation that it is expected to be off by, see
            `read_priors`.

    Raises:
        CalibrationError: The data cannot tell a parameter from the pose or from the others.
    """
    names = [name for name in names_of(rig) if name in priors]
    chosen = np.array([names_of(rig).index(name) for name in names], np.int64) + POSE
    prior = np.array([priors[name] for name in names])
    refined, joints = camera, [o.joints for o in observations]
    total = np.zeros(len(chosen))
    T = inverse(np.asarray(T_mount_cam, np.float64))
    inflation = covariance_inflation(sum(o.weight > 0.0 for o in observations))
    covariance, added = np.zeros((len(chosen), len(chosen))), np.zeros((6, 6))
    for step in range(_ROUNDS):
        moved = [replace(o, joints=q) for o, q in zip(observations, joints, strict=True)]
        problem = PoseProblem(rig, refined, moved)
        views, sides, _ = normal_equations_by_view(problem, T)
        N, b = summed(views, sides)
        if step == 0:
            _refuse_unknowable(N / inflation, b, chosen, prior, names)
        free = np.concatenate([np.arange(POSE, dtype=np.int64), chosen])
        H = N[np.ix_(free, free)].copy()
        g = b[free].copy()
        H[POSE:, POSE:] += np.diag(1.0 / prior**2)
        g[POSE:] -= total / prior**2
        solved = np.linalg.solve(H, g)
        gain = np.linalg.inv(H)
        spread = H + _by_joint_errors(views, sides, free, solved)
        covariance = inflation * (gain @ spread @ gain)[POSE:, POSE:]
        by = np.linalg.solve(H[:POSE, :POSE], H[:POSE, POSE:])
        centre = problem.centre_cam(T)
        added = pose_covariance_from_centred((by @ covariance @ by.T)[:6, :6], centre)
        T = perturb_about(T, centre, solved[:6])
        total = total + solved[POSE:]
        by_name = dict(zip(names, total.tolist(), strict=True))
        refined = _corrected(camera, by_name)
        joints = [joints_as_they_stand(rig.robot, o.joints, by_name) for o in observations]
    sigma = np.sqrt(np.diag(covariance))
    corrections = tuple(
        Strain(n, float(v), float(s)) for n, v, s in zip(names, total, sigma, strict=True)
    )
    return Refinement(inverse(T), refined, corrections, added)


def _by_joint_errors(views: F64, sides: F64, free: NDArray[np.int64], solved: F64) -> F64:
    """What errors of the joints, fresh in every view, add to the covariance of the pulls.

    Args:
        views: ``(V, k, k)`` normal equations of each view on all unknowns.
        sides: ``(V, k)``.
        free: The f unknowns that are solved for, the pose's first.
        solved: ``(f,)`` their solution.

    Returns:
        ``(f, f)``.
    """
    noise = joint_noise_beside(views, sides, free[POSE:], solved[POSE:])
    and_joints = np.r_[free, np.arange(views.shape[1])[JOINTS]]
    return replace(noise, shared=len(free)).pulls(views[:, and_joints[:, None], and_joints])


def _refuse_unknowable(
    N: F64, b: F64, chosen: NDArray[np.int64], prior: F64, names: Sequence[str]
) -> None:
    """Raise unless the data, pose free, know every parameter much better than its prior."""
    left, _ = without_pose(N, b, chosen)
    # Other parameters may be as wrong as their priors allow.
    left = left + np.diag(1e-3 / prior**2)
    covariance = np.linalg.inv(left)
    sigma = np.sqrt(np.diag(covariance))
    # The two of the lens all but trade places; what they bend together is what must be known.
    lens = [i for i, name in enumerate(names) if name in LENS]
    if lens:
        relative = covariance[np.ix_(lens, lens)] / np.outer(prior[lens], prior[lens])
        sigma[lens] = np.sqrt(np.linalg.eigvalsh(relative)[0]) * prior[lens]
    unknowable = [n for n, s, p in zip(names, sigma, prior, strict=True) if s > _LARGEST_SHARE * p]
    if unknowable:
        raise CalibrationError(
            f"These views cannot tell {', '.join(unknowable)} from the camera's pose or from the "
            "other parameters: the pictures would look the same. (The zero of the first joint, for "
            "one, looks just like a turn of the base.) Refine fewer parameters, or add views in "
            "which the arm looks very different."
        )


def _corrected(camera: Camera, by_name: Mapping[str, float]) -> Camera:
    """The stated intrinsics with the corrections."""
    factor = 1.0 + by_name.get("focal", 0.0)
    camera = replace(
        camera,
        fx=camera.fx * factor,
        fy=camera.fy * factor,
        cx=camera.cx + by_name.get("cx", 0.0),
        cy=camera.cy + by_name.get("cy", 0.0),
    )
    if any(name in by_name for name in LENS):
        camera = bent(camera, np.array([by_name.get(name, 0.0) for name in LENS]))
    return camera
