"""Writing files so that a reader sees either the old content or the new, never a half.

Everything is written under another name in the same folder, flushed to the disk, and then renamed
over the final name, which the file system does in one step.
"""

from __future__ import annotations

import contextlib
import errno
import os
import secrets
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from easyhecpp.errors import InputError

NO_ROOM = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}
"""Error numbers that mean that there is no space left for a file."""


@contextlib.contextmanager
def atomic_path(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield the path of an empty file beside ``path``; on success it takes the name ``path``.

    The temporary name keeps the suffix, since many writers choose the format by it. Missing parent
    folders are made. A symbolic link is followed, not replaced.

    Args:
        path: The final name.

    Yields:
        The path to write to. It is removed when the block raises.

    Raises:
        InputError: The folder cannot be written, ``path`` is a folder, or the disk is full.
    """
    final = Path(os.path.realpath(path))
    if final.is_dir():
        raise InputError("Cannot write a file over a folder", where=final)
    temporary = final.with_name(f".{secrets.token_hex(6)}.tmp{final.suffix}")
    _create(temporary, final)
    try:
        yield temporary
        _flush(temporary)
        temporary.replace(final)
    except BaseException as error:
        temporary.unlink(missing_ok=True)
        if isinstance(error, OSError) and error.errno in NO_ROOM:
            raise InputError(
                f"Cannot write the file: {error.strerror}",
                where=final,
                fix="Free some space, or choose another folder",
            ) from error
        raise
    _flush_folder(final.parent)


def write_bytes(path: str | os.PathLike[str], data: bytes) -> None:
    """Write ``data`` to ``path`` whole or not at all; see `atomic_path` for the errors."""
    with atomic_path(path) as temporary:
        temporary.write_bytes(data)


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Write ``text`` as UTF-8 to ``path`` whole or not at all; see `atomic_path`."""
    write_bytes(path, text.encode("utf-8"))


def write_image(path: str | os.PathLike[str], image: NDArray[Any]) -> None:
    """Write a picture whole or not at all; the suffix chooses the format.

    Args:
        path: Where to, e.g. ``0007.png``.
        image: ``(H, W, 3)`` uint8 RGB, ``(H, W)`` bool mask (stored as 0 and 255), ``(H, W)`` uint8
            grey or ``(H, W)`` uint16.

    Raises:
        InputError: Shape or type is none of these, the suffix is unknown, or see `atomic_path`.
    """
    # Loaded here since most users of this module write text.
    import cv2

    colour = image.ndim == 3 and image.shape[2] == 3 and image.dtype == np.uint8
    grey = image.ndim == 2 and image.dtype in (np.uint8, np.uint16, np.bool_)
    if not (colour or grey):
        raise InputError(
            f"Cannot store an array of shape {image.shape} and type {image.dtype} as a picture",
            where=path,
            expected="(H, W, 3) uint8, or (H, W) bool, uint8 or uint16",
        )
    if image.dtype == np.bool_:
        image = image.astype(np.uint8) * 255
    stored = image[..., ::-1] if colour else image
    suffix = Path(path).suffix
    try:
        fine, data = cv2.imencode(suffix, np.ascontiguousarray(stored))
    except cv2.error:
        fine, data = False, None
    if not fine or data is None:
        raise InputError(
            f"Cannot store a picture as {suffix or 'a file without a suffix'!r}",
            where=path,
            expected="a suffix such as .png or .jpg",
        )
    write_bytes(path, data.tobytes())


def _create(temporary: Path, final: Path) -> None:
    try:
        final.parent.mkdir(parents=True, exist_ok=True)
        # Not tempfile: its files are readable by their owner only, and the mode survives the
        # rename.
        os.close(os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))
    except OSError as error:
        raise InputError(
            f"Cannot write into the folder: {error.strerror}",
            where=final.parent,
            fix="Choose a folder that you may write to",
        ) from error


def _flush(path: Path) -> None:
    with path.open("rb") as file:
        os.fsync(file.fileno())


def _flush_folder(folder: Path) -> None:
    # Makes the new name itself survive a power cut; some network file systems refuse it, and then
    # the rename has still happened.
    with contextlib.suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
