"""How an arm gives way under its own weight.

Gears and links are springs, and encoders sit before them: a joint hangs lower than it reads, by its
load over its stiffness. Nobody states either. But loads go by the shape of the arm, whatever it is
made of, and larger joints are built stiffer about as they carry more, so one number, for the whole
arm, tells most of it. (Inertial values of a URDF are not used: the recordings' own are a third of
the true mass, and no better guess of the loads than the hulls of the links.)
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from easyhecpp import geometry as se3

if TYPE_CHECKING:
    from easyhecpp.robot.robot import Robot

_STEP = 1e-5
_SAMPLES = 512
_SMALLEST_LEVER = 1e-3


def loads(robot: Robot, q: np.ndarray) -> np.ndarray:
    """Torque that the weight of the links puts on each turning joint.

    Every link weighs as the convex hull of its mesh, filled evenly; the base's z axis points up. Of
    an arm that hangs from a ceiling all signs are the other way round.

    Args:
        robot: The arm.
        q: (..., n) joint values.

    Returns:
        (..., n) in units of density times gravity; 0 for sliding joints, whose give is no angle.
    """
    volumes = np.array([mesh.hull_volume for mesh in robot.meshes])
    middles = np.array([mesh.hull_centroid for mesh in robot.meshes])

    def height(joints: np.ndarray) -> np.ndarray:
        points = se3.transform_points(robot.link_poses(joints), middles[:, None])
        return points[..., 0, 2] @ volumes

    steps = _STEP * np.eye(robot.n_joints)
    q = np.asarray(q, np.float64)[..., None, :]
    turning = np.array([kind != "prismatic" for kind in robot.joint_types], bool)
    return np.where(turning, -(height(q + steps) - height(q - steps)) / (2.0 * _STEP), 0.0)


def largest_load(robot: Robot, lower: np.ndarray, upper: np.ndarray) -> float:
    """Largest of the `loads` of any joint over poses between limits: the arm stretched out.

    At least the weight of all links on a lever of a millimetre, for arms that move in a plane.
    """
    rng = np.random.default_rng(0)
    poses = rng.uniform(lower, upper, size=(_SAMPLES, robot.n_joints))
    least = _SMALLEST_LEVER * sum(mesh.hull_volume for mesh in robot.meshes)
    return float(np.abs(loads(robot, poses)).max(initial=max(least, np.finfo(np.float64).tiny)))
