"""Mesh files to bare triangles, in the file's own axes and in metres.

STL, COLLADA and OBJ, which nearly all robots use, are read here, because importing a general mesh
library costs more than reading all meshes of an arm, and because such libraries cut every polygon
into a fan, which is wrong where it is not convex. The rest goes through trimesh.
"""

from __future__ import annotations

import io
import re
from pathlib import Path
from typing import Any

import numpy as np

from easyhecpp.errors import InputError
from easyhecpp.robot.polygons import triangulate
from easyhecpp.robot.safe_xml import refuse_dtd

SUFFIXES = (".stl", ".dae", ".obj", ".ply", ".glb", ".gltf", ".off")

Triangles = tuple[np.ndarray, np.ndarray]

_STL_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_STL_HEADER_BYTES = 84

# Parts of a COLLADA file that say nothing about shape. A mistake in one of them, such as a material
# that does not exist, would make pycollada drop the geometry that uses it.
_COLLADA_LOOKS = re.compile(
    rb"<(bind_material|library_(?:images|effects|materials|lights|cameras|animations))\b[^>]*"
    rb"(?<!/)>.*?</\1>",
    re.DOTALL,
)


def read_mesh(path: Path) -> Triangles:
    """Read a mesh file.

    COLLADA units are applied and so are the transforms of the scene graph. COLLADA's `<up_axis>`
    is not: in a URDF, coordinates are taken as they stand, as RViz and MoveIt take them, and
    robot descriptions are made to look right there.

    Args:
        path: the file; its suffix says the format.

    Returns:
        vertices (V, 3) float64 and faces (F, 3), not welded.

    Raises:
        InputError: unknown format, unreadable or truncated file, no triangles, numbers that are
            not finite.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(
            f"The mesh format '{path.suffix}' is not known",
            where=path,
            expected=f"one of {', '.join(SUFFIXES)}",
            fix="Convert the mesh, for example to STL",
        )
    try:
        data = path.read_bytes()
        if suffix == ".stl":
            vertices, faces = _read_stl(data)
        elif suffix == ".dae":
            vertices, faces = _read_collada(data, path)
        elif suffix == ".obj":
            vertices, faces = _read_obj(data)
        else:
            vertices, faces = _read_with_trimesh(path)
    except InputError:
        raise
    except Exception as error:  # parsers of foreign files raise anything
        raise InputError(
            f"The mesh cannot be read: {error}", where=path, expected=f"a valid {suffix} file"
        ) from error
    if len(faces) == 0:
        raise InputError(
            "The mesh is empty: it has no triangles",
            where=path,
            fix="Export it again, or leave its link out (ignore_links)",
        )
    if not np.isfinite(vertices).all():
        raise InputError("The mesh has vertices that are not finite numbers", where=path)
    return vertices, faces


def _read_stl(data: bytes) -> Triangles:
    count = int.from_bytes(data[80:84], "little")
    # Binary files may begin with "solid" too, so the length decides; some writers append to it.
    needed = _STL_HEADER_BYTES + count * _STL_FACET.itemsize
    if len(data) >= _STL_HEADER_BYTES and (
        len(data) == needed or (len(data) > needed and not data.lstrip().startswith(b"solid"))
    ):
        facets = np.frombuffer(data, _STL_FACET, count, _STL_HEADER_BYTES)
        corners = facets["corners"].astype(np.float64).reshape(-1, 3)
    elif data[:256].lstrip().lower().startswith(b"solid"):
        corners = _stl_words(data.lower())
    else:
        raise ValueError(f"{len(data)} bytes, but its header promises {count} triangles")
    return corners, np.arange(len(corners)).reshape(-1, 3)


def _stl_words(text: bytes) -> np.ndarray:
    """(3 F, 3) corners of an STL in words, lower case."""
    words = re.findall(rb"\bvertex\s+(\S+)\s+(\S+)\s+(\S+)", text)
    count = len(re.findall(rb"\bend\s*facet\b", text))
    ended = re.search(rb"\bend\s*solid\b", text) is not None
    if len(words) != 3 * count or not ended:
        raise ValueError(
            f"it is cut off or damaged: {len(words)} corners in {count} finished triangles"
            + ("" if ended else ", and no 'endsolid'")
        )
    return np.array(words, dtype=bytes).astype(np.float64).reshape(-1, 3)


def _read_obj(data: bytes) -> Triangles:
    """Vertices and faces of an OBJ; normals, materials and groups say nothing about shape."""
    vertices: list[list[bytes]] = []
    corners: list[int] = []
    counts: list[int] = []
    for line in re.sub(rb"\\\r?\n", b" ", data).splitlines():
        words = line.partition(b"#")[0].split()
        if words[:1] == [b"v"]:
            vertices.append(words[1:4])
        elif words[:1] == [b"f"]:
            numbers = [int(word.partition(b"/")[0]) for word in words[1:]]
            # They count from 1, or backwards from the last vertex so far.
            corners += [n - 1 if n > 0 else len(vertices) + n for n in numbers]
            counts.append(len(numbers))
    if corners and (min(corners) < 0 or max(corners) >= len(vertices)):
        raise ValueError(f"a face names a vertex that is not among the {len(vertices)} of the file")
    points = np.array(vertices, dtype=bytes).astype(np.float64).reshape(-1, 3)
    return points, triangulate(points, np.array(corners, np.int64), np.array(counts, np.int64))


def _read_collada(data: bytes, path: Path) -> Triangles:
    refuse_dtd(data, path)
    if re.search(rb"<(\w+:)?ph\b", data):
        raise InputError(
            "The mesh has polygons with holes (<ph>), which are not read",
            where=path,
            fix="Export it with triangles",
        )
    from collada import Collada, common  # 0.2 s, only for robots that use it

    ignored = [common.DaeUnsupportedError, common.DaeBrokenRefError]
    document = Collada(io.BytesIO(_COLLADA_LOOKS.sub(b"", data)), ignore=ignored)
    if document.scene is None:
        raise ValueError("it has no scene")
    pieces = []
    for placed in document.scene.objects("geometry"):
        for primitive in placed.original.primitives:
            triangles = _collada_triangles(primitive)
            if triangles is not None:
                pieces.append(_transformed(placed.matrix, *triangles))
    vertices, faces = concatenate(pieces)
    unit = document.assetInfo.unitmeter if document.assetInfo else None
    return vertices * (unit or 1.0), faces


def _collada_triangles(primitive: Any) -> Triangles | None:
    """Triangles of a COLLADA primitive, None for lines and for empty ones."""
    index = getattr(primitive, "vertex_index", None)
    if index is None or primitive.vertex is None:
        return None
    vertices = np.asarray(primitive.vertex, np.float64)
    if hasattr(primitive, "vcounts"):  # <polylist> and <polygons>
        return vertices, triangulate(vertices, np.asarray(index), np.asarray(primitive.vcounts))
    if np.ndim(index) != 2 or index.shape[1] != 3:
        return None
    return vertices, np.asarray(index)


def _read_with_trimesh(path: Path) -> Triangles:
    import trimesh  # close to a second, only for robots that use it

    scene = trimesh.load_scene(path, process=False)
    pieces = []
    for name in scene.graph.nodes_geometry:
        transform, geometry = scene.graph[name]
        mesh = scene.geometry[geometry]
        if isinstance(mesh, trimesh.Trimesh):
            pieces.append(_transformed(transform, mesh.vertices, mesh.faces))
    return concatenate(pieces)


def _transformed(T: np.ndarray, vertices: np.ndarray, faces: np.ndarray) -> Triangles:
    """Vertices through an affine transform; one that mirrors has the faces walked backwards."""
    T = np.asarray(T, np.float64)
    mirrored = np.linalg.det(T[:3, :3]) < 0
    return vertices @ T[:3, :3].T + T[:3, 3], faces[:, ::-1] if mirrored else faces


def concatenate(pieces: list[Triangles]) -> Triangles:
    """Several meshes as one, face indices shifted; no pieces give an empty mesh."""
    if not pieces:
        return np.zeros((0, 3)), np.zeros((0, 3), np.int64)
    starts = np.cumsum([0] + [len(vertices) for vertices, _ in pieces[:-1]])
    return (
        np.concatenate([vertices for vertices, _ in pieces]),
        np.concatenate([faces + start for (_, faces), start in zip(pieces, starts, strict=True)]),
    )
