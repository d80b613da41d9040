"""First poses: two real scenes, small; and the sums."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from easyhecpp.bench import init
from easyhecpp.bench.init import InitBench, InitRow, init_plot, init_table, run_init_bench
from easyhecpp.bench.stages import MaskStage
from easyhecpp.errors import CalibrationError, InputError
from easyhecpp.sim.robots import load_robot

BENCH = InitBench(1, 3, views=3, size=(320, 180))


@pytest.fixture
def poses(monkeypatch: pytest.MonkeyPatch) -> np.ndarray:
    stage = MaskStage.random(load_robot("xarm7"), BENCH.size, [BENCH.seed, 0])
    poses = stage.poses.draw(3, np.random.default_rng(1))
    monkeypatch.setattr(init, "poses_for_any_camera", lambda *arguments: poses)
    return poses


def test_a_scene_is_solved_and_kept(poses: np.ndarray, tmp_path: Path):
    path = tmp_path / "rows.jsonl"
    rows = run_init_bench(BENCH, rows_file=path)
    assert [row.grid for row in rows] == ["sphere", "paper"]
    assert rows[0].error(refined=False).is_right
    assert rows[0].error(refined=True).is_right
    assert run_init_bench(BENCH, rows_file=path) == rows


def test_an_error_is_a_row(poses: np.ndarray, monkeypatch: pytest.MonkeyPatch):
    def lost(*arguments: object) -> None:
        raise CalibrationError("lost")

    monkeypatch.setattr(init, "_warm_up", lambda bench: None)
    monkeypatch.setattr(init, "sample_initial_pose", lost)
    (first, second) = init.init_rows(BENCH, poses, 0)
    assert (first.status, second.status) == ("lost", "lost")
    assert first.error(refined=True) is None


def test_the_table():
    rows = [
        InitRow(0, "sphere", 4.0, 0.2, 1.0, 2.0, 0.1, 0.5),
        InitRow(1, "sphere", 2.0, 0.4, 3.0, 1.0, 0.1, 0.5),
        InitRow(0, "paper", 400.0, 30.0, 1.0, 1.0, 0.1, 0.5),
        InitRow(1, "paper", status="lost"),
    ]
    table = init_table(BENCH, rows)
    lines = {row[0]: dict(zip(table.columns, row, strict=True)) for row in table.rows}
    assert lines["ours, sampling"]["mm mean"] == pytest.approx(3.0)
    assert lines["ours, sampling"]["time"] == "2.00 s"
    assert lines["ours, sampling, refined"]["mm mean"] == pytest.approx(1.5)
    assert lines["ours, sampling, refined"]["time"] == "2.50 s"
    assert lines["ours, the paper's grid"]["failures"] == "2 of 2"
    assert "Failed, scene 1, ours, the paper's grid: lost" in table.notes
    assert lines["published EasyHeC++ (sampling)"]["mm mean"] == 2.6
    assert lines["published EasyHeC (PVNet)"]["deg mean"] == 3.94
    assert len(init_plot(rows).axes) == 1


def test_bad_input():
    with pytest.raises(InputError, match="views is 0"):
        run_init_bench(InitBench(1, 1, views=0))
