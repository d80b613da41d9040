"""Two real captures from images alone, without masks and weights, against their given masks."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from recordings import CAPTURES, SAME_DEGREES, SAME_METRES, turned

from easyhecpp.bench.metrics import chi_square
from easyhecpp.capture import Capture
from easyhecpp.geometry import pose_error
from easyhecpp.session import Calibration, CalibrationConfig, calibrate

pytestmark = pytest.mark.acceptance

THREE_SIGMA = 20.1
"""Chi-square of six unknowns that as few poses exceed as numbers lie beyond three deviations."""

SUBSETS, SUBSET_SIZE = 3, 6


@dataclass(frozen=True)
class Both:
    """A capture calibrated from its images, and from its given masks without the edge stage."""

    capture: Capture
    images: Calibration
    masks: Calibration


@pytest.fixture(scope="module", params=CAPTURES)
def both(request: pytest.FixtureRequest, shared: Path) -> Both:
    capture = Capture.load(shared / "captures" / request.param)
    return Both(
        capture,
        calibrate(capture, CalibrationConfig(segmenter="classical")),
        calibrate(capture, CalibrationConfig(segmenter="given", edges=False)),
    )


def test_images_and_masks_agree_within_their_error_bars(both: Both) -> None:
    assert both.images.result.verdict in ("ok", "doubtful"), both.images.result.reasons
    covariance = both.images.estimate.covariance + both.masks.estimate.covariance
    apart = chi_square(both.images.T_mount_cam, covariance, both.masks.T_mount_cam)
    assert apart <= THREE_SIGMA


def test_the_masks_made_are_the_given_ones(both: Both) -> None:
    overlaps = []
    for view in both.capture.views:
        if view.mask is not None:
            made = np.asarray(both.images.masks[view.id]) > 0.5
            overlaps.append(np.sum(made & view.mask) / np.sum(made | view.mask))
    assert np.mean(overlaps) >= 0.90


def test_six_views_find_the_camera_that_all_find(both: Both) -> None:
    rng = np.random.default_rng(7)
    for _ in range(SUBSETS):
        chosen = sorted(rng.choice(both.capture.view_ids, SUBSET_SIZE, replace=False))
        found = calibrate(both.capture.subset(chosen), CalibrationConfig(segmenter="classical"))
        metres, radians = pose_error(found.T_mount_cam, both.images.T_mount_cam)
        assert metres <= SAME_METRES, chosen
        assert np.degrees(radians) <= SAME_DEGREES, chosen


@pytest.mark.parametrize("quarters", [1, 2])
def test_a_camera_turned_about_its_axis_is_found_where_it_stands(both: Both, quarters: int) -> None:
    capture, turn = turned(both.capture, quarters)
    found = calibrate(capture, CalibrationConfig(segmenter="classical"))
    assert found.result.verdict == "ok", found.result.reasons
    metres, radians = pose_error(found.T_mount_cam, both.images.T_mount_cam @ turn)
    assert metres <= 0.002
    assert np.degrees(radians) <= 0.1
    masks = calibrate(capture, CalibrationConfig(segmenter="given", edges=False))
    metres, radians = pose_error(masks.T_mount_cam, both.masks.T_mount_cam @ turn)
    assert metres <= 0.003
    assert np.degrees(radians) <= 0.1
