"""What joints are off by in all views alike."""

from __future__ import annotations

import numpy as np
import pytest

from easyhecpp.solve.joint_noise import JointNoise
from easyhecpp.solve.joint_offsets import SAG, JointOffsets, freed_step, offsets_asked

N_JOINTS, VIEWS = 5, 12
SHARED = 10
PRIOR = np.diag([0.0] * 6 + [44.0])
NAMES = tuple(f"joint{i}" for i in range(N_JOINTS))


def drawn(
    rng: np.random.Generator, offsets: np.ndarray, fresh: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Rows, residuals and normal equations of views whose joints are off by ``(V, n)``."""
    rows = 400.0 * rng.standard_normal((VIEWS, 60, SHARED + N_JOINTS))
    truth = np.r_[1e-3 * rng.standard_normal(7), np.zeros(3)]
    own = offsets + fresh * rng.standard_normal((VIEWS, N_JOINTS))
    noise = 0.2 * rng.standard_normal((VIEWS, 60))
    residuals = rows[:, :, :SHARED] @ truth + np.einsum("vij,vj->vi", rows[:, :, SHARED:], own)
    residuals += noise
    return rows, residuals, *equations(rows, residuals)


def equations(rows: np.ndarray, residuals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    information = rows.transpose(0, 2, 1) @ rows / 0.04
    return information, np.einsum("vij,vi->vj", rows, residuals) / 0.04


def shapes(rng: np.random.Generator) -> np.ndarray:
    """Loads of joints that differ from view to view."""
    return rng.uniform(-1.0, 1.0, (VIEWS, N_JOINTS))


def asked(information: np.ndarray, vectors: np.ndarray, sag: np.ndarray) -> tuple[str, ...]:
    return offsets_asked(information, vectors, PRIOR, sag=sag, joint_names=NAMES).names


@pytest.mark.parametrize("fresh", [0.0, 1.5e-3])
def test_sag_and_zeros_are_told_from_each_other_and_from_fresh_errors(fresh: float) -> None:
    wrong, total = [], 0
    for seed in range(10):
        rng = np.random.default_rng(seed)
        sag = shapes(rng)
        zeros = np.broadcast_to(5e-3 * rng.choice([-1.0, 1.0], N_JOINTS), sag.shape)
        cases = {(): 0 * sag, (SAG,): 8e-3 * sag, NAMES: zeros, (SAG, *NAMES): 8e-3 * sag + zeros}
        for names, offsets in cases.items():
            _, _, information, vectors = drawn(rng, offsets, fresh)
            found = asked(information, vectors, sag)
            wrong += [(seed, names, found)] * (sorted(found) != sorted(names))
            total += 1
    # Errors that are fresh in every view are now and then alike in most of them.
    assert len(wrong) <= 0.05 * total, wrong


def test_nothing_is_asked_of_few_views() -> None:
    rng = np.random.default_rng(8)
    sag = shapes(rng)
    _, _, information, vectors = drawn(rng, 8e-3 * sag, 0.0)
    assert asked(information[:4], vectors[:4], sag[:4]) == (SAG,)
    # Views that do not count are there, but say nothing.
    information[3:], vectors[3:] = 0.0, 0.0
    assert asked(information, vectors, sag) == ()


def test_a_zero_that_looks_like_a_turn_of_the_base_is_left_alone() -> None:
    rng = np.random.default_rng(10)
    off = np.r_[0.0, 5e-3, -5e-3, 5e-3, -5e-3]
    rows, residuals, _, _ = drawn(rng, np.broadcast_to(off, (VIEWS, N_JOINTS)), 1e-3)
    rows[:, :, SHARED] = rows[:, :, 2] + 0.3 * rng.standard_normal(rows.shape[:2])
    assert asked(*equations(rows, residuals), shapes(rng)) == NAMES[1:]


def test_the_evidence_is_that_of_the_whole_gaussian() -> None:
    # Residuals are normal, of a covariance to which each unknown adds its own.
    rng = np.random.default_rng(11)
    size, sigma, prior = 9, 0.7, np.diag(rng.uniform(0.5, 2.0, 3))
    rows = rng.standard_normal((2, size, 5))
    residuals = rng.standard_normal((2, size))
    shared = rows[:, :, :3].reshape(-1, 3)
    own = np.zeros((2 * size, 4))
    own[:size, :2], own[size:, 2:] = rows[0, :, 3:], rows[1, :, 3:]
    information = rows.transpose(0, 2, 1) @ rows
    vectors = np.einsum("vij,vi->vj", rows, residuals)

    def log_density(spread: float) -> float:
        C = np.eye(2 * size) + shared @ np.linalg.inv(prior) @ shared.T + spread**2 * own @ own.T
        r = residuals.ravel()
        return -0.5 * float(r @ np.linalg.solve(C, r) + np.linalg.slogdet(C)[1])

    def evidence(spread: float) -> float:
        return JointNoise(spread**2, shared=3).log_evidence(information, vectors, prior)

    grown = evidence(sigma) - evidence(0.2)
    assert grown == pytest.approx(log_density(sigma) - log_density(0.2), abs=1e-9)
    constant = 0.5 * np.linalg.slogdet(prior)[1] - 0.5 * np.square(residuals).sum()
    assert evidence(sigma) + constant == pytest.approx(log_density(sigma), abs=1e-9)


@pytest.mark.parametrize("fresh", [0.0, 2e-3])
def test_the_freed_step_is_the_penalised_least_squares_solution(fresh: float) -> None:
    rng = np.random.default_rng(9)
    sag = shapes(rng)
    offsets = JointOffsets((SAG, "joint3"), np.stack([sag, 0.0 * sag], axis=2), np.r_[8e-3, 2e-3])
    offsets.shapes[:, 3, 1] = 1.0
    so_far = np.r_[2e-3, -1e-3]
    rows, residuals, information, vectors = drawn(rng, offsets.of(np.r_[5e-3, 3e-3]), fresh)
    step = freed_step(
        information, vectors, PRIOR, lens=False, offsets=offsets, values=so_far, inflation=1.5
    )
    # The same by stacked rows: focal length and lens held, the whole of each offset drawn to 0, and
    # errors of every joint in every view besides, of the size that they are found to have.
    by_offset = np.einsum("vin,vnm->vim", rows[:, :, SHARED:], offsets.shapes)
    data = np.concatenate([rows[:, :, :7], by_offset], axis=2).reshape(-1, 9) / 0.2
    known = offsets.prior(PRIOR, lens=False)
    noise = JointNoise(shared=12).fitted(*offsets.equations(information, vectors), known)
    own = np.zeros((VIEWS, 60, VIEWS, N_JOINTS))
    for view in range(VIEWS):
        own[view, :, view] = rows[view, :, SHARED:] / 0.2
    pull = np.zeros((3, 9))
    pull[0, 6] = np.sqrt(44.0)
    pull[1:, 7:] = np.diag(1.0 / offsets.spread)
    own = own.reshape(len(data), -1)
    errors = np.eye(own.shape[1]) / np.sqrt(2.0 * noise.variance)
    A = np.block(
        [[data, own], [pull, np.zeros((3, own.shape[1]))], [np.zeros((len(errors), 9)), errors]]
    )
    b = np.r_[residuals.ravel() / 0.2, 0.0, -so_far / offsets.spread]
    b = np.r_[b, np.zeros(len(errors))]
    best = np.linalg.lstsq(A, b, rcond=None)[0]
    assert step.offsets == pytest.approx(best[7:9], abs=1e-8)
    assert (step.k == 0.0).all()
    # The pose then goes with the joints as they are.
    still = np.vstack([data, pull])
    left = b[: len(still)] - still[:, 7:] @ step.offsets
    pose = np.linalg.lstsq(still[: len(data) + 1, :7], left[: len(data) + 1], rcond=None)[0]
    assert step.delta == pytest.approx(pose[:6], abs=1e-8)
    # What the doubt about the offsets adds to the covariance of the pose.
    doubt = 1.5 * np.linalg.inv(A.T @ A)[7:9, 7:9]
    assert step.sigma_offsets == pytest.approx(np.sqrt(np.diag(doubt)), rel=1e-5)
    follows = -np.linalg.lstsq(still[: len(data) + 1, :7], still[: len(data) + 1, 7:], rcond=None)[
        0
    ]
    assert step.pose_covariance == pytest.approx((follows @ doubt @ follows.T)[:6, :6], rel=1e-4)
