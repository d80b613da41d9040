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

# Where packages are said to lie that are nowhere. Much of what names packages is never looked at
# here (parameters of simulators and controllers), so that only a file that has to be read tells.
_NOWHERE = Path("/.no-such-package").resolve().as_posix()


def expand_xacro(
    data: bytes, path: Path, package_dirs: Sequence[str | os.PathLike[str]] = ()
) -> bytes:
    """Expand a xacro file with the default values of its arguments.

    Packages in `$(find ...)` are looked for as `FileFinder` does, and only those that the expansion
    comes across.

    Args:
        data: what is in the file.
        path: the file, from whose folder its includes are found.
        package_dirs: packages, or folders that hold packages.

    Returns:
        The URDF, in which mesh names stand as they were written; in those of a package that was
        not found `$(find NAME)` becomes `package://NAME`.

    Raises:
        InputError: bad XML, a missing include or argument, a missing package that a file is to be
            read from.
    """
    refuse_dtd(data, path)
    finder = FileFinder(path, package_dirs)
    packages: dict[str, str] = {}
    while True:
        urdf, unknown = _expand(data, path, packages, finder)
        if unknown is None:
            return re.sub(rf"(file://)?{re.escape(_NOWHERE)}/", "package://", urdf).encode()
        folder = next((f for f in finder.find_package(unknown) if is_folder(f)), None)
        packages[unknown] = f"{_NOWHERE}/{unknown}" if folder is None else str(folder)


def _expand(
    data: bytes, path: Path, packages: dict[str, str], finder: FileFinder
) -> tuple[str, str | None]:
    """The URDF, or the name of a package that is asked for and was not looked for yet."""
    from xacrodoc import XacroDoc
    from xacrodoc import packages as lookup

    lookup.reset()
    lookup.update_package_cache(packages)
    said, failure = io.StringIO(), None
    try:
        # By way of an include, because only then are the file's own relative includes resolved
        # from its folder. Errors that xacro says on stderr are in its exception, too.
        with contextlib.redirect_stderr(said):
            document = XacroDoc.from_includes(
                [str(path.resolve())], name=_robot_name(data, path), resolve_packages=False
            )
            urdf = document.to_urdf_string()
    except (Exception, SystemExit) as error:  # xacro evaluates Python expressions of the file
        urdf, failure = "", error
    if unknown := re.search(r"Package not found: ([\w.-]+)", str(failure)):
        return "", unknown.group(1)
    # A pattern of includes that matches no file is only a warning of xacro's.
    if missing := re.search(rf"{re.escape(_NOWHERE)}/([\w.-]+)", f"{failure} {said.getvalue()}"):
        raise _missing_package(missing.group(1), finder, path) from failure
    if failure is not None:
        raise InputError(
            f"The xacro file cannot be expanded: {failure}", where=path, fix=_BY_HAND
        ) from failure
    return urdf, None


def _missing_package(name: str, finder: FileFinder, path: Path) -> InputError:
    tried = list(dict.fromkeys(finder.find_package(name)))
    return InputError(
        f"The package '{name}', from which the xacro file reads, was not found; looked for at "
        + told(tried),
        where=path,
        fix="Give the folder that holds it: package_dirs in capture.yaml, --package-dirs of "
        "'easyhecpp info', or ROS_PACKAGE_PATH",
    )


def _robot_name(data: bytes, path: Path) -> str:
    match = re.search(
        r"<robot\b[^>]*?\bname\s*=\s*[\"']([^\"'$]+)[\"']", data.decode("utf-8", "replace")
    )
    return match.group(1) if match else path.name.partition(".")[0]
