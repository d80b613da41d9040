"""Intrinsics and joint zeros that do not fit: a test that costs little, and a refinement.

Both rest on the joint normal equations of ``[delta (6), dilation, focal, cx, cy, joint zeros (n)]``
with the noise model of the last stage and the mask errors that views repeat. What the pose can
imitate is taken out first (Schur complement): what is left is what the data say about a parameter
when the pose is free. The zero of the first joint and the base's yaw, for instance, leave nothing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from easyhecpp.camera import Camera
from easyhecpp.errors import CalibrationError, InputError
from easyhecpp.geometry import inverse, perturb_about, pose_covariance_from_centred
from easyhecpp.rig import Rig
from easyhecpp.solve.correlated import covariance_inflation
from easyhecpp.solve.correlation import ContourPoints, average_samples, fit_noise
from easyhecpp.solve.joint_noise import JointNoise
from easyhecpp.solve.joint_twists import by_joints, joint_twists
from easyhecpp.solve.problem import PoseProblem
from easyhecpp.solve.repeats import Repeats
from easyhecpp.solve.robust import consistent_scale, inlier_weights
from easyhecpp.solve.types import Observation

F64 = NDArray[np.float64]

_SMOOTHING_PX = 1.2
_POSE = 7
_DILATION_INFORMATION = 4.0
_ROUNDS = 4

_LARGEST_SHARE = 1.0 / 3.0
"""The data must know a parameter that much better than its prior. The outline of the base, say,
which stands still, tells a turn of the first joint from one of the base, but barely: a cover that
the meshes lack would outweigh it."""

_PRIORS = {"focal": 0.03, "principal_point": 15.0}
_JOINT_PRIOR = 0.01
"""Standard deviations of what is refined without a number: relative, pixels, radians or metres."""


@dataclass(frozen=True)
class Strain:
    """What the residuals say about a parameter that was taken as known.

    Attributes:
        name: ``focal`` (relative), ``cx``, ``cy`` (pixels) or a joint's name (radians or metres).
        value: Correction that the residuals ask for, pose free.
        sigma: Its standard deviation; infinite where the pose can imitate it.
    """

    name: str
    value: float
    sigma: float

    @property
    def z(self) -> float:
        """Correction in standard deviations."""
        return self.value / self.sigma if np.isfinite(self.sigma) else 0.0


@dataclass(frozen=True)
class Refinement:
    """Refined parameters.

    Attributes:
        T_mount_cam: ``(4, 4)`` pose that goes with them.
        camera: Refined intrinsics.
        joint_zeros: ``(n,)`` to be added to recorded joint values.
        corrections: Value and standard deviation of every refined parameter.
        pose_covariance: ``(6, 6)`` that the doubt about these parameters adds to the covariance of
            the tangent ``[v, w]`` in ``T_mount_cam @ exp([v, w])``.
    """

    T_mount_cam: F64
    camera: Camera
    joint_zeros: F64
    corrections: tuple[Strain, ...]
    pose_covariance: F64


def read_priors(words: Sequence[str], joint_names: Sequence[str]) -> dict[str, float]:
    """What to refine, from words such as ``focal``, ``principal_point`` or ``joint4=0.02``.

    Args:
        words: Names, each with ``=`` and a standard deviation of its own or without: relative for
            the focal length, pixels for the principal point, radians or metres for joints.
        joint_names: Of the arm.

    Returns:
        Standard deviations by ``focal``, ``cx``, ``cy`` and joint name.

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
        for parameter in ("cx", "cy") if name == "principal_point" else (name,):
            priors[parameter] = sigma
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


def strains(problem: PoseProblem, T_cam_mount: F64) -> tuple[Strain, ...]:
    """Test every parameter that was taken as known, one at a time.

    Args:
        problem: The views; those of weight 0 have no say.
        T_cam_mount: ``(4, 4)`` solution.
    """
    names = _names(problem.rig)
    views, sides = _normal_equations_by_view(problem, T_cam_mount)
    N, b = _summed(views, sides)
    inflation = covariance_inflation(len(views))
    found = []
    for k, name in enumerate(names, start=_POSE):
        left, vector = _without_pose(N, b, np.array([k]))
        information = float(left[0, 0])
        # Nothing but rounding is left of what the pose imitates exactly.
        if information <= 1e-6 * float(N[k, k]):
            found.append(Strain(name, 0.0, np.inf))
            continue
        value = float(vector[0]) / information
        spread = _by_joint_errors(views, sides, N, k, value)
        sigma = float(np.sqrt(inflation * (1.0 + spread / information) / information))
        found.append(Strain(name, value, sigma))
    return tuple(found)


