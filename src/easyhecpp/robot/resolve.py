"""Where the files that a URDF names lie on this machine."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from urllib.parse import unquote

from easyhecpp._paths import expanded, is_file, obstacle


class FileFinder:
    """Resolves `package://`, `file://` and relative names as seen from one URDF.

    A package is looked for in the given folders, then in ROS_PACKAGE_PATH, then in the `share`
    folders of AMENT_PREFIX_PATH, then walking up from the URDF. A folder stands for a package
    when it is named so, or when its `package.xml` says so.

    Args:
        urdf_path: the file whose names are resolved.
        package_dirs: packages, or folders that hold packages.
    """

    def __init__(
        self, urdf_path: Path, package_dirs: Sequence[str | os.PathLike[str]] = ()
    ) -> None:
        self._folder = urdf_path.resolve().parent
        self._places = [expanded(p, "package_dirs") for p in package_dirs]
        self._places += [Path(p) for p in _path_list("ROS_PACKAGE_PATH")]
        self._places += [Path(p) / "share" for p in _path_list("AMENT_PREFIX_PATH")]
        self._places += [self._folder, *self._folder.parents]

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
        for place in self._places:
            if place.name == package or _package_name(place) == package:
                yield place
            yield place / package

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


def _package_name(folder: Path) -> str | None:
    try:
        text = (folder / "package.xml").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return None
    match = re.search(r"<name>\s*([^<\s]+)\s*</name>", text)
    return match.group(1) if match else None
