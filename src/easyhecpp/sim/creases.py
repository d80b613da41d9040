"""Split a link's mesh into smooth patches and cut it along planes without moving its surface."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from easyhecpp.robot.link_mesh import LinkMesh
from easyhecpp.sim.shapes import Surface

CREASE = np.radians(32.0)


def label_faces(mesh: LinkMesh, max_angle: float = CREASE) -> np.ndarray:
    """Number the patches of faces that are joined by edges bent less than ``max_angle``.

    Args:
        mesh: the mesh.
        max_angle: radians; pi gives the connected components.

    Returns:
        (F,) int patch of each face, numbered from 0.
    """
    pairs = mesh.edge_faces[mesh.edge_faces[:, 1] >= 0]
    normals = mesh.face_planes[:, :3]
    bend = np.einsum("ij,ij->i", normals[pairs[:, 0]], normals[pairs[:, 1]])
    pairs = pairs[bend >= np.cos(max_angle) - 1e-9]
    n = len(mesh.faces)
    graph = coo_matrix((np.ones(len(pairs), np.int8), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    return connected_components(graph, directed=False)[1]


def face_areas(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(F,) areas of triangles, square metres."""
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)


def smoothed(vertices: np.ndarray, faces: np.ndarray, patch: np.ndarray) -> Surface:
    """A surface whose normals are smooth inside a patch and break between patches.

    Args:
        vertices: (V, 3).
        faces: (F, 3).
        patch: (F,) patch of each face.

    Returns:
        The same triangles, in the same order, with the vertices on creases doubled.
    """
    key = faces.astype(np.int64) + patch[:, None].astype(np.int64) * len(vertices)
    unique, corner = np.unique(key, return_inverse=True)
    corner = corner.reshape(faces.shape)
    points = vertices[unique % len(vertices)]
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    weighted = np.cross(b - a, c - a)
    normals = np.zeros((len(unique), 3))
    for k in range(3):
        np.add.at(normals, corner[:, k], weighted)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.where(length > 1e-15, normals / np.maximum(length, 1e-15), [0.0, 0.0, 1.0])
    return Surface(points, corner, normals)


def cut(
    vertices: np.ndarray, faces: np.ndarray, normal: np.ndarray, offset: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Split the triangles that cross the plane ``normal . x = offset``; no point moves.

    Args:
        vertices: (V, 3).
        faces: (F, 3).
        normal: (3,) unit.
        offset: metres.

    Returns:
        vertices (V', 3), faces (F', 3) of which none crosses the plane, and (F',) the index of
        the face that each came from.
    """
    side = vertices @ normal - offset
    side[np.abs(side) < 1e-7] = 0.0
    above, below = (side[faces] > 0).any(axis=1), (side[faces] < 0).any(axis=1)
    crossing = np.flatnonzero(above & below)
    kept = np.flatnonzero(~(above & below))
    new_vertices, new_faces, origin = [vertices], [faces[kept]], [kept]
    edge_points: dict[tuple[int, int], int] = {}
    pieces: list[tuple[int, int, int]] = []
    for index in crossing:
        for piece in _split(faces[index], side, edge_points, len(vertices)):
            pieces.append(piece)
            origin.append(np.array([index]))
    if edge_points:
        ends = np.array(list(edge_points))
        share = side[ends[:, 0]] / (side[ends[:, 0]] - side[ends[:, 1]])
        a, b = vertices[ends[:, 0]], vertices[ends[:, 1]]
        new_vertices.append(a + share[:, None] * (b - a))
    if pieces:
        new_faces.append(np.array(pieces, faces.dtype))
    return np.concatenate(new_vertices), np.concatenate(new_faces), np.concatenate(origin)


def _split(
    face: np.ndarray, side: np.ndarray, edge_points: dict[tuple[int, int], int], n_vertices: int
) -> list[tuple[int, int, int]]:
    """The two or three triangles of one triangle that crosses the plane side == 0."""
    polygons: tuple[list[int], list[int]] = ([], [])
    for k in range(3):
        here, there = int(face[k]), int(face[(k + 1) % 3])
        if side[here] >= 0:
            polygons[0].append(here)
        if side[here] <= 0:
            polygons[1].append(here)
        if side[here] * side[there] < 0:
            key = (min(here, there), max(here, there))
            middle = n_vertices + edge_points.setdefault(key, len(edge_points))
            polygons[0].append(middle)
            polygons[1].append(middle)
    return [
        (polygon[0], polygon[k], polygon[k + 1])
        for polygon in polygons
        for k in range(1, len(polygon) - 1)
    ]
