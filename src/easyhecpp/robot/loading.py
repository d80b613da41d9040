"""From a URDF file to a `Robot`: read, resolve, load meshes, choose the base."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from itertools import chain
from pathlib import Path

import numpy as np

from easyhecpp.errors import InputError
from easyhecpp.robot.description import read_description
from easyhecpp.robot.kinematics import build_tree
from easyhecpp.robot.link_shapes import load_meshes
from easyhecpp.robot.resolve import FileFinder, told
from easyhecpp.robot.robot import Robot, check_links
from easyhecpp.robot.urdf import GEOMETRIES, Geometry, Shape, Urdf, parse_urdf

_SETTINGS = "What stands in brackets is a key of capture.yaml and an option of 'easyhecpp info'"


def load_robot(
    path: Path,
    *,
    package_dirs: Sequence[str | os.PathLike[str]] = (),
    base_link: str | None = None,
    ignore_links: Iterable[str] = (),
    geometry: Geometry = "visual",
) -> Robot:
    """See `Robot.from_urdf`."""
    ignored = tuple(ignore_links)
    if geometry not in GEOMETRIES:
        raise InputError(
            f"Unknown geometry '{geometry}'", expected=f"one of {', '.join(GEOMETRIES)}"
        )
    urdf = parse_urdf(read_description(path, package_dirs), path)
    finder = FileFinder(path, package_dirs)
    check_links(ignored, tuple(urdf.links), "ignore_links")
    if base_link is not None:
        check_links([base_link], tuple(urdf.links), "base_link")

    shapes = {n: getattr(k, geometry) for n, k in urdf.links.items() if n not in ignored}
    shapes = {name: s for name, s in shapes.items() if s}
    if not shapes:
        raise _no_geometry(urdf, ignored, geometry, path)
    for shape in chain.from_iterable(shapes.values()):
        if shape.problem is not None:
            raise shape.problem
    files = _find_files(shapes, finder, urdf, geometry, path)
    meshes = load_meshes(shapes, files)

    tree = build_tree(urdf, path)
    actuated = [j for j in urdf.joints if j.moves and j.mimic is None]
    limits = np.array([[j.lower, j.upper] for j in actuated]).reshape(-1, 2).T.copy()
    limits.setflags(write=False)
    return Robot(
        name=urdf.name,
        joint_names=tree.joint_names,
        joint_types=tuple(j.type for j in actuated),
        lower=limits[0],
        upper=limits[1],
        base_link=base_link or default_base(urdf),
        link_names=tuple(shapes),
        meshes=meshes,
        frame_names=tree.frame_names,
        geometry=geometry,
        undrawn_links=_undrawn_links(urdf, ignored, geometry),
        tree=tree,
    )


def default_base(urdf: Urdf) -> str:
    """The first link with geometry met when walking down from the root through fixed joints.

    Breadth first, siblings in the order in which the links stand in the file. Visual geometry
    decides; collision geometry counts when no link on the way has a visual one, and the root is
    the base when none has any.
    """
    order = list(urdf.links)
    reached = [urdf.root]
    for name in reached:
        below = [j.child for j in urdf.joints if j.parent == name and j.type == "fixed"]
        reached += sorted(below, key=order.index)
    for kind in GEOMETRIES:
        for name in reached:
            if getattr(urdf.links[name], kind):
                return name
    return urdf.root


def _find_files(
    shapes: dict[str, tuple[Shape, ...]],
    finder: FileFinder,
    urdf: Urdf,
    geometry: Geometry,
    path: Path,
) -> dict[str, Path]:
    """Mesh name to file; all that are missing are reported together."""
    files: dict[str, Path] = {}
    missing: dict[str, tuple[str, list[Path]]] = {}
    for link, link_shapes in shapes.items():
        for shape in link_shapes:
            name = shape.filename
            if name is None or name in files or name in missing:
                continue
            found, tried = finder.find(name)
            if found is None:
                missing[name] = (link, tried)
            else:
                files[name] = found
    if missing:
        lines = [
            f"'{name}' of link '{link}', looked for at {told(tried)}"
            if tried
            else f"'{name}' of link '{link}', whose scheme is not package:// or file://"
            for name, (link, tried) in missing.items()
        ]
        raise InputError(
            f"{len(missing)} mesh file{'s are' if len(missing) > 1 else ' is'} missing:\n  "
            + "\n  ".join(lines)
            + "\n",
            where=path,
            fix=_missing_fix(missing, urdf, finder, geometry),
        )
    return files


def _missing_fix(missing: Iterable[str], urdf: Urdf, finder: FileFinder, geometry: Geometry) -> str:
    packaged = any(name.startswith("package://") for name in missing)
    ways = [
        "give the folder that holds the packages (package_dirs)" if packaged else "put them there",
        "leave the links out (ignore_links)",
    ]
    if geometry == "visual" and _collisions_are_there(urdf, finder):
        ways.append("draw the collision geometry, whose meshes are all there (geometry: collision)")
    text = ", or ".join(ways)
    return f"{text[0].upper()}{text[1:]}. {_SETTINGS}"


def _collisions_are_there(urdf: Urdf, finder: FileFinder) -> bool:
    shapes = [shape for link in urdf.links.values() for shape in link.collision]
    files = [shape.filename for shape in shapes if shape.filename]
    return (
        bool(files)
        and all(shape.problem is None for shape in shapes)
        and all(finder.find(file)[0] for file in files)
    )


def _no_geometry(urdf: Urdf, ignored: Sequence[str], geometry: Geometry, path: Path) -> InputError:
    other = "collision" if geometry == "visual" else "visual"
    has_other = any(getattr(k, other) for n, k in urdf.links.items() if n not in ignored)
    return InputError(
        f"No link has {geometry} geometry" + (" that is not ignored" if ignored else ""),
        where=path,
        fix=f"It has {other} geometry to draw (geometry: {other}). {_SETTINGS}"
        if has_other
        else None,
    )


def _undrawn_links(urdf: Urdf, ignored: Sequence[str], geometry: Geometry) -> tuple[str, ...]:
    other = "collision" if geometry == "visual" else "visual"
    return tuple(
        name
        for name, link in urdf.links.items()
        if name not in ignored and getattr(link, other) and not getattr(link, geometry)
    )
