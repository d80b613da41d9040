from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from easyhecpp import geometry as g

ANGLES = [0.0, 1e-12, 1e-8, 1e-4, 9.9e-3, 1.01e-2, 0.5, 2.0, 3.1, np.pi - 1e-6, np.pi - 1e-9]

tangents = arrays(np.float64, 6, elements=st.floats(-1.7, 1.7))


def random_transforms(rng: np.random.Generator, *shape: int) -> np.ndarray:
    R = Rotation.random(int(np.prod(shape, dtype=int)), rng=rng).as_matrix()
    return g.make_transform(R.reshape(*shape, 3, 3), rng.normal(size=(*shape, 3)))


def axes() -> np.ndarray:
    rng = np.random.default_rng(5)
    some = np.concatenate([np.eye(3), -np.eye(3), rng.normal(size=(10, 3))])
    return some / np.linalg.norm(some, axis=-1, keepdims=True)


def derivative(function, x: np.ndarray, step: float = 1e-6) -> np.ndarray:
    """Central differences, the argument's dimension last."""
    columns = [(function(x + d) - function(x - d)) / (2.0 * step) for d in step * np.eye(len(x))]
    return np.stack(columns, axis=-1)


def test_hat_is_the_cross_product():
    rng = np.random.default_rng(0)
    w, p = rng.normal(size=(2, 4, 3))
    np.testing.assert_allclose((g.hat(w) @ p[..., None])[..., 0], np.cross(w, p), atol=1e-15)


@pytest.mark.parametrize("angle", ANGLES)
def test_exp_so3_agrees_with_the_matrix_exponential(angle):
    for axis in axes():
        R = g.exp_so3(angle * axis)
        np.testing.assert_allclose(R, expm(g.hat(angle * axis)), atol=1e-14)
        np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-14)


@pytest.mark.parametrize("angle", ANGLES)
def test_log_so3_inverts_exp_so3_from_zero_to_almost_pi(angle):
    w = angle * axes()
    np.testing.assert_allclose(g.log_so3(g.exp_so3(w)), w, rtol=1e-9, atol=1e-15)


def test_log_so3_at_pi_gives_one_of_the_two_rotation_vectors():
    R = g.exp_so3(np.pi * axes())
    w = g.log_so3(R)
    np.testing.assert_allclose(np.linalg.norm(w, axis=-1), np.pi, rtol=1e-12)
    np.testing.assert_allclose(g.exp_so3(w), R, atol=1e-14)


def test_small_angle_series_joins_the_closed_form():
    below, above = np.nextafter(1e-2, 0.0), np.nextafter(1e-2, 1.0)
    for function in (g.exp_so3, g.left_jacobian_so3, g.left_jacobian_so3_inverse):
        for axis in axes():
            np.testing.assert_allclose(function(below * axis), function(above * axis), atol=1e-13)


@pytest.mark.parametrize("angle", ANGLES)
def test_left_jacobian_is_the_derivative_of_exp(angle):
    for axis in axes()[:8]:
        w = angle * axis

        def turned(w_moved, w=w):
            return g.log_so3(g.exp_so3(w_moved) @ g.exp_so3(w).T)

        J = g.left_jacobian_so3(w)
        np.testing.assert_allclose(J, derivative(turned, w), atol=1e-8)
        np.testing.assert_allclose(g.left_jacobian_so3_inverse(w) @ J, np.eye(3), atol=1e-12)


@pytest.mark.parametrize("angle", ANGLES)
def test_exp_se3_agrees_with_the_matrix_exponential_and_log_inverts_it(angle):
    rng = np.random.default_rng(1)
    for axis in axes():
        xi = np.concatenate([rng.normal(size=3), angle * axis])
        generator = np.zeros((4, 4))
        generator[:3, :3], generator[:3, 3] = g.hat(xi[3:]), xi[:3]
        T = g.exp_se3(xi)
        np.testing.assert_allclose(T, expm(generator), atol=1e-13)
        np.testing.assert_allclose(g.log_se3(T), xi, atol=1e-8)


@given(tangents)
def test_log_of_exp_returns_the_tangent(xi):
    np.testing.assert_allclose(g.log_se3(g.exp_se3(xi)), xi, atol=1e-9)


