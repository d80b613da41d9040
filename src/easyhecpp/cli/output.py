"""What commands say: results on standard output, progress and errors on standard error."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from easyhecpp.formats.result_file import ResultFile
    from easyhecpp.session.stages import Progress

FAILED = 3
"""Exit code of a calibration that failed."""


def say(text: str = "") -> None:
    """Print a line of the result."""
    sys.stdout.write(text + "\n")


def say_verdict(result: ResultFile, notes: Sequence[str]) -> None:
    """Print notes, the verdict and the reasons behind it."""
    for note in notes:
        say(f"note: {note}")
    say(f"verdict: {result.verdict}")
    for reason in result.reasons:
        say(f"  {reason}")


def say_json(value: Any) -> None:
    """Print a value as JSON."""
    say(json.dumps(value, indent=2, ensure_ascii=False, allow_nan=False))


def complain(text: str) -> None:
    """Print a line to standard error."""
    sys.stderr.write(text + "\n")


@contextmanager
def progress(quiet: bool) -> Iterator[Progress]:
    """A line on standard error that follows the work; nothing when ``quiet``.

    Off a terminal every stage is a line of its own, so that a log can be read later.
    """
    if quiet:
        yield lambda message: None
    elif not sys.stderr.isatty():
        yield complain
    else:
        from rich.console import Console

        with Console(stderr=True).status("starting ...") as status:
            yield status.update
