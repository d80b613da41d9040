"""Progress of long work, and the seconds that each stage took."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

Progress = Callable[[str], None]
"""Called with a short sentence when a stage begins."""


def silent(message: str) -> None:
    """A `Progress` that says nothing."""


class Stages:
    """Names the stages of a run to the user and keeps their times."""

    def __init__(self, progress: Progress | None) -> None:
        self._say = progress or silent
        self.timings_s: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str, message: str) -> Iterator[None]:
        """Announce ``message`` and add the time spent inside to ``timings_s[name]``."""
        self._say(message)
        start = time.perf_counter()
        try:
            yield
        finally:
            spent = time.perf_counter() - start
            self.timings_s[name] = self.timings_s.get(name, 0.0) + spent
