"""Processes side by side, and rows that outlive an interrupted run."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from easyhecpp.bench import scenes_pool
from easyhecpp.bench.scenes_pool import RowFile, in_order, resumed
from easyhecpp.errors import CalibrationError, InputError


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


def kept(path: Path, settings: dict[str, Any]) -> dict[int, dict[str, Any]]:
    return RowFile(path, settings).rows(dict)


def test_a_process_that_the_system_ends_is_told_in_a_sentence():
    with pytest.raises(CalibrationError, match=r"ended a worker process.*fewer workers"):
        list(in_order(os._exit, [1, 1], 2))


def test_rows_are_found_again(tmp_path: Path):
    path = tmp_path / "deep" / "rows.jsonl"
    RowFile(path, {"seed": 1, "arms": ("a",)}).append({"scene": 0})
    again = RowFile(path, {"seed": 1, "arms": ("a",)})
    again.append({"scene": 1})
    assert kept(path, {"seed": 1, "arms": ["a"]}) == {0: {"scene": 0}, 1: {"scene": 1}}


def test_half_a_line_of_a_killed_run_is_dropped(tmp_path: Path):
    path = tmp_path / "rows.jsonl"
    RowFile(path, {"seed": 1}).append({"scene": 0})
    with path.open("a") as file:
        file.write('{"scene": 1, "verd')
    file = RowFile(path, {"seed": 1})
    assert file.rows(dict) == {0: {"scene": 0}}
    file.append({"scene": 1})
    assert kept(path, {"seed": 1}) == {0: {"scene": 0}, 1: {"scene": 1}}


@pytest.mark.parametrize("length", [0, 1, 5, 13, 20, -1])
def test_a_file_that_ends_in_its_first_line_is_a_new_one(tmp_path: Path, length: int):
    path = tmp_path / "rows.jsonl"
    RowFile(path, {"seed": 1})
    whole = path.read_bytes()
    assert whole.endswith(b"\n")
    path.write_bytes(whole[:length])
    RowFile(path, {"seed": 1}).append({"scene": 0})
    assert path.read_bytes().startswith(whole)
    assert kept(path, {"seed": 1}) == {0: {"scene": 0}}


def test_rows_of_other_settings_are_refused(tmp_path: Path):
    path = tmp_path / "rows.jsonl"
    RowFile(path, {"seed": 1, "views": 6}).append({"scene": 0})
    with pytest.raises(InputError, match="made with another seed") as caught:
        RowFile(path, {"seed": 2, "views": 6})
    assert "--out" in str(caught.value)


def test_rows_of_other_sources_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    path = tmp_path / "rows.jsonl"
    RowFile(path, {"seed": 1}).append({"scene": 0})
    monkeypatch.setattr(scenes_pool, "__version__", "9.9")
    with pytest.raises(
        InputError, match=r"other sources of easyhecpp: .*while this is version 9"
    ) as caught:
        RowFile(path, {"seed": 1})
    assert "Remove it to begin anew" in str(caught.value)
    path.write_text('{"settings": {"seed": 1}}\n{"scene": 0}\n')
    with pytest.raises(InputError, match="unknown ones"):
        RowFile(path, {"seed": 1})


@pytest.mark.parametrize(
    "content",
    [b"no rows\n", b"no rows", b"[1, 2]\n", b"{}\n", b'{"settings": 3}\n', b"\xff\xfe\n", b"\xff"],
)
def test_what_is_no_file_of_rows_is_refused_and_left_alone(tmp_path: Path, content: bytes):
    path = tmp_path / "rows.jsonl"
    path.write_bytes(content)
    with pytest.raises(InputError, match="The file is not a file of rows"):
        RowFile(path, {"seed": 1})
    assert path.read_bytes() == content


def test_a_folder_of_that_name_is_refused(tmp_path: Path):
    with pytest.raises(InputError, match="cannot be read: Is a directory"):
        RowFile(tmp_path, {"seed": 1})


@pytest.mark.parametrize(
    "line",
    [
        "[0, 1]",
        "3",
        '{"rows": []}',
        '{"scene": "0", "rows": []}',
        '{"scene": 0}',
        '{"scene": 0, "rows": 7}',
        '{"scene": 0, "rows": [7]}',
        '{"scene": 0, "rows": [{"scene": 0, "cube": 0}]}',
    ],
)
def test_rows_of_another_shape_are_refused(tmp_path: Path, line: str):
    path = tmp_path / "rows.jsonl"
    RowFile(path, {"seed": 1})
    with path.open("a") as file:
        file.write(line + "\n")
    with pytest.raises(InputError, match="holds rows of another shape"):
        resumed(lambda scene: (), lambda row: Squared(**row), 2, RowFile(path, {"seed": 1}))


def test_a_place_that_cannot_be_written_is_told_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    opened = Path.open

    def refuse(number: int) -> Callable[..., Any]:
        def open_(path: Path, mode: str = "r", **options: Any) -> Any:
            if "w" in mode:
                raise OSError(number, os.strerror(number))
            return opened(path, mode, **options)

        return open_

    monkeypatch.setattr(Path, "open", refuse(errno.EROFS))
    with pytest.raises(InputError, match=r"Read-only file system.*another place"):
        RowFile(tmp_path / "rows.jsonl", {"seed": 1})
    monkeypatch.setattr(Path, "open", refuse(errno.ENOSPC))
    with pytest.raises(InputError, match=r"No space left.*Free some space"):
        RowFile(tmp_path / "rows.jsonl", {"seed": 1})


def test_without_a_path_nothing_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    RowFile(None, {}).append({"scene": 3})
    assert list(tmp_path.iterdir()) == []


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
