"""The model of mask errors along the contour."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from easyhecpp.solve.correlation import ContourPoints, fit_noise

SMOOTHING_PX = 1.2


def ring(rng: np.random.Generator, residuals: str, n: int = 300) -> ContourPoints:
    angle = np.linspace(0, 2 * np.pi, n, endpoint=False)
    normals = np.column_stack([np.cos(angle), np.sin(angle)])
    values = {
        "white": rng.normal(size=n),
        "smooth": np.repeat(rng.normal(size=n // 10), 10),
        "zero": np.zeros(n),
        "constant": np.ones(n),
    }[residuals]
    return ContourPoints(
        points=[300, 200] + 6.0 * n / (2 * np.pi) * normals,
        normals=normals,
        jacobians=rng.normal(size=(n, 6)),
        residuals=0.3 * values,
        weights=rng.uniform(0.1, 1.0, n),
        length_px=rng.uniform(1.0, 8.0, n),
        links=np.zeros(n, np.int64),
    )


NOTHING = ContourPoints.joined([])


@pytest.mark.parametrize("kind", ["white", "smooth", "zero", "constant"])
def test_covariance_is_positive_definite(kind: str) -> None:
    rng = np.random.default_rng(0)
    views = [ring(rng, kind), ring(rng, "white"), NOTHING]
    noise = fit_noise(views, np.array([1.0, 0.5, 1.0]), SMOOTHING_PX)
    for view in (0, 1):
        C = noise.covariance(views[view], view)
        np.testing.assert_allclose(C, C.T)
        assert np.linalg.eigvalsh(C).min() > 0.0
    assert np.isfinite(noise.sigma_px)


def test_correlated_errors_are_told_from_independent_ones() -> None:
    """Ten neighbours that err together tell as much as one: the mean is known three times worse."""
    rng = np.random.default_rng(1)
    spread = {}
    for kind in ("white", "smooth"):
        views = [ring(rng, kind) for _ in range(4)]
        noise = fit_noise(views, np.ones(4), SMOOTHING_PX)
        weights = np.linalg.solve(noise.covariance(views[0], 0), np.ones(300))
        spread[kind] = 1.0 / np.sqrt(weights.sum())
        assert noise.sigma_px == pytest.approx(0.3, rel=0.25)
    assert spread["smooth"] > 2.0 * spread["white"]


def test_a_view_without_trust_has_no_say() -> None:
    rng = np.random.default_rng(2)
    good = [ring(rng, "white") for _ in range(3)]
    wrong = ring(rng, "constant")
    wrong = replace(wrong, residuals=50.0 * wrong.residuals)
    alone = fit_noise(good, np.ones(3), SMOOTHING_PX)
    beside = fit_noise([*good, wrong], np.array([1.0, 1.0, 1.0, 0.0]), SMOOTHING_PX)
    assert beside.sigma_px == pytest.approx(alone.sigma_px, rel=1e-6)


def test_no_points_at_all() -> None:
    noise = fit_noise([NOTHING, NOTHING], np.ones(2), SMOOTHING_PX)
    assert np.isfinite(noise.sigma_px)
    assert noise.covariance(NOTHING, 0).shape == (0, 0)
