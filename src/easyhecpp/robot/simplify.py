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
_VERSION = 3
# Errors to aim at, as multiples of the allowed one, until one is met: the decimator sums squared
# distances to many planes, so what it counts as error is mostly above the real one.
_AIMS = (2.0, 1.4, 1.0, 0.5, 0.2, 0.05)
# The decimator runs 100 rounds, in round i it collapses what costs less than 1e-9 * (i + 3)^7
# squared units; so this is the largest distance, in its units, that it will ever accept.
_LARGEST_COST = float(np.sqrt(1e-9 * 102.0**7))


@lru_cache(maxsize=1024)
def simplify_mesh(mesh: LinkMesh, max_error: float) -> LinkMesh:
    """As few triangles as keep the surface within `max_error` of the true one.

    The error is the two-sided Hausdorff distance, measured on samples (good to some percent), plus
    the error that the mesh had already. It is worked out once: results are kept in memory and in
    the user's cache folder.

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
    if limit <= 0.0:
        return mesh
    key = _key(mesh, limit)
    stored = load_arrays(key)
    if stored is None or not {"vertices", "faces", "error"} <= stored.keys():
        vertices, faces, error = _decimated_within(mesh, limit)
        store_arrays(key, {"vertices": vertices, "faces": faces, "error": error})
    else:
        vertices, faces, error = stored["vertices"], stored["faces"], float(stored["error"])
    if len(faces) >= len(mesh.faces):
        return mesh
    return LinkMesh.from_triangles(vertices, faces, error=mesh.error + error)


def _decimated_within(mesh: LinkMesh, limit: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Vertices, faces and measured error, at most `limit` metres; the mesh itself if need be."""
    spacing = natural_spacing(mesh.area)
    original = Surface(mesh.vertices, mesh.faces, spacing)
    for aim in _AIMS:
        vertices, faces = _decimated(mesh, aim * limit)
        if len(faces) > 0:
            error = hausdorff(original, Surface(vertices, faces, spacing), limit)
            if error <= limit:
                return vertices, faces, error
    return mesh.vertices, mesh.faces, 0.0


def _decimated(mesh: LinkMesh, cost: float) -> tuple[np.ndarray, np.ndarray]:
    """Collapse all edges whose quadric error is below `cost` metres (Garland, Heckbert 1997).

    Asking for a number of faces instead would let the decimator ruin the easy parts of a mesh when
    other parts resist.
    """
    import fast_simplification

    scale = _LARGEST_COST / cost
    # It wants arrays that it may write to. Free borders would shrink and grow spikes.
    vertices, faces = fast_simplification.simplify(
        mesh.vertices * scale, mesh.faces.copy(), target_count=4, preserve_border=True
    )[:2]
    return vertices / scale, np.asarray(faces)


def _key(mesh: LinkMesh, limit: float) -> str:
    digest = hashlib.sha256(f"{_VERSION} {limit!r}".encode())
    digest.update(mesh.vertices.tobytes())
    digest.update(mesh.faces.tobytes())
    return digest.hexdigest()[:40]
