"""How the contour moves when a joint does."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from easyhecpp.geometry import inverse, log_se3, translation_matrix
from easyhecpp.rig import Rig

F64 = NDArray[np.float64]

_STEP = 1e-5


def joint_twists(rig: Rig, joints: F64, T_cam_mount: F64, centre_cam: F64) -> F64:
    """How each joint moves each link in the camera frame.

    Args:
        rig: Robot and set-up.
        joints: ``(..., n)`` joint values.
        T_cam_mount: ``(4, 4)``.
        centre_cam: ``(3,)`` the point that the contour's Jacobians turn about.

    Returns:
        ``(..., n, L, 6)``: ``delta`` per radian (or metre) of the joint, as in `perturb_about`, so
        that a contour's Jacobian by ``delta`` tells how the joint displaces it.
    """
    centre = translation_matrix(centre_cam)
    back = inverse(centre)
    # Central differences: one-sided ones would be off by the curvature of the path.
    steps = _STEP * np.eye(joints.shape[-1])
    ahead = T_cam_mount @ rig.Ts_mount_link(joints[..., None, :] + steps)
    behind = T_cam_mount @ rig.Ts_mount_link(joints[..., None, :] - steps)
    return log_se3(back @ ahead @ inverse(behind) @ centre) / (2.0 * _STEP)


def by_joints(jacobians: F64, links: NDArray[np.integer], twists: F64) -> F64:
    """Outward displacement of contour samples by joint values.

    Args:
        jacobians: ``(N, 6)`` displacement by ``delta``, pixels.
        links: ``(N,)`` the link that each lies on.
        twists: ``(n, L, 6)`` of the view, see `joint_twists`.

    Returns:
        ``(N, n)`` pixels per radian or metre.
    """
    return np.einsum("ni,kni->nk", jacobians, twists[:, links])
