"""A folder of arrays that are dear to compute and may be lost at any time.

Whatever goes wrong with it (no home, a full disk, a damaged file) only costs time.
"""

from __future__ import annotations

import contextlib
import os
import zipfile
from pathlib import Path

import numpy as np

from easyhecpp._atomic import atomic_path
from easyhecpp.errors import InputError

_MAX_FILES = 512


def cache_folder() -> Path:
    """`easyhecpp` in XDG_CACHE_HOME, by default in `~/.cache`."""
    base = os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    return Path(base).expanduser() / "easyhecpp" / "meshes"


def load_arrays(key: str) -> dict[str, np.ndarray] | None:
    """The arrays stored under a key (a file name without suffix), None if there are none."""
    try:
        with np.load(cache_folder() / f"{key}.npz", allow_pickle=False) as stored:
            return dict(stored)
    except (OSError, RuntimeError, ValueError, EOFError, zipfile.BadZipFile):
        return None


def store_arrays(key: str, **arrays: np.ndarray) -> None:
    """Store arrays under a key; the oldest entries make room."""
    with contextlib.suppress(OSError, RuntimeError, InputError):
        folder = cache_folder()
        with atomic_path(folder / f"{key}.npz") as path:
            np.savez(path, allow_pickle=False, **arrays)
        entries = sorted(folder.glob("*.npz"), key=lambda entry: entry.stat().st_mtime)
        for entry in entries[:-_MAX_FILES]:
            entry.unlink(missing_ok=True)