def _by_joint_errors(views: F64, sides: F64, N: F64, k: int, value: float) -> float:
    """Variance that errors of the joints, fresh in every view, give the vector of a parameter.

    Their size is that of the residuals once the parameter has its value: what it explains is not
    put down to the joints.

    Args:
        views: ``(V, n, n)`` normal equations of each view.
        sides: ``(V, n)`` their right-hand sides.
        N: ``(n, n)`` their sum, with the prior of the dilation.
        k: Index of the parameter.
        value: What the data say of it.
    """
    # The zero of a joint moves the outline as its error in one view does.
    unknowns = np.concatenate([np.arange(_POSE), np.arange(_POSE + 3, len(N))])
    prior = np.zeros((_POSE, _POSE))
    prior[6, 6] = _DILATION_INFORMATION
    left = sides - views[:, :, k] * value
    noise = JointNoise().fitted(
        views[np.ix_(np.arange(len(views)), unknowns, unknowns)], left[:, unknowns], prior
    )
    gain = np.linalg.solve(N[:_POSE, :_POSE], N[:_POSE, k])
    pull = views[:, k, _POSE + 3 :] - np.einsum("p,vpj->vj", gain, views[:, :_POSE, _POSE + 3 :])
    return noise.variance * float(np.square(pull).sum())


