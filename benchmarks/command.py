"""How long the whole command takes, cold and warm, and how much memory."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from easyhecpp.bench.table import Table

SHARED = Path(os.environ.get("EASYHECPP_SHARED", Path(__file__).resolve().parents[2] / "shared"))
CAPTURES = ("xarm7_realsense", "lbr_med7_realsense")


@dataclass(frozen=True)
class _Run:
    seconds: float
    megabytes: float


def run(repeats: int) -> Table:
    """Time ``easyhecpp info --help``, and ``easyhecpp calibrate`` on the real captures.

    Cold is the very first run: no compiled kernels anywhere.
    """
    rows: list[tuple[str, str, float, float, int]] = []
    with tempfile.TemporaryDirectory() as folder:
        cache = Path(folder) / "cache"
        rows.append(_row("easyhecpp --help", "warm", [_help(cache) for _ in range(repeats)]))
        for name in CAPTURES:
            capture = SHARED / "captures" / name
            if not capture.is_dir():
                continue
            command = f"easyhecpp calibrate {name}"
            own = Path(folder) / f"cache-{name}"
            rows.append(_row(command, "cold", [_calibrate(capture, own, folder)]))
            warm = [_calibrate(capture, own, folder) for _ in range(repeats)]
            rows.append(_row(command, "warm", warm))
    return Table(
        title="The whole command, masks given",
        columns=("command", "start", "s median", "peak memory, MB", "runs"),
        rows=tuple(rows),
        notes=(
            "Cold: no compiled kernels and no simplified meshes are on the disk yet. From starting "
            "Python to the last file written.",
        ),
    )


def _row(command: str, start: str, runs: list[_Run]) -> tuple[str, str, float, float, int]:
    seconds = float(np.median([r.seconds for r in runs]))
    return command, start, seconds, max(r.megabytes for r in runs), len(runs)


def _help(cache: Path) -> _Run:
    return _timed(["--help"], cache)


def _calibrate(capture: Path, cache: Path, folder: str) -> _Run:
    out = Path(folder) / "results"
    return _timed(
        ["calibrate", str(capture), "--segmenter", "given", "--quiet", "--out", str(out)], cache
    )


def _timed(words: list[str], cache: Path) -> _Run:
    environment = {
        **os.environ, "NUMBA_CACHE_DIR": str(cache / "numba"), "XDG_CACHE_HOME": str(cache),
    }  # fmt: skip
    start = time.perf_counter()
    process = subprocess.Popen(
        [sys.executable, "-m", "easyhecpp", *words], env=environment, stdout=subprocess.DEVNULL
    )
    _, status, usage = os.wait4(process.pid, 0)
    seconds = time.perf_counter() - start
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode not in (0, 3):
        raise SystemExit(f"easyhecpp {' '.join(words)} ended with {process.returncode}")
    per_megabyte = 2**20 if sys.platform == "darwin" else 2**10
    return _Run(seconds, usage.ru_maxrss / per_megabyte)
