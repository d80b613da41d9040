"""What a mask says along a contour: distances, residuals, ignored regions."""

from __future__ import annotations

import numpy as np
import pytest
from small_arm import observe, scene

from easyhecpp.render import SilhouetteRenderer
from easyhecpp.solve._evidence_kernel import compare, covered_box
from easyhecpp.solve.evidence import MaskPyramid, gather, sample, signed_distance


def test_signed_distance_is_half_a_pixel_on_either_side() -> None:
    mask = np.zeros((20, 30), np.float32)
    mask[:, 12:] = 1.0
    distance = signed_distance(mask)
    # The outline lies at x = 11.5, between the centres 11 and 12.
    np.testing.assert_allclose(distance[10], np.arange(30) - 11.5, atol=1e-5)
    np.testing.assert_allclose(signed_distance(1.0 - mask), -distance, atol=1e-5)


def test_signed_distance_does_not_stop_at_the_pictures_edge() -> None:
    mask = np.zeros((20, 30), np.float32)
    mask[5:, :] = 1.0
    assert signed_distance(mask)[19, 0] == pytest.approx(14.5, abs=1e-4)


@pytest.mark.parametrize(("value", "sign"), [(0.0, -1.0), (1.0, 1.0)])
def test_signed_distance_without_an_outline(value: float, sign: float) -> None:
    distance = signed_distance(np.full((6, 8), value, np.float32))
    np.testing.assert_array_equal(distance, sign * 14.0)


def test_samples_are_bilinear_about_pixel_centres() -> None:
    image = np.add.outer(10.0 * np.arange(5), np.arange(7)).astype(np.float32)
    points = np.array([[2.0, 3.0], [2.5, 3.0], [2.25, 1.5], [-3.0, 0.0], [9.0, 9.0]])
    np.testing.assert_allclose(sample(image, points), [32.0, 32.5, 17.25, 0.0, 46.0], atol=1e-5)
    assert sample(image, np.zeros((0, 2))).shape == (0,)


@pytest.mark.parametrize("cut", [False, True])
def test_the_compiled_comparison_agrees_with_numpy(cut: bool) -> None:
    rng = np.random.default_rng(5)
    mask, rendered, usable = rng.random((3, 20, 30)).astype(np.float32)
    rendered *= np.add.outer(np.arange(20) % 19 > 2, np.zeros(30)) * (np.arange(30) > 6)
    assert covered_box(rendered) == (3, 18, 7, 29)
    assert covered_box(np.zeros((4, 5), np.float32)) == (4, -1, 5, -1)
    window = (slice(2, 19), slice(4, 30))
    shown = (rendered > 0.5).astype(np.float32) if cut else rendered
    for weight in (usable, np.zeros((0, 0), np.float32)):
        difference = np.full((17, 26), np.nan, np.float32)
        found = compare(mask, rendered, weight, 2, 4, cut, difference)
        expected = (mask - shown) * (weight if weight.size else 1.0)
        np.testing.assert_allclose(difference, expected[window], atol=1e-6)
        areas = [
            np.square(expected[window]).sum(),
            np.minimum(mask, shown)[window].sum(),
            shown[window].sum(),
            mask[window].sum(),
        ]
        np.testing.assert_allclose(found, areas, rtol=1e-5)


def look(reduction: int, shift_px: float = 0.0, ignore: np.ndarray | None = None):
    """Evidence of a simulated view whose mask lies ``shift_px`` beside the rendered arm."""
    view = scene(3)
    camera = view.camera
    T = view.Ts_cam_link[0]
    mask = np.roll(observe(view)[0].mask, int(shift_px), axis=1)
    renderer = SilhouetteRenderer(view.robot.meshes, camera.scaled(1.0 / reduction))
    return gather(
        renderer, reduction, MaskPyramid(mask, ignore), T, np.array([0.0, 0.0, 1.2]),
        smoothing_px=1.5, spacing=1.0,
    )  # fmt: skip


@pytest.mark.parametrize("reduction", [1, 2, 4])
def test_nothing_is_wrong_with_the_truth(reduction: int) -> None:
    """Masks made by another renderer, at every size: no half pixel is lost on the way."""
    evidence = look(reduction)
    assert len(evidence.residuals) > 100
    assert abs(evidence.residuals.mean()) < 0.05
    assert abs(evidence.distances.mean()) < 0.1
    for axis in (0, 1):  # a shift of the whole picture
        along = evidence.contour.normals[:, axis]
        assert abs(along @ evidence.residuals / (along @ along)) < 0.04
    assert evidence.iou > 0.95


@pytest.mark.parametrize("shift", [-1.0, 1.0])
def test_residuals_are_pixels_of_outward_displacement(shift: float) -> None:
    evidence = look(1, shift)
    expected = shift * evidence.contour.normals[:, 0]
    upright = np.abs(evidence.contour.normals[:, 0]) > 0.8
    assert np.median(evidence.residuals[upright] / expected[upright]) == pytest.approx(1, abs=0.2)
    far = look(1, 8 * shift)
    upright = np.abs(far.contour.normals[:, 0]) > 0.95
    ratio = far.distances[upright] / (8 * shift * far.contour.normals[upright, 0])
    assert np.median(ratio) == pytest.approx(1, abs=0.15)  # it does not saturate


def test_nothing_is_read_where_the_mask_is_to_be_ignored() -> None:
    whole = look(1)
    ignore = np.zeros(observe(scene(3))[0].mask.shape, bool)
    x = int(np.median(whole.points[:, 0]))
    ignore[:, :x] = True
    kept = look(1, ignore=ignore)
    assert 0 < len(kept.points) < len(whole.points)
    assert kept.points[:, 0].min() > x
    assert len(kept.points) == len(kept.residuals) == len(kept.jacobians) == len(kept.contour)
    assert kept.mismatch < whole.mismatch
