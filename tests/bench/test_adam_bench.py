"""Ours against Adam: a small real run, and what the table says of given rows."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from easyhecpp.bench import adam
from easyhecpp.bench.adam import (
    BEST,
    LAST,
    OURS,
    AdamBench,
    AdamRow,
    adam_rows,
    run_adam_bench,
)
from easyhecpp.bench.adam_table import adam_plot, adam_table
from easyhecpp.errors import InputError
from easyhecpp.geometry import inverse, pose_error, transform_points

pytest.importorskip("torch", reason="the extra 'models' is not installed")

BENCH = AdamBench(1, 4, views=2, steps=300, size=(256, 144))


@pytest.fixture(scope="module")
def rows() -> tuple[AdamRow, ...]:
    return run_adam_bench(BENCH)


def test_both_find_the_camera_from_the_same_start(rows: tuple[AdamRow, ...]) -> None:
    assert [row.method for row in rows] == [OURS, LAST, BEST]
    for row in rows:
        assert row.error is not None
        # Two masks of 256x144 at an IoU of 0.982: a pixel is 7 mm of the arm.
        assert row.error.position_mm < 40.0
    last = rows[1]
    assert last.seconds == last.curve_s[-1]
    assert last.position_mm == last.curve_mm[-1]
    assert last.curve_mm[0] > 20.0
    if last.reached_s is not None:
        assert 0.0 < last.reached_s <= last.seconds
    assert last.step_ms is not None
    assert last.bare_ms is not None
    assert last.step_ms > 0.0 < last.bare_ms


def test_the_start_is_as_far_off_as_pvnet() -> None:
    for scene in range(2):
        stage = adam._stage(BENCH, scene)
        start = adam._start(stage, np.random.default_rng(scene))
        assert np.rad2deg(pose_error(start, stage.T_mount_cam)[1]) == pytest.approx(3.94)
        joints = np.stack([o.joints for o in stage.observations])
        middle = stage.rig.robot.centre(joints).mean(axis=0)
        before, after = (transform_points(inverse(T), middle) for T in (stage.T_mount_cam, start))
        assert np.linalg.norm(after - before) == pytest.approx(0.024, rel=2e-3)


def test_a_scene_can_be_repeated_alone(rows: tuple[AdamRow, ...]) -> None:
    few = replace(BENCH, steps=3)
    one, two = (adam_rows(few, 0) for _ in range(2))
    assert [row.position_mm for row in one] == [row.position_mm for row in two]
    assert one[0].position_mm == rows[0].position_mm


def test_adam_as_published_is_another_adam_and_says_so(rows: tuple[AdamRow, ...]) -> None:
    few = replace(BENCH, steps=3)
    published = replace(few, combine="sum", half_pixel=True)
    ours, *_ = adam_rows(published, 0)
    assert ours.position_mm == rows[0].position_mm
    assert published.config.combine == "sum"
    assert published.config.half_pixel_bias
    ends = {
        adam_rows(bench, 0)[1].position_mm
        for bench in (few, replace(few, combine="sum"), replace(few, half_pixel=True), published)
    }
    assert len(ends) == 4
    told, plain = (" ".join(adam_table(bench, rows).notes) for bench in (published, few))
    assert "min(1, sum) of the links' silhouettes" in told
    assert "exact union" not in told
    assert "with the published half pixel" in told
    assert "its exact union of the links" in plain
    assert "without the published half pixel" in plain


def given(scene: int, ours_mm: float, adam_mm: float, reached_s: float | None) -> list[AdamRow]:
    return [
        AdamRow(scene, OURS, ours_mm, 0.01, 0.5),
        AdamRow(scene, LAST, adam_mm, 0.02, 20.0, reached_s, 13.0, 10.0, (1.0, 20.0), (9.0, 1.0)),
        AdamRow(scene, BEST, adam_mm, 0.02, 20.0),
    ]


def test_the_table_says_when_adam_was_as_good_and_what_a_step_costs() -> None:
    bench = AdamBench(2, 4)
    rows = [*given(0, 0.8, 1.2, None), *given(1, 0.6, 1.0, 4.0)]
    table = adam_table(bench, rows)
    lines = {row[0]: dict(zip(table.columns, row, strict=True)) for row in table.rows}
    assert lines[OURS]["mm mean"] == pytest.approx(0.7)
    assert lines[LAST]["mm mean"] == pytest.approx(1.1)
    assert lines[LAST]["times ours"] == pytest.approx(40.0)
    assert lines[LAST]["reaches our error"] == "1 of 2"
    assert lines[LAST]["after s"] == pytest.approx(4.0)
    assert "13.0 ms, 1.30 times a bare forward and backward pass (10.0 ms)" in table.to_markdown()
    assert len(adam_plot(bench, rows).axes) == 1


def test_finished_scenes_are_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    done: list[int] = []

    def rows_of(bench: AdamBench, scene: int) -> tuple[AdamRow, ...]:
        done.append(scene)
        return tuple(given(scene, 0.5, 1.0, None))

    monkeypatch.setattr(adam, "adam_rows", rows_of)
    file = tmp_path / "adam.rows.jsonl"
    first = run_adam_bench(replace(BENCH, scenes=1), rows_file=file)
    both = run_adam_bench(replace(BENCH, scenes=2), rows_file=file)
    assert done == [0, 1]
    assert [row.curve_mm for row in both[:3]] == [row.curve_mm for row in first]


@pytest.mark.parametrize("name", ["scenes", "views", "steps"])
def test_bad_input(name: str) -> None:
    with pytest.raises(InputError, match=f"{name} is 0"):
        run_adam_bench(replace(BENCH, **{name: 0}))
    with pytest.raises(InputError, match="xarm7"):
        run_adam_bench(replace(BENCH, robot="marvin"))
