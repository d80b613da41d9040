from __future__ import annotations

import numpy as np
from sim_pictures import shift_px

from easyhecpp.sim.denoise import denoised


def halves(truth: np.ndarray, sigma: float, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    first, second = (truth + sigma * rng.standard_normal(truth.shape) for _ in range(2))
    return np.maximum(first, 0).astype(np.float32), np.maximum(second, 0).astype(np.float32)


def step(slant: float) -> np.ndarray:
    """A slanted edge between two tones, anti-aliased exactly enough."""
    x = np.arange(80 * 8) / 8.0 - 40.0
    y = np.arange(60 * 8)[:, None] / 8.0 - 30.0
    fine = np.where(x > slant * y + 0.3, 0.8, 0.25)
    soft = fine.reshape(60, 8, 80, 8).mean(axis=(1, 3))
    return np.repeat(soft[..., None], 3, axis=2)


def test_noise_falls_to_less_than_half():
    truth = step(0.2)
    first, second = halves(truth, 0.08)
    before = (0.5 * (first + second) - truth).std()
    after = (denoised(first, second) - truth).std()
    assert after < 0.45 * before


def test_edges_stay_where_they_are():
    truth = step(0.13)
    clean = np.mean([denoised(*halves(truth, 0.08, seed)) for seed in range(6)], axis=0)
    assert abs(shift_px(clean.mean(axis=-1), truth.mean(axis=-1))[0]) < 0.03


def test_a_bright_spark_in_one_half_is_dropped():
    truth = np.full((20, 20, 3), 0.4)
    first, second = halves(truth, 0.01)
    first[10, 10] = 500.0
    assert denoised(first, second).max() < 0.8


def test_a_picture_without_noise_comes_back():
    truth = step(0.4).astype(np.float32)
    assert np.abs(denoised(truth, truth) - truth).max() < 1e-4
