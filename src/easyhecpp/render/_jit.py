"""One place that decides how numba compiles: cached on disk where that is possible, never failing.

numba raises at import time when no folder for its cache can be written (read-only site-packages
and no writable home, as in many containers). We then point it to a private folder under the
system's temporary directory, and only when that fails too do without a cache.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numba
from numba.core import config as numba_config

F = TypeVar("F", bound=Callable[..., Any])


def _writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def _private_temporary_folder() -> Path | None:
    owner = getattr(os, "getuid", lambda: "user")()
    folder = Path(tempfile.gettempdir()) / f"easyhecpp-numba-{owner}"
    if not _writable(folder):
        return None
    try:
        # Compiled code is executed on load: never take it from somebody else's folder.
        if hasattr(os, "getuid") and folder.stat().st_uid != os.getuid():
            return None
        folder.chmod(0o700)
    except OSError:
        return None
    return folder


def _cache_usable() -> bool:
    """True when numba can keep compiled code on disk; redirects its cache when it must."""
    configured = os.environ.get("NUMBA_CACHE_DIR")
    if configured and _writable(Path(configured)):
        return True
    if not configured and _writable(Path(__file__).parent / "__pycache__"):
        return True
    fallback = _private_temporary_folder()
    if fallback is None:
        return False
    numba_config.CACHE_DIR = str(fallback)  # pyright: ignore[reportAttributeAccessIssue]
    return True


CACHE = _cache_usable()


def jit(function: F) -> F:
    """Compile ``function`` with numba: releases the GIL, is cached where a cache can be kept."""
    return numba.njit(cache=CACHE, nogil=True, error_model="numpy")(function)  # type: ignore[no-any-return]
