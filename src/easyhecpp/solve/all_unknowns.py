"""The normal equations of everything that may be stated wrongly, beside the pose.

The unknowns are ``[delta (6), dilation, focal, cx, cy, k1, k2, joint zeros (n), sag]``, with the
noise model of the last stage and the mask errors that views repeat.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from easyhecpp._parallel import parallel_map
from easyhecpp.camera import Camera
from easyhecpp.rig import Rig
from easyhecpp.solve.correlation import average_samples, fit_noise
from easyhecpp.solve.joint_noise import JointNoise
from easyhecpp.solve.joint_offsets import SAG
from easyhecpp.solve.joint_twists import by_joints, joint_twists
from easyhecpp.solve.lens import LENS, lens_columns
from easyhecpp.solve.problem import PoseProblem
from easyhecpp.solve.repeats import Repeats
from easyhecpp.solve.robust import consistent_scale, inlier_weights

F64 = NDArray[np.float64]

POSE = 7
"""``delta`` and the dilation."""

INTRINSICS = ("focal", "cx", "cy", *LENS)

JOINTS = slice(POSE + len(INTRINSICS), -1)
"""Their zeros among the unknowns."""

_DILATION_INFORMATION = 4.0

_SMOOTHING_PX = 1.2


def names_of(rig: Rig) -> tuple[str, ...]:
    """The unknowns after the pose and the dilation, in their order."""
    return (*INTRINSICS, *rig.robot.joint_names, SAG)


def intrinsic_columns(camera: Camera, points: F64, normals: F64) -> F64:
    """Outward displacement of contour points by the intrinsics, ``(N, 5)``.

    Args:
        camera: Intrinsics.
        points: ``(N, 2)`` pixels.
        normals: ``(N, 2)`` outward.

    Returns:
        Pixels per unit of the relative focal length, per pixel of the principal point, and per unit
        of ``k1`` and ``k2``.
    """
    from_centre = points - np.array([camera.cx, camera.cy])
    return np.column_stack(
        [
            np.einsum("ni,ni->n", normals, from_centre),
            normals,
            lens_columns(camera, points, normals),
        ]
    )


def normal_equations_by_view(
    problem: PoseProblem, T_cam_mount: F64
) -> tuple[F64, F64, NDArray[np.int64]]:
    """Of the views that show something and have a say.

    Args:
        problem: The views.
        T_cam_mount: ``(4, 4)`` solution.

    Returns:
        ``(V, k, k)`` and ``(V, k)``, and which of the problem's views these are, ``(V,)``.
    """
    seen = problem.gather(T_cam_mount, 1, smoothing_px=_SMOOTHING_PX, spacing=1.0)
    scale = consistent_scale(seen, problem.weights)
    points = [average_samples(e, inlier_weights(e.distances, scale)) for e in seen]
    noise = fit_noise(points, problem.weights, _SMOOTHING_PX)
    joints = np.stack([o.joints for o in problem.observations])
    twists = joint_twists(problem.rig, joints, T_cam_mount, problem.centre_cam(T_cam_mount))
    sag = problem.rig.robot.sag(joints)
    size = POSE + len(names_of(problem.rig))
    repeats = Repeats.among(points, problem.weights)
    shared = repeats.shared([p.residuals for p in points])
    others = repeats.others()

    def one(view: int) -> tuple[F64, F64]:
        p = points[view]
        by_joint = by_joints(p.jacobians, p.links, twists[view])
        own = np.column_stack(
            [
                intrinsic_columns(problem.camera, p.points, p.normals),
                by_joint,
                by_joint @ sag[view],
            ]
        )
        A = np.column_stack([noise.design(p), noise.gain * own])
        scale = np.sqrt(1.0 + shared * others[view])
        C = noise.covariance(p, view) * (scale[:, None] * scale)
        factor = cho_factor(C, lower=True, check_finite=False)
        CA = cho_solve(factor, A, check_finite=False)
        return A.T @ CA, CA.T @ p.residuals

    which = [v for v, p in enumerate(points) if problem.weights[v] > 0.0 and len(p)]
    N, b = np.zeros((len(which), size, size)), np.zeros((len(which), size))
    for i, part in enumerate(parallel_map(one, which)):
        N[i], b[i] = part
    return N, b, np.array(which, np.int64)


def summed(views: F64, sides: F64) -> tuple[F64, F64]:
    """The normal equations of all views, with the prior of the dilation."""
    N = views.sum(axis=0)
    N[:POSE, :POSE] += dilation_prior()
    return N, sides.sum(axis=0)


def without_pose(N: F64, b: F64, chosen: NDArray[np.int64]) -> tuple[F64, F64]:
    """Information and vector of the chosen unknowns once pose and dilation are eliminated.

    Args:
        N: ``(k, k)`` of all unknowns.
        b: ``(k,)``.
        chosen: Their indices.
    """
    pose = np.arange(POSE)
    gain = np.linalg.solve(N[np.ix_(pose, pose)], N[np.ix_(pose, chosen)]).T
    return (
        N[np.ix_(chosen, chosen)] - gain @ N[np.ix_(pose, chosen)],
        b[chosen] - gain @ b[pose],
    )


def dilation_prior() -> F64:
    """``(7, 7)`` information on ``[delta, dilation]`` before any view."""
    prior = np.zeros((POSE, POSE))
    prior[6, 6] = _DILATION_INFORMATION
    return prior


def joint_noise_beside(
    views: F64, sides: F64, others: NDArray[np.int64], values: F64
) -> JointNoise:
    """Errors of the joints, fresh in every view, once other unknowns have their values.

    What these explain is not put down to the joints.

    Args:
        views: ``(V, k, k)`` normal equations of each view.
        sides: ``(V, k)`` their right-hand sides.
        others: ``(m,)`` indices among the unknowns.
        values: ``(m,)``.
    """
    # The zero of a joint moves the outline as its error in one view does.
    chosen = np.r_[:POSE, np.arange(views.shape[1])[JOINTS]].astype(np.int64)
    left = sides - views[:, :, others] @ values
    return JointNoise().fitted(views[:, chosen[:, None], chosen], left[:, chosen], dilation_prior())
