"""Measures how long something takes."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Seconds:
    """What one call takes.

    Attributes:
        median: of the wall clock.
        p95: 95th percentile of it.
        cpu: median of the processor time of all threads; on a busy machine the better measure.
        calls: how many were measured.
    """

    median: float
    p95: float
    cpu: float
    calls: int


def measure(call: Callable[[int], object], *, budget_s: float, at_least: int = 3) -> Seconds:
    """Call ``call(0)`` unmeasured, then ``call(1)``, ``call(2)``, ... until the time is used up."""
    call(0)
    wall: list[float] = []
    cpu: list[float] = []
    while len(wall) < at_least or sum(wall) < budget_s:
        start, start_cpu = time.perf_counter(), time.process_time()
        call(len(wall) + 1)
        wall.append(time.perf_counter() - start)
        cpu.append(time.process_time() - start_cpu)
    return Seconds(
        float(np.median(wall)), float(np.percentile(wall, 95)), float(np.median(cpu)), len(wall)
    )
