"""The table of markers: a small real run, and what the table says of given rows."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from easyhecpp.baselines import SOLVERS
from easyhecpp.baselines.board_poses import BoardOnArm, BoardShots
from easyhecpp.bench import marker
from easyhecpp.bench.marker import (
    IDEAL,
    JUDGE,
    ORDINARY,
    OURS,
    MarkerBench,
    MarkerRow,
    marker_plot,
    marker_table,
    run_marker_bench,
)
from easyhecpp.errors import InputError

BENCH = MarkerBench(1, 4, poses=5, size=(960, 540))


@pytest.fixture(scope="module")
def rows() -> tuple[MarkerRow, ...]:
    return run_marker_bench(BENCH)


def test_every_solver_and_ours_find_the_camera(rows: tuple[MarkerRow, ...]) -> None:
    keys = [(row.method, row.quality) for row in rows]
    assert keys == [*((m, q) for q in (IDEAL, ORDINARY) for m in SOLVERS), (OURS, "")]
    for row in rows:
        assert row.error is not None, row.status
        assert row.error.is_right
        assert row.views == 5
    by_key = dict(zip(keys, rows, strict=True))
    # A bent board of the wrong size is worse than a perfect one, which is good to a millimetre.
    ideal, ordinary = (by_key[JUDGE, quality].position_mm for quality in (IDEAL, ORDINARY))
    assert ideal is not None
    assert ordinary is not None
    assert ideal < 1.5
    assert ideal < ordinary
    assert 0.0 < by_key[JUDGE, IDEAL].in_view < 0.3


def test_finished_scenes_are_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    done: list[int] = []

    def rows_of(bench: MarkerBench, scene: int) -> tuple[MarkerRow, ...]:
        done.append(scene)
        return (MarkerRow(scene, JUDGE, ORDINARY, 6, 1.0, 0.1, 0.01, 0.05, 7),)

    monkeypatch.setattr(marker, "marker_rows", rows_of)
    file = tmp_path / "marker.rows.jsonl"
    first = run_marker_bench(replace(BENCH, scenes=2), rows_file=file)
    told: list[int] = []
    both = run_marker_bench(
        replace(BENCH, scenes=3), rows_file=file, progress=lambda n, _: told.append(n)
    )
    assert done == [0, 1, 2]
    assert told == [3]
    assert both[:2] == first
    with pytest.raises(InputError, match="another seed"):
        run_marker_bench(replace(BENCH, seed=5), rows_file=file)


def some(scene: int, method: str, quality: str, mm: float | None) -> MarkerRow:
    row = MarkerRow(scene, method, quality, 20, in_view=0.04, pictures=22)
    if mm is None:
        return replace(row, views=7, status="the board was found in 7 of 20 joint poses")
    return replace(row, position_mm=mm, rotation_deg=mm / 10.0, seconds=0.1)


def test_rows_come_again_for_the_scenes_in_which_the_marker_is_right() -> None:
    rows = [
        some(0, JUDGE, IDEAL, 1.0),
        some(1, JUDGE, IDEAL, 3.0),
        some(0, JUDGE, ORDINARY, 5.0),
        some(1, JUDGE, ORDINARY, None),
        some(0, OURS, "", 0.5),
        some(1, OURS, "", 0.7),
    ]
    bench = MarkerBench(2, 4)
    table = marker_table(bench, rows)
    lines = {row[:3]: dict(zip(table.columns, row, strict=True)) for row in table.rows}
    name, ours = "Tsai-Lenz, 20 views", "ours, 5 random views"
    assert lines[name, IDEAL, "all"]["mm mean"] == pytest.approx(2.0)
    assert lines[name, ORDINARY, "all"]["failures"] == "1 of 2"
    assert lines[name, IDEAL, "marker right"]["mm mean"] == pytest.approx(1.0)
    assert lines[ours, "", "all"]["mm mean"] == pytest.approx(0.6)
    assert lines[ours, "", "marker right"]["mm mean"] == pytest.approx(0.5)
    published = lines["published marker, 20 views", "", "marker right"]
    assert (published["deg mean"], published["mm mean"]) == (0.870, 20.0)
    assert lines["published EasyHeC++, 5 views", "", "marker right"]["mm mean"] == 1.35
    text = table.to_markdown()
    assert "the 1 scenes in which Tsai-Lenz" in text
    assert "DREAM's weights are not available" in text
    assert "found in 67 of 88 pictures" in text
    assert marker_plot(bench, rows).axes[0].get_xlabel().endswith("mm")


def test_a_board_that_is_not_found_is_a_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    nothing = BoardShots(np.zeros((0, 7)), np.zeros((0, 4, 4)), np.zeros((0, 4, 4)), 0.01, 3)
    monkeypatch.setattr(BoardOnArm, "take_pictures", lambda *_, **__: nothing)
    *with_board, ours = run_marker_bench(MarkerBench(1, 4, size=(160, 90)))
    assert all(row.error is None for row in with_board)
    assert "found in 0 of 20 joint poses" in with_board[0].status
    assert with_board[0].pictures == 3
    assert ours.method == OURS


@pytest.mark.parametrize(
    ("bench", "words"),
    [
        (replace(BENCH, scenes=0), "scenes is 0"),
        (replace(BENCH, poses=2), "poses is 2"),
        (replace(BENCH, robot="marvin"), "xarm7"),
        (replace(BENCH, board="apriltag"), "chessboard, charuco"),  # type: ignore[arg-type]
    ],
)
def test_bad_input(bench: MarkerBench, words: str) -> None:
    with pytest.raises(InputError, match=words):
        run_marker_bench(bench)