@given(tangents, tangents)
def test_adjoint_moves_a_tangent_to_the_other_side(pose, xi):
    T = g.exp_se3(pose)
    np.testing.assert_allclose(
        T @ g.exp_se3(xi), g.exp_se3(g.adjoint(T) @ xi) @ T, rtol=1e-9, atol=1e-9
    )


def test_inverse_undoes_a_transform():
    T = random_transforms(np.random.default_rng(2), 3, 4)
    np.testing.assert_allclose(g.inverse(T) @ T, np.broadcast_to(np.eye(4), T.shape), atol=1e-14)


def test_names_read_as_matrices_compose():
    # The camera stands 2 m along the base's x and looks back along it.
    T_base_cam = g.look_at(eye=(2.0, 0.0, 0.5), target=(0.0, 0.0, 0.5))
    T_cam_base = g.inverse(T_base_cam)
    np.testing.assert_allclose(g.transform_points(T_base_cam, (0, 0, 2)), (0, 0, 0.5), atol=1e-15)
    np.testing.assert_allclose(g.transform_points(T_cam_base, (0, 0, 0.5)), (0, 0, 2), atol=1e-15)
    # Left of the base's x axis, seen from the front, is right in the picture; up is up.
    np.testing.assert_allclose(g.transform_points(T_cam_base, (0, 1, 0.5)), (1, 0, 2), atol=1e-15)
    np.testing.assert_allclose(g.transform_points(T_cam_base, (0, 0, 1.5)), (0, -1, 2), atol=1e-15)


@pytest.mark.parametrize(
    ("batch", "points", "result"),
    [
        ((), (3,), (3,)),
        ((), (7, 3), (7, 3)),
        ((), (5, 7, 3), (5, 7, 3)),
        ((4,), (3,), (4, 3)),
        ((4,), (7, 3), (4, 7, 3)),
        ((4,), (4, 7, 3), (4, 7, 3)),
        ((2, 1), (4, 7, 3), (2, 4, 7, 3)),
    ],
)
def test_transform_points_broadcasts_sets_of_points_over_batches(batch, points, result):
    rng = np.random.default_rng(3)
    T, p = random_transforms(rng, *batch), rng.normal(size=points)
    moved = g.transform_points(T, p)
    assert moved.shape == result
    p_set = p if p.ndim > 1 else p[None]
    homogeneous = np.concatenate([p_set, np.ones((*p_set.shape[:-1], 1))], axis=-1)
    expected = np.einsum("...ij,...nj->...ni", T, homogeneous)[..., :3].reshape(result)
    np.testing.assert_allclose(moved, expected, atol=1e-14)


def test_quaternions_are_wxyz_with_w_not_negative():
    quarter_turn_about_z = g.matrix_from_quat_wxyz((np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)))
    np.testing.assert_allclose(quarter_turn_about_z @ (1, 0, 0), (0, 1, 0), atol=1e-15)
    np.testing.assert_allclose(g.quat_wxyz_from_matrix(np.eye(3)), (1, 0, 0, 0), atol=1e-15)

    R = Rotation.random(200, rng=np.random.default_rng(4))
    q = g.quat_wxyz_from_matrix(R.as_matrix())
    assert np.all(q[:, 0] >= 0.0)
    xyzw = R.as_quat(canonical=True)
    np.testing.assert_allclose(q, xyzw[:, [3, 0, 1, 2]], atol=1e-14)
    np.testing.assert_allclose(g.matrix_from_quat_wxyz(-3.0 * q), R.as_matrix(), atol=1e-14)


def test_quaternion_of_half_turns():
    half_turns = g.exp_so3(np.pi * axes())
    back = g.matrix_from_quat_wxyz(g.quat_wxyz_from_matrix(half_turns))
    np.testing.assert_allclose(back, half_turns, atol=1e-14)


@pytest.mark.parametrize("angle", [*ANGLES, np.pi])
def test_rotation_angle_keeps_its_digits_at_both_ends(angle):
    np.testing.assert_allclose(
        g.rotation_angle(g.exp_so3(angle * axes())), angle, rtol=1e-9, atol=1e-15
    )


