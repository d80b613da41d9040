"""What is wrong with a capture: one record per finding, collected rather than thrown."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Literal

from easyhecpp.errors import InputError

Severity = Literal["error", "warning", "note"]
Part = Literal["view", "mask", "depth"]

#: How many errors one exception spells out; the rest is counted.
MAX_JOINED = 10


@dataclass(frozen=True)
class Problem:
    """One finding about a capture folder.

    Attributes:
        severity: `error` stops a calibration, `warning` deserves a look, `note` says what was
            assumed.
        what: What is wrong, in a sentence.
        where: File, row or view it concerns.
        fix: What to do about it.
        expected: What would have been right.
        views: Ids of the views, when the finding concerns some and not the capture as a whole.
        drops: For an error of some views, what must be left out of them to go on.
    """

    severity: Severity
    what: str
    where: str | None = None
    fix: str | None = None
    expected: str | None = None
    views: tuple[str, ...] = ()
    drops: Part | None = None

    @staticmethod
    def from_error(
        error: InputError, *, views: tuple[str, ...] = (), drops: Part | None = None
    ) -> Problem:
        """The same finding as an `InputError` that a reader raised."""
        return Problem("error", error.what, error.where, error.fix, error.expected, views, drops)

    def to_error(self) -> InputError:
        """The finding as an exception."""
        return InputError(self.what, where=self.where, expected=self.expected, fix=self.fix)

    def __str__(self) -> str:
        return str(self.to_error())


class Findings:
    """A list of problems that readers add to while they go on."""

    def __init__(self) -> None:
        self._problems: list[Problem] = []

    def __iter__(self) -> Iterator[Problem]:
        return iter(self._problems)

    def add(self, problem: Problem) -> None:
        """Record a finding once; saying it again changes nothing."""
        if problem not in self._problems:
            self._problems.append(problem)

    def error(
        self,
        what: str,
        *,
        where: str | None = None,
        expected: str | None = None,
        fix: str | None = None,
        views: tuple[str, ...] = (),
        drops: Part | None = None,
    ) -> None:
        """Record something that stops a calibration."""
        self.add(Problem("error", what, where, fix, expected, views, drops))

    def warn(
        self,
        what: str,
        *,
        where: str | None = None,
        fix: str | None = None,
        views: tuple[str, ...] = (),
    ) -> None:
        """Record something that deserves a look."""
        self.add(Problem("warning", what, where, fix, None, views))

    def note(self, what: str, *, where: str | None = None, fix: str | None = None) -> None:
        """Record what was assumed or left out."""
        self.add(Problem("note", what, where, fix))

    def catching(self, *, views: tuple[str, ...] = (), drops: Part | None = None) -> _Catching:
        """A context that turns an `InputError` raised inside it into a recorded error."""
        return _Catching(self, views, drops)

    @property
    def errors(self) -> list[Problem]:
        """The findings that stop a calibration, in the order they were found."""
        return [problem for problem in self._problems if problem.severity == "error"]

    @property
    def remarks(self) -> tuple[str, ...]:
        """Warnings and notes as sentences."""
        return tuple(str(problem) for problem in self._problems if problem.severity != "error")

    def sorted(self) -> list[Problem]:
        """All findings, errors first, otherwise in the order they were found."""
        rank = {"error": 0, "warning": 1, "note": 2}
        return sorted(self._problems, key=lambda problem: rank[problem.severity])


class _Catching:
    def __init__(self, findings: Findings, views: tuple[str, ...], drops: Part | None) -> None:
        self._findings = findings
        self._views = views
        self._drops: Part | None = drops

    def __enter__(self) -> None:
        pass

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> bool:
        if not isinstance(error, InputError):
            return False
        self._findings.add(Problem.from_error(error, views=self._views, drops=self._drops))
        return True


def joined_error(problems: Sequence[Problem], folder: Path) -> InputError:
    """One exception for several findings: a single one as it is, more as a numbered list."""
    if len(problems) == 1:
        return problems[0].to_error()
    shown = [f"  {number}. {problem}" for number, problem in enumerate(problems[:MAX_JOINED], 1)]
    if len(problems) > MAX_JOINED:
        shown.append(f"  and {len(problems) - MAX_JOINED} more")
    # The folder stands in front of the list, where a reader looks first.
    return InputError(f"The capture {folder} has {len(problems)} problems:\n" + "\n".join(shown))
