"""Intrinsics, joint zeros and sag that do not fit: a test that costs little.

It rests on the normal equations of all unknowns (`all_unknowns`). What the pose can imitate is
taken out first (Schur complement): what is left is what the data say about a parameter when the
pose is free. The zero of the first joint and the base's yaw, for instance, leave nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from easyhecpp.solve.all_unknowns import (
    INTRINSICS,
    JOINTS,
    POSE,
    dilation_prior,
    joint_noise_beside,
    names_of,
    normal_equations_by_view,
    summed,
    without_pose,
)
from easyhecpp.solve.correlated import covariance_inflation
from easyhecpp.solve.joint_offsets import offsets_asked
from easyhecpp.solve.lens import LensStrain, lens_strain
from easyhecpp.solve.problem import PoseProblem

F64 = NDArray[np.float64]


@dataclass(frozen=True)
class Strain:
    """What the residuals say about a parameter that was taken as known.

    Attributes:
        name: ``focal`` (relative), ``cx``, ``cy`` (pixels), ``k1``, ``k2``, a joint's name
            (radians or metres) or ``sag`` (radians).
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
class Strains:
    """What the residuals say about all that was taken as known.

    Attributes:
        parameters: One at a time.
        lens: As a whole.
        sag_asked: Whether the arm is likelier to sag than to stand as recorded.
    """

    parameters: tuple[Strain, ...]
    lens: LensStrain
    sag_asked: bool


def strains(problem: PoseProblem, T_cam_mount: F64) -> Strains:
    """Test every parameter that was taken as known, one at a time, the lens, and the arm's sag.

    Args:
        problem: The views; those of weight 0 have no say.
        T_cam_mount: ``(4, 4)`` solution.
    """
    names = names_of(problem.rig)
    views, sides, which = normal_equations_by_view(problem, T_cam_mount)
    N, b = summed(views, sides)
    inflation = covariance_inflation(len(views))
    found = []
    for k, name in enumerate(names, start=POSE):
        left, vector = without_pose(N, b, np.array([k]))
        information = float(left[0, 0])
        # Nothing but rounding is left of what the pose imitates exactly.
        if information <= 1e-6 * float(N[k, k]):
            found.append(Strain(name, 0.0, np.inf))
            continue
        value = float(vector[0]) / information
        spread = _by_joint_errors(views, sides, N, k, value)
        sigma = float(np.sqrt(inflation * (1.0 + spread / information) / information))
        found.append(Strain(name, value, sigma))
    focal_and_lens = [POSE + INTRINSICS.index(name) for name in ("focal", "k1", "k2")]
    chosen = np.r_[:POSE, focal_and_lens, np.arange(len(N))[JOINTS]].astype(np.int64)
    information, vectors = views[:, chosen[:, None], chosen], sides[:, chosen]
    lens = lens_strain(information, vectors, dilation_prior(), inflation)
    joints = np.array([problem.observations[v].joints for v in which])
    joints = joints.reshape(len(which), problem.rig.robot.n_joints)
    sag = offsets_asked(
        information / inflation,
        vectors / inflation,
        dilation_prior(),
        sag=problem.rig.robot.sag(joints),
    )
    return Strains(tuple(found), lens, bool(sag.names))


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
    noise = joint_noise_beside(views, sides, np.array([k]), np.array([value]))
    gain = np.linalg.solve(N[:POSE, :POSE], N[:POSE, k])
    pull = views[:, k, JOINTS] - np.einsum("p,vpj->vj", gain, views[:, :POSE, JOINTS])
    return noise.variance * float(np.square(pull).sum())
