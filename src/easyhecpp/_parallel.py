"""Threads for work that releases the GIL (compiled kernels, OpenCV); processes that are lost."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from functools import cache
from typing import TypeVar

from threadpoolctl import ThreadpoolController

from easyhecpp.errors import CalibrationError

A = TypeVar("A")
B = TypeVar("B")


def usable_cores() -> int:
    """Number of CPU cores this process may use."""
    try:
        return max(1, len(os.sched_getaffinity(0)))
    except AttributeError:  # not on macOS and Windows
        return max(1, os.cpu_count() or 1)


@cache
def _pool(owner: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(max_workers=usable_cores(), thread_name_prefix="easyhecpp")


@cache
def _blas() -> ThreadpoolController:
    return ThreadpoolController()


def parallel_map(function: Callable[[A], B], items: Iterable[A]) -> list[B]:
    """``[function(i) for i in items]`` on all usable cores, in order; errors are raised here.

    Do not nest: an inner call could wait for threads that the outer one holds.
    """
    todo = list(items)
    if len(todo) < 2 or usable_cores() == 1:
        return [function(item) for item in todo]
    # Keyed by process: the threads of a pool do not survive a fork. BLAS keeps to one thread
    # meanwhile: its threads on top of ours would wait for each other.
    with _blas().limit(limits=1, user_api="blas"):
        return list(_pool(os.getpid()).map(function, todo))


@contextmanager
def lost_processes_told() -> Iterator[None]:
    """Say in a sentence that the system ended a process of a `ProcessPoolExecutor`.

    Raises:
        CalibrationError: It did.
    """
    try:
        yield
    except BrokenProcessPool as error:
        raise CalibrationError(
            "The system ended a worker process, most likely for want of memory. Repeat the command "
            "with fewer workers: finished scenes that were written are kept."
        ) from error
