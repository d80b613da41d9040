"""Work on many scenes in several processes, and rows that outlive an interrupted run."""

from __future__ import annotations

import itertools
import json
import multiprocessing
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from pathlib import Path
from typing import Any, TypeVar

from easyhecpp.errors import CalibrationError, InputError, NothingSuitsError

Job = TypeVar("Job")
Row = TypeVar("Row")

SCENE_FAILURES = (CalibrationError, NothingSuitsError)
"""What a scene may fail with and be counted; anything else concerns all scenes and ends the run."""


def in_order(
    work: Callable[[Job], Row],
    jobs: Sequence[Job],
    workers: int = 1,
    *,
    renew_after: int | None = None,
) -> Iterator[Row]:
    """``map(work, jobs)``, in order, in several processes.

    Args:
        work: A function at the top of a module or a `functools.partial` of one; it is sent to each
            process once, however large.
        jobs: Its arguments.
        workers: Processes side by side; with one, and without ``renew_after``, this very process.
        renew_after: Jobs of a process after which it is replaced, for work that leaves memory
            behind.
    """
    if not jobs:
        return
    if workers <= 1 and renew_after is None:
        yield from map(work, jobs)
        return
    workers = max(1, min(workers, len(jobs)))
    # Threads of compiled code do not survive a fork: start clean processes.
    context = multiprocessing.get_context("spawn")
    size = len(jobs) if renew_after is None else workers * renew_after
    waiting = iter(jobs)
    while batch := list(itertools.islice(waiting, size)):
        with ProcessPoolExecutor(workers, context, _remember, (work,)) as pool:
            try:
                yield from pool.map(_do_remembered, batch)
            finally:
                pool.shutdown(wait=False, cancel_futures=True)


_remembered: list[Callable[[Any], Any]] = []


def _remember(work: Callable[[Any], Any]) -> None:
    """In a worker: keep the work, so that a robot is sent once and its meshes simplified once."""
    _remembered[:] = [work]


def _do_remembered(job: Any) -> Any:
    return _remembered[0](job)


def resumed(
    work: Callable[[int], Sequence[Row]],
    read: Callable[[dict[str, Any]], Row],
    n_scenes: int,
    kept: RowFile,
    *,
    workers: int = 1,
    renew_after: int | None = None,
    progress: Callable[[int, tuple[Row, ...]], None] | None = None,
) -> tuple[Row, ...]:
    """The rows of scenes 0 to ``n_scenes``; those that a file holds are not made again.

    Args:
        work: Makes the rows of a scene, dataclasses; see `in_order`.
        read: A row from its plain values.
        n_scenes: How many scenes are wanted.
        kept: Holds the rows of earlier runs, and takes the new ones as they come.
        workers: Processes side by side.
        renew_after: Scenes of a process after which it is replaced.
        progress: Called with the number of finished scenes and the rows of the last.
    """
    rows: dict[int, tuple[Row, ...]] = {
        entry["scene"]: tuple(read(row) for row in entry["rows"])
        for entry in kept.rows
        if entry["scene"] < n_scenes
    }
    missing = [scene for scene in range(n_scenes) if scene not in rows]
    made = in_order(work, missing, workers, renew_after=renew_after)
    for scene, found in zip(missing, made, strict=True):
        rows[scene] = tuple(found)
        kept.append({"scene": scene, "rows": [asdict(row) for row in rows[scene]]})  # pyright: ignore[reportArgumentType]  # a dataclass
        if progress is not None:
            progress(len(rows), rows[scene])
    return tuple(row for scene in sorted(rows) for row in rows[scene])


class RowFile:
    """Rows of a long run as JSON lines, one for each scene, written as they come.

    The first line holds the settings that every row was made with.

    Args:
        path: The file; None keeps nothing.
        settings: What decides the rows, plain values.

    Raises:
        InputError: The file holds rows of other settings, or is none of ours.
    """

    def __init__(self, path: Path | None, settings: Mapping[str, Any]) -> None:
        self._path = path
        self._settings = json.loads(json.dumps(settings))
        self.rows: list[dict[str, Any]] = [] if path is None else self._read(path)

    def append(self, row: Mapping[str, Any]) -> None:
        """Keep a row, on the disk too.

        Raises:
            InputError: The file cannot be written.
        """
        self.rows.append(dict(row))
        if self._path is None:
            return
        lines = [json.dumps(row) + "\n"]
        if not self._path.exists():
            lines.insert(0, json.dumps({"settings": self._settings}) + "\n")
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            with self._path.open("a", encoding="utf-8") as file:
                file.writelines(lines)
        except OSError as error:
            raise InputError(
                f"Cannot write a row: {error.strerror}",
                where=self._path,
                fix="Free some space, then repeat the command: finished scenes are kept",
            ) from error

    def _read(self, path: Path) -> list[dict[str, Any]]:
        if not path.exists():
            return []
        # A run that was killed in the middle of a line leaves half of it behind.
        text = path.read_text(encoding="utf-8")
        whole, _, half = text.rpartition("\n")
        try:
            head, *rows = [json.loads(line) for line in whole.splitlines()]
            found = head["settings"]
        except (ValueError, KeyError, TypeError) as error:
            raise self._refused(path, "is not a file of rows") from error
        if found != self._settings:
            both = sorted({*found, *self._settings})
            other = [k for k in both if found.get(k) != self._settings.get(k)]
            raise self._refused(path, f"holds rows made with another {', '.join(other)}")
        if half:
            path.write_text(whole + "\n", encoding="utf-8")
        return rows

    def _refused(self, path: Path, why: str) -> InputError:
        return InputError(
            f"The file {why}",
            where=path,
            expected="rows of an interrupted run with the same settings",
            fix="Remove it, or write to another place with --out",
        )
