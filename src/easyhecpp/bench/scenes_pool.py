"""Work on many scenes in several processes, and rows that outlive an interrupted run."""

from __future__ import annotations

import hashlib
import itertools
import json
import multiprocessing
import operator
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from pathlib import Path
from typing import Any, TypeVar

from easyhecpp import __version__
from easyhecpp._atomic import NO_ROOM
from easyhecpp._parallel import lost_processes_told
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

    Raises:
        CalibrationError: The system ended a process.
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
        pool = ProcessPoolExecutor(workers, context, _remember, (work,))
        with lost_processes_told(), pool:
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
    before = kept.rows(lambda entry: tuple(read(row) for row in entry["rows"]))
    rows = {scene: found for scene, found in before.items() if scene < n_scenes}
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

    The first line holds the settings and the sources that every row was made with. It is written at
    once: a place that cannot be written is told before the first scene.

    Args:
        path: The file; None keeps nothing.
        settings: What decides the rows, plain values.

    Raises:
        InputError: The file holds rows of other settings or of other sources, is none of ours, or
            cannot be written.
    """

    def __init__(self, path: Path | None, settings: Mapping[str, Any]) -> None:
        self._path = path
        self._head = json.loads(json.dumps({"settings": settings, "made_by": _made_by()}))
        self._entries: list[dict[str, Any]] = []
        if path is not None:
            self._open(path)

    def rows(self, read: Callable[[dict[str, Any]], Row]) -> dict[int, Row]:
        """What the file held, by scene.

        Args:
            read: Makes a row from what was kept of a scene.

        Raises:
            InputError: Something else was kept.
        """
        found: dict[int, Row] = {}
        try:
            for entry in self._entries:
                found[operator.index(entry["scene"])] = read(dict(entry))
        except (TypeError, KeyError, ValueError, AttributeError) as error:
            raise self._refused("holds rows of another shape") from error
        return found

    def append(self, row: Mapping[str, Any]) -> None:
        """Keep a row, on the disk too.

        Raises:
            InputError: The file cannot be written.
        """
        self._write(row)

    def _open(self, path: Path) -> None:
        try:
            text = path.read_bytes().decode()
        except FileNotFoundError:
            text = ""
        except UnicodeDecodeError as error:
            raise self._refused("is not a file of rows") from error
        except OSError as error:
            raise self._refused(f"cannot be read: {error.strerror}") from error
        # A run that was killed in the middle of a line leaves half of it behind.
        whole, newline, half = text.rpartition("\n")
        if not newline and _BEGINNING.startswith(half[: len(_BEGINNING)]):
            self._write(self._head, mode="w")
            return
        self._entries = self._checked(whole)
        self._write(mode="a")
        if half:
            os.truncate(path, len((whole + newline).encode()))

    def _checked(self, text: str) -> list[dict[str, Any]]:
        """The rows of a file whose first line is as it should be."""
        try:
            head, *rows = [json.loads(line) for line in text.splitlines()]
            settings, made_by = dict(head["settings"]), head.get("made_by")
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise self._refused("is not a file of rows") from error
        wanted = self._head["settings"]
        if settings != wanted:
            both = sorted({*settings, *wanted})
            other = [k for k in both if settings.get(k) != wanted.get(k)]
            raise self._refused(f"holds rows made with another {', '.join(other)}")
        if made_by != self._head["made_by"]:
            raise self._refused(
                f"holds rows made by other sources of easyhecpp: {_said(made_by)}, "
                f"while this is {_said(self._head['made_by'])}"
            )
        return rows

    def _write(self, *lines: Mapping[str, Any], mode: str = "a") -> None:
        if self._path is None:
            return
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            with self._path.open(mode, encoding="utf-8", newline="\n") as file:
                file.writelines(json.dumps(line) + "\n" for line in lines)
        except OSError as error:
            full = error.errno in NO_ROOM
            raise InputError(
                f"Rows cannot be written: {error.strerror}",
                where=self._path,
                fix="Free some space, then repeat the command: finished scenes are kept"
                if full
                else "Mend this, or write to another place with --out",
            ) from error

    def _refused(self, why: str) -> InputError:
        return InputError(
            f"The file {why}",
            where=self._path,
            expected="rows of an interrupted run with the same settings and the same sources",
            fix="Remove it to begin anew, or write to another place with --out",
        )


_BEGINNING = '{"settings": '


def _made_by() -> dict[str, str]:
    """Version and digest of the package's sources: other code may make other rows."""
    root = Path(__file__).parents[1]
    digest = hashlib.sha256()
    for source in sorted(root.rglob("*.py")):
        digest.update(f"{source.relative_to(root).as_posix()}\n".encode() + source.read_bytes())
    return {"version": __version__, "sources": digest.hexdigest()[:12]}


def _said(made_by: object) -> str:
    if not isinstance(made_by, dict):
        return "unknown ones"
    return f"version {made_by.get('version')}, digest {made_by.get('sources')}"
