"""The shapes that a URDF gives to its links, made into one mesh a link."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path

import numpy as np

from easyhecpp.errors import InputError
from easyhecpp.robot import primitives
from easyhecpp.robot.cache import load_arrays, store_arrays
from easyhecpp.robot.link_mesh import LinkMesh
from easyhecpp.robot.mesh_files import Triangles, concatenate, read_mesh
from easyhecpp.robot.urdf import Shape

# Part of the names in the cache: change it with anything that changes a mesh.
_VERSION = 2
_FIELDS = tuple(field.name for field in fields(LinkMesh))


def load_meshes(
    shapes: Mapping[str, tuple[Shape, ...]], files: Mapping[str, Path]
) -> tuple[LinkMesh, ...]:
    """Meshes of links, welded and with adjacency, kept in the user's cache folder.

    Args:
        shapes: shapes of each link.
        files: where the mesh files that the shapes name are.

    Raises:
        InputError: a mesh cannot be read or is empty.
    """
    try:
        key = _key(shapes, files)
    except OSError:  # let the reader of meshes say which file it is
        return _read(shapes, files)
    meshes = _from_cache(key, len(shapes))
    if meshes is None:
        meshes = _read(shapes, files)
        store_arrays(
            key,
            {f"{name}{i}": getattr(m, name) for i, m in enumerate(meshes) for name in _FIELDS},
        )
    return meshes


def _read(
    shapes: Mapping[str, tuple[Shape, ...]], files: Mapping[str, Path]
) -> tuple[LinkMesh, ...]:
    read: dict[Path, Triangles] = {}
    meshes = []
    for link_shapes in shapes.values():
        pieces, error = [], 0.0
        for shape in link_shapes:
            vertices, faces, shape_error = _shape_triangles(shape, files, read)
            T = shape.T_link_shape
            pieces.append((vertices @ T[:3, :3].T + T[:3, 3], faces))
            error = max(error, shape_error)
        mesh = LinkMesh.from_triangles(*concatenate(pieces), error=error)
        if len(mesh.faces) == 0:
            raise InputError(
                "The mesh is empty: all its triangles are degenerate", where=link_shapes[0].where
            )
        meshes.append(mesh)
    return tuple(meshes)


def _shape_triangles(
    shape: Shape, files: Mapping[str, Path], read: dict[Path, Triangles]
) -> tuple[np.ndarray, np.ndarray, float]:
    """Vertices in the shape's frame, faces, and the error of tessellation in metres."""
    if shape.filename is None:
        return getattr(primitives, shape.kind)(shape.size)
    path = files[shape.filename]
    if path not in read:
        read[path] = read_mesh(path)
    vertices, faces = read[path]
    # A mirroring scale turns faces inside out; walking them the other way round undoes that.
    mirrored = np.prod(shape.size) < 0
    return vertices * np.array(shape.size), faces[:, ::-1] if mirrored else faces, 0.0


def _key(shapes: Mapping[str, tuple[Shape, ...]], files: Mapping[str, Path]) -> str:
    """A name for all that the meshes depend on: the shapes and what is in the files."""
    digest = hashlib.sha256(f"meshes {_VERSION}".encode())
    for link_shapes in shapes.values():
        digest.update(b"link")
        for shape in link_shapes:
            digest.update(repr((shape.kind, shape.size, shape.filename)).encode())
            digest.update(shape.T_link_shape.tobytes())
    for name, path in files.items():
        digest.update(name.encode())
        # A .gltf keeps its numbers in files of its own, which stand beside it.
        for part in sorted(path.parent.iterdir()) if path.suffix.lower() == ".gltf" else [path]:
            digest.update(part.read_bytes() if part.is_file() else b"")
    return digest.hexdigest()[:40]


def _from_cache(key: str, count: int) -> tuple[LinkMesh, ...] | None:
    stored = load_arrays(key)
    if stored is None or stored.keys() != {f"{name}{i}" for i in range(count) for name in _FIELDS}:
        return None
    for array in stored.values():
        array.setflags(write=False)
    return tuple(
        LinkMesh(*(stored[f"{name}{i}"] for name in _FIELDS[:-1]), error=float(stored[f"error{i}"]))
        for i in range(count)
    )
