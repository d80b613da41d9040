from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from easyhecpp.errors import InputError
from easyhecpp.sim.boundary import draw_noise, find_band, find_contours
from easyhecpp.sim.masks import Degradation, degrade_mask, degrade_masks

HEIGHT, WIDTH = 140, 160


def disc(x: float, y: float, radius: float) -> NDArray[np.float32]:
    """Anti-aliased coverage of a disc."""
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    signed = radius - np.hypot(columns - x, rows - y)
    return np.clip(signed + 0.5, 0.0, 1.0).astype(np.float32)


def bar(left: float, right: float) -> NDArray[np.float32]:
    """Exact coverage of an upright bar from the top of the picture to its bottom."""
    columns = np.arange(WIDTH)
    row = np.clip(np.minimum(columns + 0.5, right) - np.maximum(columns - 0.5, left), 0.0, 1.0)
    return np.repeat(row[None].astype(np.float32), HEIGHT, axis=0)


def turned_bar(angle: float, offset: float, half_width: float) -> NDArray[np.float32]:
    """Coverage of an endless bar, by 9 x 9 samples."""
    at = (np.arange(9 * WIDTH) + 0.5) / 9 - 0.5, (np.arange(9 * HEIGHT) + 0.5) / 9 - 0.5
    across = (at[0][None] - WIDTH / 2) * np.cos(angle) + (at[1][:, None] - HEIGHT / 2) * np.sin(
        angle
    )
    covered = np.abs(across - offset) < half_width
    return covered.reshape(HEIGHT, 9, WIDTH, 9).mean(axis=(1, 3)).astype(np.float32)


def length(truth: NDArray[np.float32]) -> float:
    return sum(contour.length_px for contour in find_contours(truth))


def iou(a: NDArray[np.bool_], b: NDArray[np.bool_]) -> float:
    return float((a & b).sum() / (a | b).sum())


SHAPES = [disc(80.3, 70.8, 52.2), bar(60.37, 101.81), turned_bar(0.4, 3.3, 21.7)]


@pytest.mark.parametrize("truth", SHAPES)
def test_no_noise_gives_the_mask_back(truth: NDArray[np.float32]) -> None:
    np.testing.assert_array_equal(
        degrade_mask(truth, np.random.default_rng(0), iou=1.0), truth > 0.5
    )
    np.testing.assert_array_equal(
        degrade_mask(truth > 0.5, np.random.default_rng(0), iou=1.0), truth > 0.5
    )


@pytest.mark.parametrize("angle", [0.0, 0.1, 0.4, np.pi / 4, 1.2])
@pytest.mark.parametrize("as_plain_mask", [False, True])
def test_signed_distance_is_known_below_the_pixel(angle: float, as_plain_mask: bool) -> None:
    errors = []
    for offset in (np.arange(8) + 0.5) / 8:
        truth = turned_bar(angle, offset, 30.0)
        given = truth > 0.5 if as_plain_mask else truth
        band = find_band(given, find_contours(given), 4.0)
        x, y = band.columns - WIDTH / 2, band.rows - HEIGHT / 2
        exact = 30.0 - np.abs(x * np.cos(angle) + y * np.sin(angle) - offset)
        inner = (np.abs(x) < 65) & (np.abs(y) < 55)
        errors.append((band.distances - exact)[inner])
    error = np.concatenate(errors)
    assert abs(error.mean()) < (0.02 if as_plain_mask else 0.005)
    if not as_plain_mask:
        # Coverage is known to 1 / 81 and the level function is exact along the grid only.
        assert np.abs(error).max() < 0.05


def test_wanted_iou_is_met_on_average_and_sigma_is_common() -> None:
    degraded = degrade_masks(SHAPES, np.random.default_rng(1), Degradation(iou=0.97))
    values = [iou(m, t > 0.5) for m, t in zip(degraded.masks, SHAPES, strict=True)]
    assert np.mean(values) == pytest.approx(0.97, abs=5e-4)
    assert np.ptp(values) > 1e-3  # they share the displacement, not the IoU
    # IoU is about one minus length times mean absolute displacement over area.
    predicted = np.mean([1 - length(t) * 0.8 * degraded.sigma_px / (t > 0.5).sum() for t in SHAPES])
    assert predicted == pytest.approx(0.97, abs=3e-3)


