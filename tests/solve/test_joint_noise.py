"""The variance of joint errors, and what is left of a pose's information once they are free."""

from __future__ import annotations

import numpy as np
import pytest

from easyhecpp.solve.joint_noise import UNDERSTATED, JointNoise

N_JOINTS, N_POINTS = 5, 200
PRIOR = np.diag([0.0] * 6 + [4.0])


def system(sigma: float, n_views: int, seed: int = 0):
    """Designs, residuals and normal equations of views with joint errors of a known size."""
    rng = np.random.default_rng(seed)
    designs = rng.normal(size=(n_views, N_POINTS, 7 + N_JOINTS)) * ([1.0] * 7 + [300.0] * N_JOINTS)
    errors = sigma * rng.normal(size=(n_views, N_JOINTS))
    shared = np.array([0.3, -0.2, 0.1, 0.0, 0.2, -0.1, 0.4])
    residuals = (
        designs[..., :7] @ shared
        + np.einsum("vni,vi->vn", designs[..., 7:], errors)
        + rng.normal(size=(n_views, N_POINTS))
    )
    return (
        designs,
        residuals,
        np.einsum("vni,vnj->vij", designs, designs),
        np.einsum("vni,vn->vi", designs, residuals),
    )


def test_marginal_is_least_squares_with_the_joints_in_the_covariance() -> None:
    designs, residuals, information, vectors = system(2e-3, 3)
    noise = JointNoise(4e-6)
    N, b = noise.marginal(information, vectors)
    for view in range(3):
        A, Z = designs[view, :, :7], designs[view, :, 7:]
        C = np.eye(N_POINTS) + noise.variance * Z @ Z.T
        np.testing.assert_allclose(N[view], A.T @ np.linalg.solve(C, A), rtol=1e-7)
        np.testing.assert_allclose(
            b[view], A.T @ np.linalg.solve(C, residuals[view]), rtol=1e-6, atol=1e-6
        )


@pytest.mark.parametrize("sigma", [0.5e-3, 2e-3, 5e-3])
@pytest.mark.parametrize("n_views", [3, 8])
def test_variance_is_found(sigma: float, n_views: int) -> None:
    found = []
    for seed in range(12):
        _, _, information, vectors = system(sigma, n_views, seed)
        found.append(JointNoise().fitted(information, vectors, PRIOR).variance)
    assert np.sqrt(np.mean(found)) == pytest.approx(sigma, rel=0.2)


def test_exact_joints_cost_no_more_than_a_tenth_of_a_milliradian() -> None:
    _, _, information, vectors = system(0.0, 5)
    assert JointNoise().fitted(information, vectors, PRIOR).variance < 1e-4**2


def test_effects_are_those_of_all_unknowns_solved_together() -> None:
    _, _, information, vectors = system(2e-3, 2)
    noise = JointNoise(4e-6)
    whole = np.zeros((7 + 2 * N_JOINTS, 7 + 2 * N_JOINTS))
    right = np.zeros(7 + 2 * N_JOINTS)
    whole[:7, :7] = PRIOR
    for view in range(2):
        own = np.r_[0:7, 7 + view * N_JOINTS : 7 + (view + 1) * N_JOINTS]
        whole[np.ix_(own, own)] += information[view]
        right[own] += vectors[view]
    whole[7:, 7:] += np.eye(2 * N_JOINTS) / noise.variance
    solved, covariance = np.linalg.solve(whole, right), np.linalg.inv(whole)
    N, b = noise.marginal(information, vectors)
    shared = np.linalg.solve(N.sum(axis=0) + PRIOR, b.sum(axis=0))
    np.testing.assert_allclose(shared, solved[:7], rtol=1e-6, atol=1e-9)
    effects, spread = noise.effects(information, vectors, PRIOR)
    for view in range(2):
        own = np.r_[0:7, 7 + view * N_JOINTS : 7 + (view + 1) * N_JOINTS]
        np.testing.assert_allclose(effects[view], solved[own], rtol=1e-6, atol=1e-9)
        np.testing.assert_allclose(
            spread[view], covariance[np.ix_(own, own)], rtol=1e-5, atol=1e-12
        )


def test_pulls_are_the_spread_of_what_the_views_say() -> None:
    """The vectors' covariance over many draws of joint errors, noise along the contour left out."""
    _, _, information, _ = system(2e-3, 3)
    rng = np.random.default_rng(1)
    errors = np.sqrt(UNDERSTATED) * 2e-3 * rng.normal(size=(20000, 3, N_JOINTS))
    sums = np.einsum("vij,dvj->di", information[:, :7, 7:], errors)
    expected = JointNoise(4e-6).pulls(information)
    scale = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(
        np.cov(sums.T) / np.outer(scale, scale), expected / np.outer(scale, scale), atol=0.05
    )
