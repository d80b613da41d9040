"""Processes side by side, and rows that outlive an interrupted run."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import pytest

from easyhecpp.bench.scenes_pool import RowFile, in_order, resumed
from easyhecpp.errors import InputError


def test_one_worker_is_this_process():
    found = list(in_order(lambda job: (job, os.getpid()), range(3)))
    assert found == [(0, os.getpid()), (1, os.getpid()), (2, os.getpid())]


def test_processes_keep_the_order_and_are_renewed():
    found = list(in_order(partial(divmod, 17), [5, 4, 3, 2], 2, renew_after=1))
    assert found == [(3, 2), (4, 1), (5, 2), (8, 1)]
    assert list(in_order(partial(divmod, 17), [], 2)) == []


def test_an_error_in_a_process_arrives_here():
    with pytest.raises(ZeroDivisionError):
        list(in_order(partial(divmod, 17), [1, 0], 2))


def test_rows_are_found_again(tmp_path: Path):
    path = tmp_path / "deep" / "rows.jsonl"
    RowFile(path, {"seed": 1, "arms": ("a",)}).append({"scene": 0})
    again = RowFile(path, {"seed": 1, "arms": ("a",)})
    again.append({"scene": 1})
    assert RowFile(path, {"seed": 1, "arms": ["a"]}).rows == [{"scene": 0}, {"scene": 1}]


def test_half_a_line_of_a_killed_run_is_dropped(tmp_path: Path):
    path = tmp_path / "rows.jsonl"
    RowFile(path, {"seed": 1}).append({"scene": 0})
    with path.open("a") as file:
        file.write('{"scene": 1, "verd')
    file = RowFile(path, {"seed": 1})
    assert file.rows == [{"scene": 0}]
    file.append({"scene": 1})
    assert RowFile(path, {"seed": 1}).rows == [{"scene": 0}, {"scene": 1}]


def test_rows_of_other_settings_are_refused(tmp_path: Path):
    path = tmp_path / "rows.jsonl"
    RowFile(path, {"seed": 1, "views": 6}).append({"scene": 0})
    with pytest.raises(InputError, match="made with another seed") as caught:
        RowFile(path, {"seed": 2, "views": 6})
    assert "--out" in str(caught.value)
    path.write_text("no rows\n")
    with pytest.raises(InputError, match="is not a file of rows"):
        RowFile(path, {"seed": 1})


def test_without_a_path_nothing_is_written(tmp_path: Path):
    file = RowFile(None, {})
    file.append({"scene": 3})
    assert file.rows == [{"scene": 3}]
    assert json.dumps(list(tmp_path.iterdir())) == "[]"


@dataclass(frozen=True)
class Squared:
    scene: int
    value: int


def test_a_run_goes_on_where_it_was_interrupted(tmp_path: Path):
    path, made = tmp_path / "rows.jsonl", []

    def work(scene: int) -> list[Squared]:
        made.append(scene)
        if scene == 2 and made.count(2) == 1:
            raise KeyboardInterrupt
        return [Squared(scene, scene**2), Squared(scene, -(scene**2))]

    def run(n: int) -> tuple[Squared, ...]:
        return resumed(work, lambda row: Squared(**row), n, RowFile(path, {"seed": 1}))

    with pytest.raises(KeyboardInterrupt):
        run(4)
    assert run(4) == tuple(Squared(k, s * k**2) for k in range(4) for s in (1, -1))
    assert made == [0, 1, 2, 2, 3]
    assert run(2) == (Squared(0, 0), Squared(0, 0), Squared(1, 1), Squared(1, -1))
    assert made == [0, 1, 2, 2, 3], "fewer scenes are a part of the many"
