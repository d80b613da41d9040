"""How the contour moves when a joint does."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from easyhecpp.camera import Camera
from easyhecpp.geometry import inverse, transform_points
from easyhecpp.render import Contour
from easyhecpp.rig import Rig

F64 = NDArray[np.float64]

_STEP = 1e-5


def joint_jacobians(
    rig: Rig, camera: Camera, joints: F64, T_cam_mount: F64, contour: Contour
) -> F64:
    """Outward displacement of contour samples by joint values.

    Args:
        rig: Robot and set-up.
        camera: The camera that the contour's pixels belong to.
        joints: ``(n,)`` of the view.
        T_cam_mount: ``(4, 4)`` at which the contour was rendered.
        contour: Samples ``(N,)``.

    Returns:
        ``(N, n)`` pixels per radian or metre.
    """
    n = len(joints)
    steps = _STEP * np.concatenate([np.eye(n), -np.eye(n)])
    Ts_moved = T_cam_mount @ rig.Ts_mount_link(joints + steps)
    Ts_link_cam = inverse(T_cam_mount @ rig.Ts_mount_link(joints))
    on_link = transform_points(Ts_link_cam[contour.links], contour.points_cam[:, None])[:, 0]
    _, by_point = camera.project_with_jacobian(contour.points_cam)
    normal_by_point = np.einsum("ni,nij->nj", contour.normals, by_point)
    columns = []
    for k in range(n):
        ahead, back = (
            transform_points(Ts[contour.links], on_link[:, None])[:, 0]
            for Ts in (Ts_moved[k], Ts_moved[n + k])
        )
        columns.append(np.einsum("nj,nj->n", normal_by_point, (ahead - back) / (2.0 * _STEP)))
    return np.stack(columns, axis=1)
