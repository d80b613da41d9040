"""PCK as it is defined, and both ways to it."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from test_baxter_data import GOOD, recording

from easyhecpp.bench import baxter
from easyhecpp.bench.baxter import (
    BaxterBench,
    baxter_plot,
    baxter_table,
    run_baxter_recording,
    run_baxter_stand_in,
)
from easyhecpp.bench.baxter_data import CAMERA, arm_to_robot, tip_in_base
from easyhecpp.bench.pck import KeypointErrors
from easyhecpp.errors import CalibrationError, InputError
from easyhecpp.geometry import inverse, look_at, transform_points
from easyhecpp.sim.robots import load_robot


def test_thresholds_are_strict_and_areas_are_means():
    errors = KeypointErrors(np.array([0.0, 10.0, 19.9, 500.0]), np.array([0.0, 0.02, 0.05, 0.3]))
    assert errors.pck_2d([10, 20]) == [0.25, 0.75]
    assert errors.pck_3d([2, 5, 40]) == [0.25, 0.5, 1.0]
    # Whole thresholds above each error: 199, 189, 180, 0 of 200; 399, 379, 349, 99 of 400.
    assert errors.auc_2d == pytest.approx((199 + 189 + 180 + 0) / 4 / 200)
    assert errors.auc_3d == pytest.approx((399 + 379 + 349 + 99) / 4 / 400)


def test_pictures_without_a_pose_count_as_missed():
    errors = KeypointErrors.joined(
        [KeypointErrors(np.zeros(1), np.zeros(1)), KeypointErrors.missing(3)]
    )
    assert errors.pck_2d([150]) == [0.25]
    assert errors.auc_3d < 0.26


def test_the_recording_with_the_true_pose_has_no_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    robot = load_robot("baxter")
    T_base_cam = look_at(np.array([2.0, 0.2, 0.5]), np.array([0.4, 0.4, 0.2]))
    content = {}
    for name, entry in GOOD.items():
        tip = tip_in_base(robot, arm_to_robot(robot, np.array(entry["joints"])))
        ee_cam = transform_points(inverse(T_base_cam), tip)
        content[name] = {**entry, "ee_3d": ee_cam, "ee_2d": CAMERA.project(ee_cam) + [0.0, 15.0]}

    def calibrate(capture: object, config: object) -> SimpleNamespace:
        if len(capture.views) < 2:
            raise CalibrationError("one view is too few")
        return SimpleNamespace(T_mount_cam=T_base_cam)

    monkeypatch.setattr(baxter, "calibrate", calibrate)
    bench = run_baxter_recording(recording(tmp_path, content), "classical")
    assert bench.views[3].pck_2d([10, 20]) == [0.0, 1.0]  # measured 15 px beside
    assert bench.views[2].pck_3d([2]) == [1.0]
    assert len(bench.views[3].pixels) == 6  # two pictures of each joint pose
    assert bench.views[1].pck_2d([150]) == [0.0]
    assert "1 view: one view is too few" in bench.notes


def test_the_stand_in_runs():
    bench = run_baxter_stand_in(scenes=1, seed=61, size=(256, 192))
    assert len(bench.views[3].pixels) == 20
    assert bench.views[3].pck_2d([100]) == [1.0]


def test_the_table_and_the_plot():
    errors = KeypointErrors(np.array([5.0, 15.0]), np.array([0.01, 0.03]))
    bench = BaxterBench("a test", {1: errors, 2: errors, 3: errors})
    table = baxter_table(bench)
    lines = {row[0]: dict(zip(table.columns, row, strict=True)) for row in table.rows}
    assert lines["ours, 1 view"]["10 px"] == 0.5
    assert lines["ours, 3 views"]["5 cm"] == 1.0
    assert lines["published EasyHeC++, 3 views"]["20 px"] == 0.7
    assert lines["published EasyHeC, 2 views"]["5 cm"] == 0.8
    assert len(baxter_plot(bench).axes) == 2


@pytest.mark.parametrize(
    ("segmenter", "words"),
    [("scissors", "unknown segmenter 'scissors'"), ("given", "holds no masks")],
)
def test_a_segmenter_that_cannot_run_is_told_before_any_calibration(
    segmenter: str, words: str, tmp_path: Path
):
    with pytest.raises(InputError, match=words):
        run_baxter_recording(recording(tmp_path, GOOD), segmenter)


def test_bad_input():
    with pytest.raises(InputError, match="scenes is 0"):
        run_baxter_stand_in(scenes=0, seed=1)
