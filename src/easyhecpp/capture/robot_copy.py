"""Copying a robot description with its meshes, so that a capture folder stands on its own."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from itertools import product
from pathlib import Path

from easyhecpp._atomic import write_bytes
from easyhecpp.capture.image_files import read_file
from easyhecpp.errors import InputError
from easyhecpp.robot.description import read_description
from easyhecpp.robot.resolve import FileFinder, told
from easyhecpp.robot.safe_xml import parse_xml
from easyhecpp.robot.urdf import GEOMETRIES, Geometry


def copy_robot(
    source: Path,
    target: Path,
    package_dirs: Sequence[Path] = (),
    ignore_links: Sequence[str] = (),
    geometry: Geometry = "visual",
) -> None:
    """Copy a URDF (or what a xacro expands to) with the meshes it names.

    Args:
        source: `.urdf` or `.xacro` file.
        target: The new `.urdf`; meshes go into `meshes/` beside it.
        package_dirs: Where its `package://` names are looked for first.
        ignore_links: Links that are not drawn.
        geometry: `visual` or `collision`, which is drawn. Meshes that are not may be missing.

    Raises:
        InputError: The description cannot be read, or a mesh to be drawn is missing.
    """
    root = parse_xml(read_description(source, package_dirs), source)
    finder = FileFinder(source, package_dirs)
    names: dict[Path, str] = {}
    for link, kind in product(root.iterfind("link"), GEOMETRIES):
        for mesh in link.iterfind(f"{kind}/geometry/mesh"):
            name = mesh.get("filename", "")
            found, tried = finder.find(name)
            if found is not None:
                mesh.set("filename", _copied(found, kind, names, target.parent))
            elif kind == geometry and link.get("name") not in ignore_links:
                raise InputError(
                    f"The mesh '{name}' is missing; looked for at {told(tried)}",
                    where=source,
                    fix="Give the folder that holds the packages (package_dirs)",
                )
    write_bytes(target, ET.tostring(root, encoding="utf-8", xml_declaration=True))


def _copied(mesh: Path, kind: str, names: dict[Path, str], folder: Path) -> str:
    """Copy a mesh once; returns its name relative to the new URDF."""
    if mesh not in names:
        name, count = f"meshes/{kind}/{mesh.name}", 1
        while name in names.values():
            count += 1
            name = f"meshes/{kind}/{mesh.stem}_{count}{mesh.suffix}"
        write_bytes(folder / name, read_file(mesh))
        names[mesh] = name
    return names[mesh]
