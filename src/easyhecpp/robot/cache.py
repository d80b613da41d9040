"""A folder of arrays that are dear to compute and may be lost at any time.

Whatever goes wrong with it (no home, a full disk, a damaged file) only costs time.
"""

from __future__ import annotations

import contextlib
import os
import zipfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from easyhecpp._atomic import atomic_path
from easyhecpp.errors import InputError

_MAX_BYTES = 256 * 2**20


def cache_folder() -> Path:
    """`easyhecpp/meshes` in XDG_CACHE_HOME, by default in `~/.cache`."""
    base = os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    return Path(base).expanduser() / "easyhecpp" / "meshes"


def load_arrays(key: str) -> dict[str, np.ndarray] | None:
    """The arrays stored under a key (a file name without suffix), None if there are none."""
    try:
        with np.load(cache_folder() / f"{key}.npz", allow_pickle=False) as stored:
            return dict(stored)
    except (OSError, RuntimeError, ValueError, EOFError, KeyError, zipfile.BadZipFile):
        return None


def store_arrays(key: str, arrays: Mapping[str, ArrayLike]) -> None:
    """Store arrays under a key; the oldest entries make room."""
    with contextlib.suppress(OSError, RuntimeError, InputError):
        folder = cache_folder()
        with atomic_path(folder / f"{key}.npz") as path:
            np.savez(path, allow_pickle=False, **arrays)
        _prune(folder)


def _prune(folder: Path) -> None:
    entries = [(entry.stat(), entry) for entry in folder.glob("*.npz")]
    total = 0
    for stat, entry in sorted(entries, key=lambda item: -item[0].st_mtime_ns):
        total += stat.st_size
        if total > _MAX_BYTES:
            entry.unlink(missing_ok=True)
