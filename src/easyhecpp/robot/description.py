"""The text of a robot description: a URDF as it stands, a xacro file expanded."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from easyhecpp._paths import reason
from easyhecpp.errors import InputError


def read_description(path: Path, package_dirs: Sequence[str | os.PathLike[str]] = ()) -> bytes:
    """The URDF in a file, or that a `.xacro` file expands to.

    Raises:
        InputError: The file is not there, cannot be read, or cannot be expanded.
    """
    try:
        data = path.read_bytes()
    except FileNotFoundError as error:
        raise InputError(
            "The robot description does not exist", where=path, expected="a .urdf or .xacro file"
        ) from error
    except (OSError, ValueError) as error:
        raise InputError(
            f"The robot description cannot be read: {reason(error)}",
            where=path,
            fix="Make it a file that you may read",
        ) from error
    if path.suffix != ".xacro":
        return data
    from easyhecpp.robot.xacro import expand_xacro

    return expand_xacro(data, path, package_dirs)
