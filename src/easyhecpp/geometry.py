"""Rigid transforms SE(3) and their tangent space, on plain float64 arrays.

``T_a_b`` is a ``(4, 4)`` matrix that maps coordinates in frame b to frame a; it is the pose of b in
a. Every function takes any number of leading batch dimensions. Tangents are ``xi = [v, w]``:
translation part first (metres), rotation vector second (radians).

Source of the closed forms: Sola, Deray, Atchuthan, "A micro Lie theory for state estimation in
robotics" (2018), sections on SO(3) and SE(3).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

# Below this angle (rad) the closed forms lose digits to cancellation, and their Taylor series, cut
# after the quadratic term, is exact to rounding.
_SMALL_ANGLE = 1e-2


def hat(w: ArrayLike) -> Array:
    """Return the ``(..., 3, 3)`` matrix for which ``hat(w) @ p == cross(w, p)``."""
    w = np.asarray(w, dtype=np.float64)
    matrix = np.zeros((*w.shape[:-1], 3, 3))
    matrix[..., 0, 1], matrix[..., 0, 2] = -w[..., 2], w[..., 1]
    matrix[..., 1, 0], matrix[..., 1, 2] = w[..., 2], -w[..., 0]
    matrix[..., 2, 0], matrix[..., 2, 1] = -w[..., 1], w[..., 0]
    return matrix


def exp_so3(w: ArrayLike) -> Array:
    """Turn a rotation vector ``(..., 3)`` (rad) into a rotation matrix ``(..., 3, 3)``."""
    w = np.asarray(w, dtype=np.float64)
    a, b, _ = _rodrigues_factors(np.linalg.norm(w, axis=-1))
    W = hat(w)
    return np.eye(3) + a[..., None, None] * W + b[..., None, None] * (W @ W)


def log_so3(R: ArrayLike) -> Array:
    """Turn a rotation matrix ``(..., 3, 3)`` into its rotation vector ``(..., 3)``, angle <= pi.

    Goes through the quaternion, which keeps all digits near 0 and near pi alike.
    """
    q = quat_wxyz_from_matrix(R)
    sine = np.linalg.norm(q[..., 1:], axis=-1)
    angle = 2.0 * np.arctan2(sine, q[..., 0])
    # angle / sin(angle / 2) tends to 2 at the identity.
    tiny = sine < 1e-12
    factor = np.where(tiny, 2.0, angle / np.where(tiny, 1.0, sine))
    return factor[..., None] * q[..., 1:]


def left_jacobian_so3(w: ArrayLike) -> Array:
    """Return ``J`` ``(..., 3, 3)`` with ``exp(w + dw) = exp(J dw) exp(w)`` to first order.

    It also carries the translation part of a tangent: ``exp([v, w])`` moves by ``J(w) @ v``.
    """
    w = np.asarray(w, dtype=np.float64)
    _, b, c = _rodrigues_factors(np.linalg.norm(w, axis=-1))
    W = hat(w)
    return np.eye(3) + b[..., None, None] * W + c[..., None, None] * (W @ W)


def left_jacobian_so3_inverse(w: ArrayLike) -> Array:
    """Return the inverse of `left_jacobian_so3`, ``(..., 3, 3)``, for angles below 2 pi."""
    w = np.asarray(w, dtype=np.float64)
    angle = np.linalg.norm(w, axis=-1)
    small = angle < _SMALL_ANGLE
    half = np.where(small, 1.0, angle) / 2.0
    squared = angle**2
    factor = np.where(
        small,
        1.0 / 12.0 + squared / 720.0 + squared**2 / 30240.0,
        (1.0 - half / np.tan(half)) / (4.0 * half**2),
    )
    W = hat(w)
    return np.eye(3) - 0.5 * W + factor[..., None, None] * (W @ W)


def exp_se3(xi: ArrayLike) -> Array:
    """Turn a tangent ``(..., 6)``, ``[v, w]`` in metres and radians, into ``(..., 4, 4)``."""
    xi = np.asarray(xi, dtype=np.float64)
    v, w = xi[..., :3], xi[..., 3:]
    return make_transform(exp_so3(w), _apply(left_jacobian_so3(w), v))


def log_se3(T: ArrayLike) -> Array:
    """Turn a transform ``(..., 4, 4)`` into its tangent ``(..., 6)``, ``[v, w]``, angle <= pi."""
    T = np.asarray(T, dtype=np.float64)
    w = log_so3(T[..., :3, :3])
    return np.concatenate([_apply(left_jacobian_so3_inverse(w), T[..., :3, 3]), w], axis=-1)


def make_transform(R: ArrayLike, t: ArrayLike) -> Array:
    """Join rotations ``(..., 3, 3)`` and translations ``(..., 3)`` into ``(..., 4, 4)``."""
    R = np.asarray(R, dtype=np.float64)
    t = np.asarray(t, dtype=np.float64)
    T = np.zeros((*np.broadcast_shapes(R.shape[:-2], t.shape[:-1]), 4, 4))
    T[..., :3, :3] = R
    T[..., :3, 3] = t
    T[..., 3, 3] = 1.0
    return T


def translation_matrix(t: ArrayLike) -> Array:
    """Return the transform ``(..., 4, 4)`` that moves by ``t`` ``(..., 3)`` and turns nothing."""
    return make_transform(np.eye(3), t)


def inverse(T: ArrayLike) -> Array:
    """Invert rigid transforms: ``T_a_b`` ``(..., 4, 4)`` becomes ``T_b_a``."""
    T = np.asarray(T, dtype=np.float64)
    R_inv = np.swapaxes(T[..., :3, :3], -1, -2)
    return make_transform(R_inv, -_apply(R_inv, T[..., :3, 3]))


def adjoint(T: ArrayLike) -> Array:
    """Return ``Ad`` ``(..., 6, 6)`` with ``T @ exp(xi) = exp(Ad @ xi) @ T`` for ``xi = [v, w]``."""
    T = np.asarray(T, dtype=np.float64)
    R = T[..., :3, :3]
    matrix = np.zeros((*T.shape[:-2], 6, 6))
    matrix[..., :3, :3] = R
    matrix[..., :3, 3:] = hat(T[..., :3, 3]) @ R
    matrix[..., 3:, 3:] = R
    return matrix


def transform_points(T: ArrayLike, p: ArrayLike) -> Array:
    """Map points through transforms.

    Args:
        T: ``T_a_b``, ``(..., 4, 4)``.
        p: Points in frame b: one point ``(3,)``, or a set ``(..., N, 3)`` whose dimensions before N
            are broadcast against those of ``T``. So ``(L, 4, 4)`` with ``(N, 3)`` gives
            ``(L, N, 3)``.

    Returns:
        The points in frame a.
    """
    T = np.asarray(T, dtype=np.float64)
    p = np.asarray(p, dtype=np.float64)
    R, t = T[..., :3, :3], T[..., :3, 3]
    if p.ndim == 1:
        return R @ p + t
    return p @ np.swapaxes(R, -1, -2) + t[..., None, :]


def quat_wxyz_from_matrix(R: ArrayLike) -> Array:
    """Turn rotation matrices ``(..., 3, 3)`` into unit quaternions ``(..., 4)``, wxyz, w >= 0."""
    R = np.asarray(R, dtype=np.float64)
    r = [[R[..., i, j] for j in range(3)] for i in range(3)]
    x, y, z = r[2][1] - r[1][2], r[0][2] - r[2][0], r[1][0] - r[0][1]
    xy, xz, yz = r[0][1] + r[1][0], r[0][2] + r[2][0], r[1][2] + r[2][1]
    # Four times q_i q_j: every row is the quaternion times one of its entries. The row with the
    # largest diagonal has no cancellation (Shepperd 1978).
    products = np.stack(
        [
            np.stack([1.0 + r[0][0] + r[1][1] + r[2][2], x, y, z], axis=-1),
            np.stack([x, 1.0 + r[0][0] - r[1][1] - r[2][2], xy, xz], axis=-1),
            np.stack([y, xy, 1.0 - r[0][0] + r[1][1] - r[2][2], yz], axis=-1),
            np.stack([z, xz, yz, 1.0 - r[0][0] - r[1][1] + r[2][2]], axis=-1),
        ],
        axis=-2,
    )
    best = np.argmax(np.diagonal(products, axis1=-2, axis2=-1), axis=-1)
    q = np.take_along_axis(products, best[..., None, None], axis=-2)[..., 0, :]
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    return np.where(q[..., :1] < 0.0, -q, q)


def matrix_from_quat_wxyz(q: ArrayLike) -> Array:
    """Turn quaternions ``(..., 4)``, wxyz, of any length but 0 into matrices ``(..., 3, 3)``."""
    any_length = np.asarray(q, dtype=np.float64)
    unit = any_length / np.linalg.norm(any_length, axis=-1, keepdims=True)
    V = hat(unit[..., 1:])
    return np.eye(3) + 2.0 * unit[..., :1, None] * V + 2.0 * (V @ V)


def rotation_angle(R: ArrayLike) -> Array:
    """Return the geodesic angle of rotations ``(..., 3, 3)`` in radians, ``(...)``, 0 to pi."""
    return np.linalg.norm(log_so3(R), axis=-1)


def look_at(eye: ArrayLike, target: ArrayLike, up: ArrayLike = (0.0, 0.0, 1.0)) -> Array:
    """Place a camera at ``eye`` that looks at ``target`` and keeps ``up`` towards its top.

    Args:
        eye: Camera centre in the base, ``(..., 3)`` metres.
        target: Point in the base that falls on the optical axis, ``(..., 3)``.
        up: Direction in the base that appears upright. Where the view runs along it the roll is
            free, and the base's x axis is put upright instead.

    Returns:
        ``T_base_cam`` ``(..., 4, 4)`` with OpenCV axes: +Z forward, +X right, +Y down.
    """
    eye = np.asarray(eye, dtype=np.float64)
    up = np.asarray(up, dtype=np.float64)
    z = np.asarray(target, dtype=np.float64) - eye
    z = z / np.linalg.norm(z, axis=-1, keepdims=True)
    x = np.cross(z, up)
    along = np.linalg.norm(x, axis=-1, keepdims=True) < 1e-6 * np.linalg.norm(up)
    x = np.where(along, np.cross(z, (1.0, 0.0, 0.0)), x)
    x = x / np.linalg.norm(x, axis=-1, keepdims=True)
    return make_transform(np.stack([x, np.cross(z, x), z], axis=-1), eye)


def perturb_about(T_cam_x: ArrayLike, centre_cam: ArrayLike, delta: ArrayLike) -> Array:
    """Move whatever ``T_cam_x`` places before the camera, turning about a point near it.

    Turning about the middle of the arm instead of about the camera keeps rotation and translation
    apart: a pixel moves about as much for a milliradian as for a millimetre.

    Args:
        T_cam_x: ``(..., 4, 4)``.
        centre_cam: The point to turn about, in the camera frame, ``(3,)`` metres.
        delta: ``[v, w]`` along the camera's axes, ``(..., 6)``, metres and radians.

    Returns:
        ``Tr(c) @ exp(delta) @ Tr(-c) @ T_cam_x``, ``(..., 4, 4)``.
    """
    centre = np.asarray(centre_cam, dtype=np.float64)
    T_cam_x = np.asarray(T_cam_x, dtype=np.float64)
    return translation_matrix(centre) @ exp_se3(delta) @ translation_matrix(-centre) @ T_cam_x


def pose_covariance_from_centred(cov: ArrayLike, centre_cam: ArrayLike) -> Array:
    """Turn the covariance of a `perturb_about` step into that of the camera's pose.

    Since ``inv(Tr(c) exp(delta) Tr(-c) T_cam_x) = T_x_cam @ exp(-Ad(Tr(c)) delta)``, the tangent of
    the camera's pose is linear in ``delta`` and the mapping is exact.

    Args:
        cov: ``(6, 6)`` covariance of ``delta = [v, w]``, metres and radians.
        centre_cam: The point that ``delta`` turns about, camera frame, ``(3,)``.

    Returns:
        ``(6, 6)`` covariance of ``[v, w]`` in ``T_x_cam @ exp([v, w])``.
    """
    J = -adjoint(translation_matrix(centre_cam))
    return J @ np.asarray(cov, dtype=np.float64) @ J.T


def pose_error(T_a_cam_est: ArrayLike, T_a_cam_true: ArrayLike) -> tuple[float, float]:
    """Return how far an estimated camera pose ``(4, 4)`` is from the true one.

    Both map from the camera to the same frame a; handing over the inverses would measure the
    distance of a's origins instead of the cameras'.

    Returns:
        Distance of the camera centres in metres, and geodesic angle in radians.
    """
    est = np.asarray(T_a_cam_est, dtype=np.float64)
    true = np.asarray(T_a_cam_true, dtype=np.float64)
    distance = float(np.linalg.norm(est[:3, 3] - true[:3, 3]))
    return distance, float(rotation_angle(est[:3, :3].T @ true[:3, :3]))


def _apply(matrix: Array, vector: Array) -> Array:
    return (matrix @ vector[..., None])[..., 0]


def _rodrigues_factors(angle: Array) -> tuple[Array, Array, Array]:
    """Return sin(a)/a, (1 - cos(a))/a^2 and (a - sin(a))/a^3, finite at a = 0."""
    small = angle < _SMALL_ANGLE
    safe = np.where(small, 1.0, angle)
    squared = angle**2
    fourth = squared**2
    a = np.where(small, 1.0 - squared / 6.0 + fourth / 120.0, np.sin(safe) / safe)
    # The half angle avoids the cancellation in 1 - cos.
    b = np.where(
        small,
        0.5 - squared / 24.0 + fourth / 720.0,
        2.0 * (np.sin(safe / 2.0) / safe) ** 2,
    )
    c = np.where(
        small,
        1.0 / 6.0 - squared / 120.0 + fourth / 5040.0,
        (safe - np.sin(safe)) / safe**3,
    )
    return a, b, c