@pytest.mark.parametrize("bias", [0.0, 0.3, -0.7])
def test_displacement_has_the_asked_mean(bias: float) -> None:
    rng = np.random.default_rng(2)
    change = total = 0.0
    for _ in range(100):
        x, y, more = rng.uniform(size=3)
        truth = disc(79.0 + x, 69.0 + y, 50.0 + more)
        mask = degrade_mask(truth, rng, iou=0.98, correlation_px=(2.0, 6.0), bias_px=bias)
        change += mask.sum() - float((truth > 0.5).sum())
        total += length(truth)
    # To second order the area of a disc grows by pi times the mean square displacement.
    assert change / total == pytest.approx(bias + bias**2 / 100.0, abs=0.015)


def test_mean_displacement_of_straight_edges_is_zero() -> None:
    rng = np.random.default_rng(3)
    moved = []
    for _ in range(120):
        left, right = 40 + rng.uniform(), 100 + rng.uniform()
        mask = degrade_mask(bar(left, right), rng, iou=0.97, correlation_px=(2.0,))
        moved.append((mask.sum() / HEIGHT - (right - left)) / 2)
    # Standard error: 0.7 px sigma over some 120 * 80 independent lengths.
    assert abs(np.mean(moved)) < 0.01


@pytest.mark.parametrize("correlation", [4.0, 8.0, 20.0])
def test_noise_has_unit_variance_and_the_asked_correlation(correlation: float) -> None:
    contours = find_contours(disc(80.3, 70.8, 60.2))
    assert len(contours) == 1
    assert contours[0].is_closed
    rng = np.random.default_rng(4)
    noise = np.array([draw_noise(contours, [correlation], rng) for _ in range(600)])
    spacing = contours[0].length_px / noise.shape[1]
    assert abs(noise.mean()) < 0.05
    assert noise.var() == pytest.approx(1.0, abs=0.05)
    lag = round(correlation / spacing)
    at_lag = (noise * np.roll(noise, lag, axis=1)).mean() / noise.var()
    assert at_lag == pytest.approx(np.exp(-((lag * spacing / correlation) ** 2)), abs=0.04)
    far = (noise * np.roll(noise, 3 * lag, axis=1)).mean() / noise.var()
    assert abs(far) < 0.04


def test_correlation_is_found_again_in_the_masks() -> None:
    """Displacements measured on degraded masks of a bar, row by row, against the asked lengths."""
    rng = np.random.default_rng(5)
    lengths = (5.0, 20.0)
    rows = []
    for _ in range(200):
        left, right = 45 + rng.uniform(), 95 + rng.uniform()
        mask = degrade_mask(bar(left, right), rng, iou=0.93, correlation_px=lengths)
        # Up to the middle of the bar lies one edge, the other beyond it.
        rows.append(mask[:, :70].sum(axis=1) - (69.5 - left))
        rows.append(mask[:, 70:].sum(axis=1) - (right - 69.5))
    moved = np.array(rows)
    one, other = moved[0::2], moved[1::2]
    variance = moved.var() - 1 / 12  # whole pixels add their own
    assert abs((one * other).mean() / variance) < 0.05  # the two sides are independent
    for lag in (4, 10, 20, 40):
        expected = np.mean([np.exp(-((lag / length) ** 2)) for length in lengths])
        found = (moved[:, :-lag] * moved[:, lag:]).mean() / variance
        assert found == pytest.approx(expected, abs=0.07)


def test_same_generator_same_masks() -> None:
    one, other = (degrade_mask(SHAPES[0], np.random.default_rng(9)) for _ in range(2))
    np.testing.assert_array_equal(one, other)
    assert not np.array_equal(one, degrade_mask(SHAPES[0], np.random.default_rng(10)))


def test_masks_without_a_boundary_stay_as_they_are() -> None:
    empty, full = np.zeros((20, 30), dtype=bool), np.ones((20, 30), dtype=bool)
    for mask in (empty, full):
        np.testing.assert_array_equal(degrade_mask(mask, np.random.default_rng(0)), mask)


def test_small_pieces_and_cut_contours_survive() -> None:
    truth = disc(-5.0, 70.0, 40.0) + disc(100.0, 70.0, 0.9)
    kinds = sorted(contour.is_closed for contour in find_contours(truth))
    assert kinds == [False, True]
    mask = degrade_mask(truth, np.random.default_rng(0), iou=0.97)
    assert iou(mask, truth > 0.5) == pytest.approx(0.97, abs=2e-3)


def test_senseless_wishes_are_refused() -> None:
    with pytest.raises(InputError, match=r"wanted IoU is 1\.5"):
        Degradation(iou=1.5)
    with pytest.raises(InputError, match="correlation lengths"):
        Degradation(correlation_px=())
