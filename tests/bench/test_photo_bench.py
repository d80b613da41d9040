"""Counting, resuming and summing up; with stand-ins for the pictures and for the calibration."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from easyhecpp.bench import photo
from easyhecpp.bench.photo import PhotoBench, PhotoRow, photo_row
from easyhecpp.bench.photo_table import photo_plot, photo_table
from easyhecpp.errors import CalibrationError, InputError, MissingExtraError, NothingSuitsError
from easyhecpp.geometry import exp_se3

BENCH = PhotoBench(scenes=4, seed=5, arms=("xarm7", "panda"), views=3, size=(96, 64), samples=1)
TRUTH = exp_se3(np.array([0.4, 0.1, 0.9, 0.2, -0.1, 0.3]))


def right(scene: int, *, mm: float = 1.0, before: float = 2.0, verdict: str = "ok") -> PhotoRow:
    return PhotoRow(scene, "xarm7", verdict, 2.0, mm, 0.02, before, 0.05, 3.0)


@pytest.fixture
def stand_ins(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Scenes that are an empty folder with a truth, and calibrations off by a known error."""
    made: list[int] = []

    def make(root: Path, plan: object, scene: int) -> None:
        if scene == 3:
            raise NothingSuitsError("no camera sees the arm")
        made.append(scene)
        place = root / f"scene_{scene:04d}"
        place.mkdir(parents=True)
        (place / "truth.json").write_text(json.dumps({"T_base_cam": TRUTH.tolist()}))

    def calibrate(capture: object, config: object) -> SimpleNamespace:
        if made[-1] == 2:
            raise CalibrationError("nothing moved")
        after, before = (TRUTH @ exp_se3(np.array([mm / 1e3, 0, 0, 0, 0, 0])) for mm in (1, 3))
        return SimpleNamespace(
            T_mount_cam=after,
            estimate=SimpleNamespace(T_mount_cam=after),
            before_edges=SimpleNamespace(T_mount_cam=before),
            result=SimpleNamespace(verdict="ok", reasons=()),
            notes=(),
        )

    capture = SimpleNamespace(robot=SimpleNamespace(reach=2.0))
    monkeypatch.setattr(photo, "make_scene", make)
    monkeypatch.setattr(photo, "calibrate", calibrate)
    monkeypatch.setattr(photo.Capture, "load", lambda folder: capture)
    monkeypatch.setattr(photo, "in_order", lambda work, jobs, *rest, **more: map(work, jobs))
    monkeypatch.setattr(photo, "mitsuba", lambda: None)
    return made


def test_every_scene_counts_and_failures_keep_their_text(stand_ins: list[int], tmp_path: Path):
    rows = photo.run_photo_bench(BENCH, rows_file=tmp_path / "rows.jsonl")
    assert [row.scene for row in rows] == [0, 1, 2, 3]
    assert [row.arm for row in rows] == ["xarm7", "panda", "xarm7", "panda"]
    assert rows[0].position_mm == pytest.approx(1.0)
    assert rows[0].before_mm == pytest.approx(3.0)
    assert rows[2].reasons == ("CalibrationError: nothing moved",)
    assert rows[3].reasons == ("NothingSuitsError: no camera sees the arm.",)
    assert not rows[3].made


def test_what_concerns_all_scenes_ends_the_run(
    stand_ins: list[int], monkeypatch: pytest.MonkeyPatch
):
    for error in (InputError("the disk is full"), MissingExtraError("mitsuba", "sim", "It")):

        def refuse(*_: object, error: Exception = error) -> None:
            raise error

        monkeypatch.setattr(photo, "make_scene", refuse)
        with pytest.raises(type(error)):
            photo.run_photo_bench(BENCH)


def test_an_interrupted_run_goes_on(stand_ins: list[int], tmp_path: Path):
    path = tmp_path / "rows.jsonl"
    whole = photo.run_photo_bench(BENCH, rows_file=path)
    lines = path.read_text().splitlines(keepends=True)
    assert len(lines) == 4  # settings and three scenes; the one without pictures is tried again
    path.write_text("".join(lines[:2]))
    stand_ins.clear()
    again = photo.run_photo_bench(BENCH, rows_file=path)
    assert stand_ins == [1, 2]
    assert [(r.scene, r.verdict, r.position_mm) for r in again] == [
        (r.scene, r.verdict, r.position_mm) for r in whole
    ]


def test_the_data_set_is_kept_where_asked(stand_ins: list[int], tmp_path: Path):
    photo_row(BENCH, tmp_path, 0)
    assert (tmp_path / "scene_0000" / "truth.json").exists()


def test_the_plan_depends_on_the_scene_and_the_settings_not_on_their_number():
    assert BENCH.plan(1).robot == "panda"
    assert BENCH.plan(2) == PhotoBench(9, 5, BENCH.arms, 3, (96, 64), 1).plan(2)
    assert BENCH.plan(0).options.width, BENCH.plan(0).options.height == (96, 64)
    assert BENCH.plan(0).quality.samples == 1


def test_worse_by_edges_needs_a_tenth_and_a_tenth_of_a_millimetre():
    assert right(0, mm=2.3, before=2.0).worse_by_edges
    assert not right(0, mm=2.15, before=2.0).worse_by_edges  # under ten per cent
    assert not right(0, mm=0.28, before=0.2).worse_by_edges  # under a tenth of a millimetre
    assert right(0, mm=300.0, before=5.0).worse_by_edges
    assert not right(0, mm=900.0, before=500.0).worse_by_edges  # was wrong before
    assert not PhotoRow(0, "xarm7", "error").worse_by_edges


def test_the_table_sums_up():
    rows = [
        right(0),
        right(1, mm=3.0, before=2.0, verdict="doubtful"),
        right(2, mm=50.0, before=50.0),
        PhotoRow(3, "xarm7", "error", reasons=("CalibrationError: x",)),
    ]
    bench = PhotoBench(4, 5, ("xarm7",))
    table = photo_table(bench, rows)
    before, after = (dict(zip(table.columns, row, strict=True)) for row in table.rows)
    assert after["failures (95 % interval)"].startswith("2 of 4")
    assert after["mm per m of reach, mean"] == pytest.approx(1.0)  # (1 + 3) / 2 over 2 m
    assert after["median"] == pytest.approx((1.5 + 25.0) / 2)
    assert after["95 %"] == float("inf")
    assert before["mm per m of reach, mean"] == pytest.approx(1.0)
    assert after["ok / doubtful / failed / error"] == "2 / 1 / 0 / 1"
    assert after["worse by edges"] == 1
    assert "Wrong poses called ok: 1 (scenes 2)." in table.notes
    assert photo_plot(rows).axes[0].get_legend() is not None


@pytest.mark.parametrize(
    ("bench", "words"),
    [
        (PhotoBench(0, 1), "scenes is 0"),
        (PhotoBench(1, 1, arms=("hal9000",)), "no built-in robot called 'hal9000'"),
        (PhotoBench(1, 1, arms=()), "No arm is named"),
        (PhotoBench(1, 1, views=2), "views is 2.*3 or more"),
        (PhotoBench(1, 1, difficulty="mean"), "no difficulty 'mean'"),
    ],
)
def test_bad_input(bench: PhotoBench, words: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(photo, "mitsuba", lambda: None)
    with pytest.raises(InputError, match=words):
        photo.run_photo_bench(bench)
