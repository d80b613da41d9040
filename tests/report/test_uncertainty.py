from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from report_case import result_of, solved
from scipy.stats import chi2

from easyhecpp.formats.result_file import ResultFile
from easyhecpp.report.plots import ellipsoid_panels
from easyhecpp.report.scene import scene_svg
from easyhecpp.report.uncertainty import SIGMAS_95, Uncertainty


def with_covariance(diagonal: tuple[float, ...]) -> ResultFile:
    case = solved()
    assert case.estimate is not None
    return result_of(case.capture, case.estimate, covariance=np.diag(np.square(diagonal)))


def test_the_ellipsoid_holds_95_percent():
    assert chi2.cdf(SIGMAS_95**2, 3) == pytest.approx(0.95, abs=1e-4)


def test_both_positions_agree_with_the_sigmas_of_the_result():
    result = solved().result
    found = Uncertainty.of(result)
    assert found is not None
    assert found.workspace is not None
    assert result.sigma is not None
    assert 1e3 * np.sqrt(np.trace(found.camera)) == pytest.approx(result.sigma.position_mm)
    assert 1e3 * np.sqrt(np.trace(found.workspace)) == pytest.approx(result.sigma.workspace_mm)


@pytest.mark.parametrize(
    ("diagonal", "words"),
    [
        ((3e-3, 1e-3, 1e-3), "sideways"),
        ((1e-3, 3e-3, 1e-3), "up and down"),
        ((1e-3, 1e-3, 3e-3), "along the viewing direction"),
    ],
)
def test_the_longest_axis_is_named(diagonal, words):
    found = Uncertainty.of(with_covariance((*diagonal, 1e-4, 1e-4, 1e-4)))
    assert found is not None
    assert found.longest_direction() == words
    np.testing.assert_allclose(found.half_axes_mm(), SIGMAS_95 * np.array([3.0, 1.0, 1.0]))


def test_a_slanted_axis_is_not_called_straight():
    slant = np.array([1.0, 0.0, 1.0])
    found = Uncertainty(np.eye(3) + 9 * np.outer(slant, slant), None, None)
    assert "slant" in found.longest_direction()


def test_without_a_covariance_there_is_nothing_to_show():
    assert Uncertainty.of(solved().result.model_copy(update={"covariance": None})) is None


def test_the_panels_draw_the_ellipsoid_to_scale():
    found = Uncertainty(np.diag(np.square([2e-3, 1e-3, 0.5e-3])), None, None)
    svg = ellipsoid_panels(found)
    step = float(re.search(r"one square = ([\d.]+) mm", svg).group(1))
    grid = [float(x) for x in re.findall(r'd="M([\d.]+) 0V176', svg)]
    px_per_mm = (grid[1] - grid[0]) / step
    radii = [[float(a), float(b)] for a, b in re.findall(r'rx="([\d.]+)" ry="([\d.]+)"', svg)]
    expected = SIGMAS_95 * np.array([[2.0, 1.0], [2.0, 0.5], [1.0, 0.5]]) * px_per_mm
    np.testing.assert_allclose(radii, expected, atol=0.2)
    # Seen from above forward is up, from the side it is right: the first is wide, the third tall.
    angles = [float(a) % 180 for a in re.findall(r"rotate\(([-\d.]+)\)", svg)]
    assert angles == pytest.approx([0, 0, 90], abs=0.1)


def test_the_scene_enlarges_by_a_round_factor_and_says_so():
    case = solved()
    joints = case.capture.views[0].joints
    for sigma in (1e-5, 1e-3):
        svg, note = scene_svg(
            case.capture, joints, case.T_base_cam, np.diag([sigma**2, sigma**2, sigma**2])
        )
        factor = float(re.search(r"([\d,]+) times enlarged", note).group(1).replace(",", ""))
        assert factor in {f * 10**k for f in (1, 2, 5) for k in range(6)}
        assert "<ellipse" in svg
    plain, note = scene_svg(case.capture, joints, case.T_base_cam)
    assert "<ellipse" not in plain
    assert "enlarged" not in note


def test_the_scene_of_a_camera_on_the_wrist_is_drawn_in_the_wrist():
    case = solved()
    capture = replace(case.capture, setup="eye-in-hand", ee_link="hand")
    svg, _ = scene_svg(capture, capture.views[0].joints, np.eye(4))
    assert ">hand</text>" in svg
    assert ">base</text>" in svg
    assert "nan" not in svg
