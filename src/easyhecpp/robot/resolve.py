"""Where the files that a URDF names lie on this machine."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from itertools import chain
from pathlib import Path
from urllib.parse import unquote

from easyhecpp._paths import expanded, is_file, is_folder, obstacle

# A workspace holds its packages in src/REPOSITORY/PACKAGE or install/PACKAGE/share/PACKAGE; the
# number of folders is for the day that somebody names a whole disk.
_MAX_DEPTH, _MAX_FOLDERS_PER_LEVEL = 4, 2000


class FileFinder:
    """Resolves `package://`, `file://` and relative names as seen from one URDF.

    A package is looked for in the given folders, then in ROS_PACKAGE_PATH, then in the `share`
    folders of AMENT_PREFIX_PATH, then walking up from the URDF. A folder stands for a package
    when it is named so, or when its `package.xml` says so. Below the given folders and those of
    ROS_PACKAGE_PATH a `package.xml` is looked for a few levels down, as in a workspace.

    Args:
        urdf_path: the file whose names are resolved.
        package_dirs: packages, or folders that hold packages.
    """

    def __init__(
        self, urdf_path: Path, package_dirs: Sequence[str | os.PathLike[str]] = ()
    ) -> None:
        self._folder = urdf_path.resolve().parent
        self._workspaces = [expanded(p, "package_dirs") for p in package_dirs]
        self._workspaces += [Path(p) for p in _path_list("ROS_PACKAGE_PATH")]
        self._places = [Path(p) / "share" for p in _path_list("AMENT_PREFIX_PATH")]
        self._places += [self._folder, *self._folder.parents]
        self._below: dict[Path, dict[str, Path]] = {}

    def find(self, name: str) -> tuple[Path | None, list[Path]]:
        """The file of that name, None if there is none, and all places that were looked at."""
        tried: list[Path] = []
        for candidate in self._candidates(name):
            if candidate not in tried:
                tried.append(candidate)
                if is_file(candidate):
                    return candidate, tried
        return None, tried

    def find_package(self, package: str) -> Iterator[Path]:
        """Folders that may be the package, best first, without asking whether they exist."""
        for place in self._workspaces:
            yield from _as_package(place, package)
            if place not in self._below:
                self._below[place] = _packages_below(place)
            if package in self._below[place]:
                yield self._below[place][package]
        for place in self._places:
            yield from _as_package(place, package)

    def _candidates(self, name: str) -> Iterator[Path]:
        scheme, separator, rest = name.partition("://")
        if not separator:
            yield self._folder / unquote(name.removeprefix("file:"))
            if "%" in name:
                yield self._folder / name
        elif scheme == "file":
            yield self._folder / unquote(rest)
        elif scheme in ("package", "model"):
            package, _, inside = unquote(rest).partition("/")
            for folder in self.find_package(package):
                yield folder / inside


def told(places: Sequence[Path]) -> str:
    """Places that were looked at, for an error text, with what kept one from looking."""
    obstacles = [obstacle(place) for place in places]
    return ", ".join(
        str(place) if why is None else f"{place} ({why})"
        for place, why in zip(places, obstacles, strict=True)
    )


def _path_list(variable: str) -> list[str]:
    return [entry for entry in os.environ.get(variable, "").split(os.pathsep) if entry]


def _as_package(place: Path, package: str) -> Iterator[Path]:
    """A place if it is the package itself, and what is named like it inside."""
    if place.name == package or _package_name(place) == package:
        yield place
    yield place / package


def _packages_below(place: Path) -> dict[str, Path]:
    """Packages in a workspace by their names, those nearest to the top first."""
    found: dict[str, Path] = {}
    level = [place] if _package_name(place) is None else []
    for _ in range(_MAX_DEPTH):
        plain: list[Path] = []
        for folder in chain.from_iterable(map(_subfolders, level)):
            if (name := _package_name(folder)) is None:
                plain.append(folder)
            else:  # packages hold no packages
                found.setdefault(name, folder)
        level = plain[:_MAX_FOLDERS_PER_LEVEL]
    return found


def _subfolders(folder: Path) -> list[Path]:
    """Folders that are neither hidden nor closed, in order."""
    try:
        with os.scandir(folder) as entries:
            shown = [entry for entry in entries if not entry.name.startswith(".")]
    except OSError:
        return []
    return sorted(
        Path(entry.path)
        for entry in shown
        if entry.is_dir(follow_symlinks=False)
        or (entry.is_symlink() and is_folder(Path(entry.path)))
    )


def _package_name(folder: Path) -> str | None:
    try:
        text = (folder / "package.xml").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return None
    match = re.search(r"<name>\s*([^<\s]+)\s*</name>", text)
    return match.group(1) if match else None
