"""Looking at paths that a user wrote down, where looking itself may be refused."""

from __future__ import annotations

import os
from pathlib import Path

from easyhecpp.errors import InputError


def is_file(path: Path) -> bool:
    """Whether a file is there; no where one may not look."""
    return obstacle(path) is None and path.is_file()


def is_folder(path: Path) -> bool:
    """Whether a folder is there; no where one may not look."""
    return obstacle(path) is None and path.is_dir()


def obstacle(path: Path) -> str | None:
    """What keeps one from telling whether something is there, in the system's words.

    `Permission denied` for a folder above it that is closed, `File name too long`; None where one
    can tell, also that nothing is there.
    """
    try:
        path.stat()
    except (FileNotFoundError, NotADirectoryError):
        return None
    except (OSError, ValueError) as error:  # ValueError: a name with a zero byte
        return reason(error)
    return None


def reason(error: Exception) -> str:
    """Why a file could not be read, without the path, which stands elsewhere in the text."""
    return getattr(error, "strerror", None) or str(error)


def expanded(path: str | os.PathLike[str], where: object = None) -> Path:
    """A path with `~` or `~user` spelt out.

    Raises:
        InputError: There is no such user; ``where`` says where the path stands.
    """
    try:
        return Path(path).expanduser()
    except RuntimeError as error:
        raise InputError(
            f"The home folder in '{os.fspath(path)}' is not known",
            where=where,
            fix="Write the path without ~",
        ) from error
