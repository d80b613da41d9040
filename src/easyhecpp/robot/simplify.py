"""Fewer triangles for a link, with a measured bound on what that does to its silhouette."""

from __future__ import annotations

import hashlib
from functools import lru_cache

import numpy as np

from easyhecpp.errors import InputError
from easyhecpp.robot.cache import load_arrays, store_arrays
from easyhecpp.robot.link_mesh import LinkMesh
from easyhecpp.robot.surface_distance import Surface, hausdorff, natural_spacing

# Part of the names in the cache: change it with anything that changes the outcome.
_VERSION = 1
_FEWEST_FACES = 12
_TRIALS = 7
# The decimator orders its work well only for a mesh that is some hundred units across.
_DECIMATED_SIZE = 300.0


@lru_cache(maxsize=1024)
def simplify_mesh(mesh: LinkMesh, max_error: float) -> LinkMesh:
    """As few triangles as keep the surface within `max_error` of the true one.

    The error is the two-sided Hausdorff distance, measured on samples, plus the error that the
    mesh had already. It is found by bisection over face counts, once: results are kept in memory
    and in the user's cache folder.

    Args:
        mesh: the mesh to simplify.
        max_error: metres.

    Returns:
        A mesh whose `error` is at most `max_error`, or `mesh` itself when nothing can be gained.
    """
    if not max_error > 0.0:
        raise InputError(
            f"The largest error of a simplified mesh is {max_error:g}", expected="metres above 0"
        )
    limit = max_error - mesh.error
    if limit <= 0.0 or len(mesh.faces) <= _FEWEST_FACES:
        return mesh
    key = _key(mesh, limit)
    stored = load_arrays(key)
    if stored is None or not {"vertices", "faces", "error"} <= stored.keys():
        vertices, faces, error = _fewest_faces(mesh, limit)
        store_arrays(key, vertices=vertices, faces=faces, error=np.array(error))
    else:
        vertices, faces, error = stored["vertices"], stored["faces"], float(stored["error"])
    if len(faces) >= len(mesh.faces):
        return mesh
    return LinkMesh.from_triangles(vertices, faces, error=mesh.error + error)


def _fewest_faces(mesh: LinkMesh, limit: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Bisect the logarithm of the face count for the last one within `limit` metres."""
    spacing = natural_spacing(mesh.area)
    original = Surface(mesh.vertices, mesh.faces, spacing)
    passing = [(mesh.vertices, mesh.faces)]
    low, high = float(_FEWEST_FACES), float(len(mesh.faces))
    for _ in range(_TRIALS):
        count = int(np.sqrt(low * high))
        vertices, faces = _decimated(mesh, count)
        fine = len(faces) > 0 and (
            hausdorff(original, Surface(vertices, faces, spacing), limit) <= limit
        )
        if fine:
            passing.append((vertices, faces))
            high = float(count)
        else:
            low = float(count)
    # The search looks coarsely; what is handed out is measured more closely, and a level that does
    # not stand up to that gives way to the one before it.
    original = Surface(mesh.vertices, mesh.faces, spacing / 2)
    for vertices, faces in passing[:0:-1]:
        error = hausdorff(original, Surface(vertices, faces, spacing / 2), limit)
        if error <= limit:
            return vertices, faces, error
    return mesh.vertices, mesh.faces, 0.0


def _decimated(mesh: LinkMesh, count: int) -> tuple[np.ndarray, np.ndarray]:
    """About `count` triangles by quadric error (Garland and Heckbert 1997)."""
    import fast_simplification

    scale = _DECIMATED_SIZE / float(np.linalg.norm(np.ptp(mesh.vertices, axis=0)))
    # It wants arrays that it may write to.
    vertices, faces = fast_simplification.simplify(
        mesh.vertices * scale, mesh.faces.copy(), target_count=count
    )
    return vertices / scale, np.asarray(faces)


def _key(mesh: LinkMesh, limit: float) -> str:
    digest = hashlib.sha256(f"{_VERSION} {limit!r}".encode())
    digest.update(mesh.vertices.tobytes())
    digest.update(mesh.faces.tobytes())
    return digest.hexdigest()[:40]
