"""Zeros of joints that are told from the outlines."""

from __future__ import annotations

import numpy as np
import pytest

from easyhecpp.solve.zeros import AS_RECORDED, freed_step, zeros_spread

N_JOINTS, VIEWS = 5, 12
SHARED = 10


def drawn(rng: np.random.Generator, zeros: np.ndarray, fresh: float) -> tuple[np.ndarray, ...]:
    """Rows, residuals and normal equations of views whose joints are off, and the truth."""
    truth = np.r_[1e-3 * rng.standard_normal(7), np.zeros(3), zeros]
    rows = 400.0 * rng.standard_normal((VIEWS, 60, SHARED + N_JOINTS))
    own = fresh * rng.standard_normal((VIEWS, N_JOINTS))
    noise = 0.2 * rng.standard_normal((VIEWS, 60))
    residuals = rows @ truth + np.einsum("vij,vj->vi", rows[:, :, SHARED:], own) + noise
    information = rows.transpose(0, 2, 1) @ rows / 0.04
    vectors = np.einsum("vij,vi->vj", rows, residuals) / 0.04
    return rows, residuals, information, vectors, truth


PRIOR = np.diag([0.0] * 6 + [44.0])


@pytest.mark.parametrize("size", [2e-3, 4e-3])
def test_arms_that_err_from_view_to_view_are_expected_to_have_such_zeros(size: float) -> None:
    rng = np.random.default_rng(7)
    _, _, information, vectors, _ = drawn(rng, np.zeros(N_JOINTS), size)
    spread = zeros_spread(information, vectors, PRIOR)
    assert spread == pytest.approx(np.full(N_JOINTS, np.sqrt(2.0) * size), rel=0.25)


def test_nothing_is_expected_of_an_arm_that_stands_as_recorded_or_is_hardly_seen() -> None:
    rng = np.random.default_rng(8)
    _, _, information, vectors, _ = drawn(rng, np.zeros(N_JOINTS), 0.5 * AS_RECORDED)
    assert not zeros_spread(information, vectors, PRIOR).any()
    _, _, information, vectors, _ = drawn(rng, np.zeros(N_JOINTS), 4e-3)
    assert not zeros_spread(information[:3], vectors[:3], PRIOR).any()
    assert zeros_spread(information[:4], vectors[:4], PRIOR).all()


def test_a_zero_that_looks_like_a_turn_of_the_base_is_left_alone() -> None:
    rng = np.random.default_rng(10)
    rows, residuals, _, _, _ = drawn(rng, np.zeros(N_JOINTS), 3e-3)
    rows[:, :, SHARED] = rows[:, :, 2] + 0.3 * rng.standard_normal(rows.shape[:2])
    information = rows.transpose(0, 2, 1) @ rows / 0.04
    vectors = np.einsum("vij,vi->vj", rows, residuals) / 0.04
    spread = zeros_spread(information, vectors, PRIOR)
    assert spread[0] == 0.0
    assert spread[1:].all()
    step = freed_step(
        information.sum(axis=0), vectors.sum(axis=0), PRIOR,
        lens=True, spread=spread, zeros=np.zeros(N_JOINTS), inflation=1.5,
    )  # fmt: skip
    assert step.zeros[0] == 0.0
    assert step.zeros[1:].all()


def test_the_freed_step_is_the_penalised_least_squares_solution() -> None:
    rng = np.random.default_rng(9)
    spread, so_far = 2e-3, 1e-3 * rng.standard_normal(N_JOINTS)
    rows, residuals, information, vectors, _ = drawn(rng, 3e-3 * rng.standard_normal(N_JOINTS), 0.0)
    step = freed_step(
        information.sum(axis=0), vectors.sum(axis=0), PRIOR,
        lens=False, spread=np.full(N_JOINTS, spread), zeros=so_far, inflation=1.5,
    )  # fmt: skip
    # The same by stacked rows: focal length and lens held, the whole of each zero drawn to nothing.
    free = np.r_[:7, SHARED : SHARED + N_JOINTS]
    data = rows.reshape(-1, SHARED + N_JOINTS)[:, free] / 0.2
    pull = np.zeros((1 + N_JOINTS, len(free)))
    pull[0, 6] = np.sqrt(44.0)
    pull[1:, 7:] = np.eye(N_JOINTS) / spread
    A = np.vstack([data, pull])
    b = np.r_[residuals.ravel() / 0.2, 0.0, -so_far / spread]
    best = np.linalg.lstsq(A, b, rcond=None)[0]
    assert step.delta == pytest.approx(best[:6], abs=1e-8)
    assert step.zeros == pytest.approx(best[7:], abs=1e-8)
    assert (step.k == 0.0).all()
    # Its doubt is what freeing the zeros adds to the covariance of the pose.
    whole = np.linalg.inv(A.T @ A)
    pose = np.linalg.inv((A.T @ A)[:7, :7])
    assert step.pose_covariance == pytest.approx(1.5 * (whole[:6, :6] - pose[:6, :6]), rel=1e-6)
    assert step.sigma_zeros == pytest.approx(np.sqrt(1.5 * np.diag(whole)[7:]), rel=1e-6)
