from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from easyhecpp.bench.metrics import (
    PoseError,
    chi_square,
    ellipsoid_share,
    summarise,
    wilson_interval,
)
from easyhecpp.geometry import exp_se3, look_at, make_transform

T_BASE_CAM = look_at([1.0, -0.5, 0.6], [0.0, 0.1, 0.3])


def test_error_is_measured_between_camera_centres() -> None:
    # A turn about the camera's own centre moves nothing; in base coordinates it would.
    turned = T_BASE_CAM @ exp_se3(np.array([0, 0, 0, 0, 0.01, 0]))
    error = PoseError.between(turned, T_BASE_CAM)
    assert error.position_mm == pytest.approx(0.0, abs=1e-9)
    assert error.rotation_deg == pytest.approx(math.degrees(0.01))
    moved = T_BASE_CAM @ make_transform(np.eye(3), [0.003, 0.0, 0.004])
    assert PoseError.between(moved, T_BASE_CAM).position_mm == pytest.approx(5.0)


@pytest.mark.parametrize(
    ("position_mm", "rotation_deg", "right"),
    [(20.0, 2.0, True), (20.1, 0.0, False), (0.0, 2.1, False)],
)
def test_right_is_within_20_mm_and_2_deg(
    position_mm: float, rotation_deg: float, right: bool
) -> None:
    assert PoseError(position_mm, rotation_deg).is_right is right


def test_summary_keeps_wrong_poses_out_of_the_mean_alone() -> None:
    errors = [PoseError(float(i), 0.1 * i) for i in range(1, 20)] + [PoseError(500.0, 90.0)]
    summary = summarise(errors)
    assert (summary.count, summary.failures) == (20, 1)
    assert summary.position_mm.mean == pytest.approx(10.0)
    assert summary.position_mm.median == pytest.approx(10.5)
    values = np.array([e.position_mm for e in errors])
    assert summary.position_mm.p95 == pytest.approx(np.percentile(values, 95))
    assert summary.rotation_deg.mean == pytest.approx(1.0)


def test_pose_that_was_not_found_counts_as_infinitely_wrong() -> None:
    summary = summarise([None, None, PoseError(1.0, 0.1)])
    assert summary.failures == 2
    assert summary.position_mm.mean == pytest.approx(1.0)
    assert math.isinf(summary.position_mm.median)
    assert math.isinf(summary.position_mm.p95)
    nothing = summarise([])
    assert nothing.count == 0
    assert math.isnan(nothing.position_mm.mean)


def test_wilson_interval_against_published_values() -> None:
    # Newcombe 1998, table I, method 3 (81 of 263, 0 of 20, 1 of 29).
    assert wilson_interval(81, 263) == pytest.approx((0.2553, 0.3662), abs=5e-5)
    assert wilson_interval(0, 20) == pytest.approx((0.0, 0.1611), abs=5e-5)
    assert wilson_interval(1, 29) == pytest.approx((0.0061, 0.1718), abs=5e-5)
    assert wilson_interval(0, 0) == (0.0, 1.0)


def test_chi_square_of_errors_drawn_from_the_covariance() -> None:
    rng = np.random.default_rng(0)
    root = rng.normal(size=(6, 6)) * np.array([1e-3, 1e-3, 2e-3, 1e-4, 1e-4, 3e-4])[:, None]
    covariance = root @ root.T
    values = [
        chi_square(T_BASE_CAM, covariance, T_BASE_CAM @ exp_se3(root @ rng.normal(size=6)))
        for _ in range(2000)
    ]
    assert np.mean(values) == pytest.approx(6.0, rel=0.05)
    assert stats.kstest(values, stats.chi2(6).cdf).pvalue > 0.01
    assert ellipsoid_share(values) == pytest.approx(0.95, abs=0.015)
    assert math.isnan(ellipsoid_share([]))
