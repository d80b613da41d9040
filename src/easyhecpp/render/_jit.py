"""One place that decides how numba compiles: cached on disk where that is possible, never failing.

numba notices that a function's own file has changed, not that a function which it calls from
another file has: it would go on running the old machine code of that. So compiled code is kept in a
folder that is named by the sources of all of it.

numba raises at import time when no folder for its cache can be written (read-only site-packages
and no writable home, as in many containers). We then take a private folder under the system's
temporary directory, and only when that fails too do without a cache.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar

import numba
from numba.core import config as numba_config

F = TypeVar("F", bound=Callable[..., Any])

# Named, not searched for: opening every file of the package would take longer at each start than
# all else that is done here. A test compares the list with what the files import.
KERNEL_FILES = (
    "explore/_covariance_kernel.py",
    "explore/_spread_kernel.py",
    "initialise/_seed_kernel.py",
    "render/_contour_kernel.py",
    "render/_depth_kernel.py",
    "render/_jit.py",
    "render/_project.py",
    "render/_raster_kernel.py",
    "render/reference.py",
    "render/reference_compiled.py",
    "segment/_edge_kernel.py",
    "segment/_plate_kernel.py",
    "segment/_rim_kernel.py",
    "segment/classical/lines.py",
    "segment/classical/plate.py",
    "segment/classical/search.py",
    "sim/denoise.py",
    "sim/lens.py",
    "solve/_evidence_kernel.py",
)
"""Files of the package that hold compiled code, or constants that it uses."""

_PACKAGE = Path(__file__).resolve().parents[1]
_PREFIX = "easyhecpp-kernels-"
_UNUSED_DAYS = 30


def source_digest(package: Path) -> str:
    """Sixteen hexadecimal digits that change with any of the kernels' sources."""
    found = hashlib.sha256()
    for name in KERNEL_FILES:
        found.update(name.encode())
        with suppress(OSError):
            found.update((package / name).read_bytes())
    return found.hexdigest()[:16]


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


def _cache_folder() -> Path | None:
    """The folder for compiled code: the configured one, else beside the package, else temporary."""
    name = _PREFIX + source_digest(_PACKAGE)
    configured = numba_config.CACHE_DIR  # pyright: ignore[reportAttributeAccessIssue]
    folder = Path(configured or _PACKAGE / "__pycache__") / name
    if not _opened(folder):
        fallback = _private_temporary_folder()
        if fallback is None or not _opened(fallback / name):
            return None
        folder = fallback / name
    return folder


def _opened(folder: Path) -> bool:
    """True when the folder can be written; a new one takes the place of those long unused."""
    new = not folder.is_dir()
    if not _writable(folder):
        return False
    with suppress(OSError):
        os.utime(folder)  # its age is the time since it was last used
    if new:
        _remove_unused(folder.parent)
    return True


def _remove_unused(parent: Path) -> None:
    oldest = time.time() - _UNUSED_DAYS * 86400
    for folder in parent.glob(_PREFIX + "?" * 16):
        with suppress(OSError):
            if folder.stat().st_mtime < oldest:
                shutil.rmtree(folder, ignore_errors=True)


CACHE = _cache_folder()


def jit(function: F) -> F:
    """Compile ``function`` with numba: releases the GIL, is cached where a cache can be kept.

    The file that it stands in belongs into `KERNEL_FILES`.
    """
    before = numba_config.CACHE_DIR  # pyright: ignore[reportAttributeAccessIssue]
    # numba asks for the folder while it decorates; other packages' functions keep their own.
    numba_config.CACHE_DIR = str(CACHE or before)  # pyright: ignore[reportAttributeAccessIssue]
    try:
        return numba.njit(cache=CACHE is not None, nogil=True, error_model="numpy")(function)  # type: ignore[no-any-return]
    finally:
        numba_config.CACHE_DIR = before  # pyright: ignore[reportAttributeAccessIssue]
