"""The reference coverage as machine code: same samples, tests and answers, ten times faster.

Simulated scenes take their truth from here. It shares nothing with the fast silhouette kernel, so
that kernel cannot be tested against its own mistakes.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from easyhecpp.camera import Camera
from easyhecpp.render._jit import jit
from easyhecpp.render.reference import (
    EDGE_TOLERANCE,
    check_supersample,
    project_triangles,
    sample_positions,
    sample_rays,
)
from easyhecpp.robot import LinkMesh


def reference_coverage_compiled(
    meshes: Sequence[LinkMesh],
    camera: Camera,
    Ts_cam_link: NDArray[np.float64],
    supersample: int = 5,
) -> NDArray[np.float32]:
    """Share of every pixel that the union of the meshes covers.

    Arguments, result and errors are those of `easyhecpp.render.reference.reference_coverage`.
    """
    check_supersample(supersample)
    coverage = np.zeros((camera.height, camera.width), dtype=np.float32)
    triangles = project_triangles(meshes, camera, Ts_cam_link, supersample)
    if not len(triangles.boxes):
        return coverage
    # Whole pixels around everything that may be hit.
    left, top = triangles.boxes[:, :2].min(axis=0) // supersample
    right, bottom = -(-triangles.boxes[:, 2:].max(axis=0) // supersample)
    box = tuple(int(edge) * supersample for edge in (left, top, right, bottom))
    rays_x, rays_y = _rays(camera, supersample, box)
    covered = np.zeros(rays_x.shape, dtype=np.bool_)
    _mark(covered, rays_x, rays_y, triangles.edges, triangles.boxes - (box[:2] * 2))
    coverage[top:bottom, left:right] = _mean_of_blocks(covered, supersample)
    return coverage


def _rays(
    camera: Camera, supersample: int, box: tuple[int, ...]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Normalised x and y of the samples in the box, (rows, columns) each."""
    left, top, right, bottom = box
    if camera.is_distorted:
        rays = sample_rays(camera, supersample, (left, top, right, bottom))
        return rays[..., 0], rays[..., 1]
    # Without distortion x depends on the column alone and y on the row alone.
    columns = sample_positions(left, right, supersample)
    rows = sample_positions(top, bottom, supersample)
    x = camera.unproject(np.stack([columns, np.zeros_like(columns)], axis=-1))[:, 0]
    y = camera.unproject(np.stack([np.zeros_like(rows), rows], axis=-1))[:, 1]
    shape = (len(rows), len(columns))
    return np.broadcast_to(x, shape), np.broadcast_to(y[:, None], shape)


@jit
def _mark(covered, rays_x, rays_y, edges, boxes):  # type: ignore[no-untyped-def]
    """Mark every sample that lies inside a triangle; boxes are relative to `covered`."""
    for index in range(len(boxes)):
        edge = edges[index]
        for row in range(boxes[index, 1], boxes[index, 3]):
            for column in range(boxes[index, 0], boxes[index, 2]):
                x = rays_x[row, column]
                y = rays_y[row, column]
                if (
                    edge[0, 0] * x + edge[0, 1] * y + edge[0, 2] >= -EDGE_TOLERANCE
                    and edge[1, 0] * x + edge[1, 1] * y + edge[1, 2] >= -EDGE_TOLERANCE
                    and edge[2, 0] * x + edge[2, 1] * y + edge[2, 2] >= -EDGE_TOLERANCE
                ):
                    covered[row, column] = True


@jit
def _mean_of_blocks(covered, size):  # type: ignore[no-untyped-def]
    """Mean of every size x size block."""
    height = covered.shape[0] // size
    width = covered.shape[1] // size
    means = np.empty((height, width), dtype=np.float32)
    for row in range(height):
        for column in range(width):
            count = 0
            for i in range(size):
                for j in range(size):
                    count += covered[row * size + i, column * size + j]
            means[row, column] = count / (size * size)
    return means
