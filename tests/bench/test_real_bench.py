"""Truth of poses and of pairs, with calibrations that are off by a known error."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from easyhecpp.bench import real
from easyhecpp.bench.real import real_plot, real_table, run_real_bench
from easyhecpp.errors import CalibrationError, InputError, MissingExtraError
from easyhecpp.geometry import exp_se3, inverse
from easyhecpp.session import CalibrationConfig

T_LEFT = exp_se3(np.array([0.5, 0.1, 0.8, 0.3, -0.2, 0.1]))
T_RIGHT = T_LEFT @ exp_se3(np.array([0.06, 0.0, 0.0, 0.0, 0.01, 0.0]))
POSES = {"left": T_LEFT, "right": T_RIGHT}


@pytest.fixture
def calibrated(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Captures are their names; calibrations are 2 mm off along the optical axis of the right."""
    done: list[str] = []

    def calibrate(name: str, config: Any) -> SimpleNamespace:
        done.append(name)
        if name not in POSES:
            raise CalibrationError("no arm in sight")
        off = exp_se3(np.array([0, 0, 0.002 if name == "right" else 0.0, 0, 0, 0]))
        return SimpleNamespace(
            T_mount_cam=POSES[name] @ off,
            estimate=SimpleNamespace(covariance=1e-6 * np.eye(6)),
            capture=SimpleNamespace(robot=SimpleNamespace(name="arm"), views=(1, 2, 3)),
            result=SimpleNamespace(verdict="doubtful" if name == "left" else "ok"),
        )

    monkeypatch.setattr(real, "calibrate", calibrate)
    monkeypatch.setattr(real.Capture, "load", lambda folder: folder.name)
    return done


def write_truth(folder: Path, content: dict[str, Any]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "truth.json").write_text(json.dumps(content))


def test_a_known_pose(calibrated: list[str], tmp_path: Path):
    write_truth(tmp_path / "right", {"T_base_cam": T_RIGHT.tolist()})
    (row,) = run_real_bench(tmp_path)
    assert (row.name, row.truth, row.verdict, row.views) == ("right", "pose", "ok", 3)
    assert row.error.position_mm == pytest.approx(2.0)
    assert row.sigma_mm == pytest.approx(np.sqrt(3.0))
    assert row.chi_square == pytest.approx(4.0)  # two standard deviations along one axis


def test_a_stereo_pair_calibrates_each_camera_once(calibrated: list[str], tmp_path: Path):
    T_left_right = inverse(T_LEFT) @ T_RIGHT
    write_truth(tmp_path / "left", {"T_base_cam": T_LEFT.tolist()})
    write_truth(
        tmp_path / "right", {"stereo": {"other": "../left", "T_other_cam": T_left_right.tolist()}}
    )
    left, right = run_real_bench(tmp_path)
    assert calibrated == ["left", "right"]
    assert left.error.position_mm == pytest.approx(0.0, abs=1e-6)
    assert right.truth == "stereo"
    assert right.error.position_mm == pytest.approx(2.0)
    assert right.verdict == "doubtful"  # the worse of the two
    assert right.sigma_mm == pytest.approx(np.sqrt(6.0))


def test_failures_are_rows(calibrated: list[str], tmp_path: Path):
    write_truth(tmp_path / "a" / "right", {"T_base_cam": T_RIGHT.tolist()})
    write_truth(tmp_path / "b", {"T_base_cam": T_RIGHT.tolist()})
    write_truth(tmp_path / "c", {"nothing": 1})
    rows = run_real_bench(tmp_path)
    assert [row.name for row in rows] == [str(Path("a") / "right"), "b", "c"]
    assert rows[1].status == "no arm in sight"
    assert "Names no pose" in rows[2].status
    table = real_table(tmp_path, rows)
    assert table.rows[-1][7] == "2 of 3 wrong"
    assert any("no arm in sight" in note for note in table.notes)
    assert len(real_plot(rows).axes) == 1


def test_one_capture_by_itself(calibrated: list[str], tmp_path: Path):
    write_truth(tmp_path / "left", {"T_mount_cam": {"matrix": T_LEFT.tolist()}})
    (row,) = run_real_bench(tmp_path / "left")
    assert row.name == "left"


def test_a_segmenter_that_cannot_run_is_told_before_the_first_recording(
    calibrated: list[str], tmp_path: Path
):
    write_truth(tmp_path / "right", {"T_base_cam": T_RIGHT.tolist()})
    with pytest.raises(InputError, match="unknown segmenter 'scissors'"):
        run_real_bench(tmp_path, CalibrationConfig(segmenter="scissors"))
    assert calibrated == []


def test_a_missing_package_is_no_failed_recording(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def missing(folder: Path) -> None:
        raise MissingExtraError("torch", "models", "It")

    monkeypatch.setattr(real.Capture, "load", missing)
    write_truth(tmp_path / "right", {"T_base_cam": T_RIGHT.tolist()})
    with pytest.raises(MissingExtraError):
        run_real_bench(tmp_path)


def test_nothing_to_measure(tmp_path: Path):
    with pytest.raises(InputError, match="No capture below this folder"):
        run_real_bench(tmp_path)