def test_look_at_puts_the_target_ahead_and_up_upright():
    rng = np.random.default_rng(6)
    eye, target = rng.normal(size=(2, 20, 3))
    T_base_cam = g.look_at(eye, target)
    seen = g.transform_points(g.inverse(T_base_cam), target[:, None])[:, 0]
    np.testing.assert_allclose(seen[:, :2], 0.0, atol=1e-14)
    np.testing.assert_allclose(seen[:, 2], np.linalg.norm(target - eye, axis=-1))
    np.testing.assert_allclose(np.linalg.det(T_base_cam[:, :3, :3]), 1.0)
    up_cam = T_base_cam[:, 2, :3]
    np.testing.assert_allclose(up_cam[:, 0], 0.0, atol=1e-14)
    assert np.all(up_cam[:, 1] < 0.0)


@pytest.mark.parametrize("height", [1.0, -1.0])
def test_look_at_along_up_is_still_a_rotation(height):
    T_base_cam = g.look_at((0.0, 0.0, height), (0.0, 0.0, 0.0))
    R = T_base_cam[:3, :3]
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(R) == pytest.approx(1.0)
    np.testing.assert_allclose(R[:, 2], (0.0, 0.0, -height), atol=1e-15)
    # The base's x axis points up in the picture.
    np.testing.assert_allclose(R[:, 1], (-1.0, 0.0, 0.0), atol=1e-15)


def test_perturb_about_leaves_the_centre_where_a_pure_rotation_turns():
    rng = np.random.default_rng(7)
    T_cam_base = random_transforms(rng)
    centre_cam = rng.normal(size=3)
    centre_base = g.transform_points(g.inverse(T_cam_base), centre_cam)
    turned = g.perturb_about(T_cam_base, centre_cam, [0, 0, 0, 0.3, -0.2, 0.1])
    np.testing.assert_allclose(g.transform_points(turned, centre_base), centre_cam, atol=1e-14)
    moved = g.perturb_about(T_cam_base, centre_cam, [0.1, 0.2, 0.3, 0, 0, 0])
    np.testing.assert_allclose(
        g.transform_points(moved, centre_base), centre_cam + (0.1, 0.2, 0.3), atol=1e-14
    )


def test_perturb_about_moves_a_point_by_its_lever_about_the_centre():
    rng = np.random.default_rng(8)
    T_cam_base, centre, p_base = random_transforms(rng), rng.normal(size=3), rng.normal(size=3)
    p_cam = g.transform_points(T_cam_base, p_base)
    numeric = derivative(
        lambda d: g.transform_points(g.perturb_about(T_cam_base, centre, d), p_base), np.zeros(6)
    )
    np.testing.assert_allclose(
        numeric, np.concatenate([np.eye(3), -g.hat(p_cam - centre)], axis=1), atol=1e-9
    )


def test_covariance_of_the_pose_matches_drawn_perturbations():
    rng = np.random.default_rng(9)
    T_cam_base, centre = random_transforms(rng), np.array([0.1, -0.2, 1.1])
    root = 1e-3 * rng.normal(size=(6, 6))
    deltas = rng.normal(size=(200_000, 6)) @ root.T
    T_base_cam = g.inverse(T_cam_base)
    moved = g.inverse(g.perturb_about(T_cam_base, centre, deltas))
    tangents_drawn = g.log_se3(g.inverse(T_base_cam) @ moved)
    expected = g.pose_covariance_from_centred(root @ root.T, centre)
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose(np.cov(tangents_drawn.T) / scale, expected / scale, atol=0.02)


def test_covariance_map_matches_finite_differences():
    rng = np.random.default_rng(10)
    T_cam_base, centre = random_transforms(rng), rng.normal(size=3)

    def tangent_of(delta):
        moved = g.inverse(g.perturb_about(T_cam_base, centre, delta))
        return g.log_se3(T_cam_base @ moved)

    J = derivative(tangent_of, np.zeros(6))
    root = rng.normal(size=(6, 6))
    np.testing.assert_allclose(
        g.pose_covariance_from_centred(root @ root.T, centre), J @ root @ root.T @ J.T, atol=1e-7
    )


def test_pose_error_is_distance_of_centres_and_geodesic_angle():
    T_true = random_transforms(np.random.default_rng(11))
    step = g.make_transform(g.exp_so3([0.0, 0.02, 0.0]), [0.003, 0.0, -0.004])
    metres, radians = g.pose_error(T_true @ step, T_true)
    assert metres == pytest.approx(0.005)
    assert radians == pytest.approx(0.02)
    assert g.pose_error(T_true, T_true) == pytest.approx((0.0, 0.0), abs=1e-15)