def refine_nuisances(
    rig: Rig,
    camera: Camera,
    observations: Sequence[Observation],
    T_mount_cam: F64,
    priors: Mapping[str, float],
) -> Refinement:
    """Refine pose, intrinsics and joint zeros together.

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
    names = [name for name in _names(rig) if name in priors]
    chosen = np.array([_names(rig).index(name) for name in names], np.int64) + _POSE
    prior = np.array([priors[name] for name in names])
    refined, zeros = camera, np.zeros(rig.robot.n_joints)
    total = np.zeros(len(chosen))
    T = inverse(np.asarray(T_mount_cam, np.float64))
    inflation = covariance_inflation(sum(o.weight > 0.0 for o in observations))
    covariance, added = np.zeros((len(chosen), len(chosen))), np.zeros((6, 6))
    for step in range(_ROUNDS):
        moved = [replace(o, joints=o.joints + zeros) for o in observations]
        problem = PoseProblem(rig, refined, moved)
        N, b = _joint_normal_equations(problem, T)
        if step == 0:
            _refuse_unknowable(N / inflation, b, chosen, prior, names)
        free = np.concatenate([np.arange(_POSE, dtype=np.int64), chosen])
        H = N[np.ix_(free, free)].copy()
        g = b[free].copy()
        H[_POSE:, _POSE:] += np.diag(1.0 / prior**2)
        g[_POSE:] -= total / prior**2
        solved = np.linalg.solve(H, g)
        whole = inflation * np.linalg.inv(H)
        covariance = whole[_POSE:, _POSE:]
        known = inflation * np.linalg.inv(H[:_POSE, :_POSE])
        centre = problem.centre_cam(T)
        added = pose_covariance_from_centred(whole[:6, :6] - known[:6, :6], centre)
        T = perturb_about(T, centre, solved[:6])
        total = total + solved[_POSE:]
        refined, zeros = _corrected(rig, camera, names, total)
    sigma = np.sqrt(np.diag(covariance))
    corrections = tuple(
        Strain(n, float(v), float(s)) for n, v, s in zip(names, total, sigma, strict=True)
    )
    return Refinement(inverse(T), refined, zeros, corrections, added)


def _names(rig: Rig) -> tuple[str, ...]:
    return ("focal", "cx", "cy", *rig.robot.joint_names)


def _refuse_unknowable(
    N: F64, b: F64, chosen: NDArray[np.int64], prior: F64, names: Sequence[str]
) -> None:
    """Raise unless the data, pose free, know every parameter much better than its prior."""
    left, _ = _without_pose(N, b, chosen)
    # Other parameters may be as wrong as their priors allow.
    left = left + np.diag(1e-3 / prior**2)
    sigma = np.sqrt(np.diag(np.linalg.inv(left)))
    unknowable = [n for n, s, p in zip(names, sigma, prior, strict=True) if s > _LARGEST_SHARE * p]
    if unknowable:
        raise CalibrationError(
            f"These views cannot tell {', '.join(unknowable)} from the camera's pose or from the "
            "other parameters: the pictures would look the same. (The zero of the first joint, for "
            "one, looks just like a turn of the base.) Refine fewer parameters, or add views in "
            "which the arm looks very different."
        )


def _corrected(rig: Rig, camera: Camera, names: Sequence[str], total: F64) -> tuple[Camera, F64]:
    """The stated intrinsics with the corrections, and the joint zeros ``(n,)``."""
    by_name = dict(zip(names, total, strict=True))
    factor = 1.0 + by_name.get("focal", 0.0)
    camera = replace(
        camera,
        fx=camera.fx * factor,
        fy=camera.fy * factor,
        cx=camera.cx + by_name.get("cx", 0.0),
        cy=camera.cy + by_name.get("cy", 0.0),
    )
    return camera, np.array([by_name.get(n, 0.0) for n in rig.robot.joint_names])


def _without_pose(N: F64, b: F64, chosen: NDArray[np.int64]) -> tuple[F64, F64]:
    """Information and vector of the chosen parameters once pose and dilation are eliminated."""
    pose = np.arange(_POSE)
    gain = np.linalg.solve(N[np.ix_(pose, pose)], N[np.ix_(pose, chosen)]).T
    return (
        N[np.ix_(chosen, chosen)] - gain @ N[np.ix_(pose, chosen)],
        b[chosen] - gain @ b[pose],
    )


def _joint_normal_equations(problem: PoseProblem, T_cam_mount: F64) -> tuple[F64, F64]:
    """Of all views, with the prior of the dilation."""
    return _summed(*_normal_equations_by_view(problem, T_cam_mount))


def _summed(views: F64, sides: F64) -> tuple[F64, F64]:
    N = views.sum(axis=0)
    N[6, 6] += _DILATION_INFORMATION
    return N, sides.sum(axis=0)


def _normal_equations_by_view(problem: PoseProblem, T_cam_mount: F64) -> tuple[F64, F64]:
    """``(V, n, n)`` and ``(V, n)`` of the views that show something and have a say."""
    seen = problem.gather(T_cam_mount, 1, smoothing_px=_SMOOTHING_PX, spacing=1.0)
    scale = consistent_scale(seen, problem.weights)
    points = [average_samples(e, inlier_weights(e.distances, scale)) for e in seen]
    noise = fit_noise(points, problem.weights, _SMOOTHING_PX)
    joints = np.stack([o.joints for o in problem.observations])
    twists = joint_twists(problem.rig, joints, T_cam_mount, problem.centre_cam(T_cam_mount))
    size = _POSE + 3 + problem.rig.robot.n_joints
    N, b = [np.zeros((0, size, size))], [np.zeros((0, size))]
    repeats = Repeats.among(points, problem.weights)
    shared = repeats.shared([p.residuals for p in points])
    for view, (p, others) in enumerate(zip(points, repeats.others(), strict=True)):
        if problem.weights[view] <= 0.0 or not len(p):
            continue
        A = np.column_stack([noise.design(p), noise.gain * _columns(problem, p, twists[view])])
        scale = np.sqrt(1.0 + shared * others)
        C = noise.covariance(p, view) * (scale[:, None] * scale)
        factor = cho_factor(C, lower=True, check_finite=False)
        CA = cho_solve(factor, A, check_finite=False)
        N.append((A.T @ CA)[None])
        b.append((CA.T @ p.residuals)[None])
    return np.concatenate(N), np.concatenate(b)


def _columns(problem: PoseProblem, points: ContourPoints, twists: F64) -> F64:
    """Outward displacement by focal length, principal point and joint zeros: ``(N, 3 + n)``."""
    from_centre = points.points - np.array([problem.camera.cx, problem.camera.cy])
    return np.column_stack(
        [
            np.einsum("ni,ni->n", points.normals, from_centre),
            points.normals,
            by_joints(points.jacobians, points.links, twists),
        ]
    )
