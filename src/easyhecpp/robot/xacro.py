"""Xacro files to plain URDF text."""

from __future__ import annotations

import contextlib
import io
import os
import re
from collections.abc import Sequence
from pathlib import Path

from easyhecpp._paths import is_folder
from easyhecpp.errors import InputError
from easyhecpp.robot.resolve import FileFinder, told
from easyhecpp.robot.safe_xml import refuse_dtd

_BY_HAND = "Expand it by hand (xacro FILE name:=value > robot.urdf) and give the URDF"


def expand_xacro(
    data: bytes, path: Path, package_dirs: Sequence[str | os.PathLike[str]] = ()
) -> bytes:
    """Expand a xacro file with the default values of its arguments.

    Packages in `$(find ...)` are looked for as `FileFinder` does.

    Returns:
        The URDF, in which mesh names stand as they were written.

    Raises:
        InputError: bad XML, a missing package, include or argument.
    """
    refuse_dtd(data, path)
    finder = FileFinder(path, package_dirs)
    packages: dict[str, Path] = {}
    for name in re.findall(r"\$\(find\s+([\w.-]+)\s*\)", data.decode("utf-8", "replace")):
        packages.setdefault(name, _find_package(name, finder, path))
    while True:
        urdf, unknown = _expand(path, packages)
        if unknown is None:
            return urdf
        packages[unknown] = _find_package(unknown, finder, path)


def _expand(path: Path, packages: dict[str, Path]) -> tuple[bytes, str | None]:
    """The URDF, or the name of a package that an included file asks for and is not known yet."""
    from xacrodoc import XacroDoc
    from xacrodoc import packages as lookup

    lookup.reset()
    lookup.update_package_cache(packages)
    try:
        # By way of an include, because only then are the file's own relative includes resolved
        # from its folder. What xacro says on stderr is in its exception, too.
        with contextlib.redirect_stderr(io.StringIO()):
            document = XacroDoc.from_includes(
                [str(path.resolve())], name=_robot_name(path), resolve_packages=False
            )
            return document.to_urdf_string().encode(), None
    except (Exception, SystemExit) as error:  # xacro evaluates Python expressions of the file
        if unknown := re.search(r"Package not found: ([\w.-]+)", str(error)):
            return b"", unknown.group(1)
        raise InputError(
            f"The xacro file cannot be expanded: {error}", where=path, fix=_BY_HAND
        ) from error


def _find_package(name: str, finder: FileFinder, path: Path) -> Path:
    tried = list(dict.fromkeys(finder.find_package(name)))
    for folder in tried:
        if is_folder(folder):
            return folder
    raise InputError(
        f"The package '{name}', which the xacro file needs, was not found; looked for at "
        + told(tried),
        where=path,
        fix="Give the folder that holds it (package_dirs, or ROS_PACKAGE_PATH)",
    )


def _robot_name(path: Path) -> str:
    match = re.search(
        r"<robot\b[^>]*?\bname\s*=\s*[\"']([^\"'$]+)[\"']", path.read_text("utf-8", "replace")
    )
    return match.group(1) if match else path.name.partition(".")[0]
