"""Round shapes are as round as they say."""

from __future__ import annotations

import numpy as np
import pytest

from easyhecpp.robot import LinkMesh
from easyhecpp.robot.primitives import TESSELLATION_ERROR, box, cylinder, sphere


def volume(vertices: np.ndarray, faces: np.ndarray) -> float:
    return float(np.linalg.det(vertices[faces]).sum() / 6.0)


def surface_samples(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    weights = np.random.default_rng(0).dirichlet([0.5, 0.5, 0.5], size=40)
    return (weights @ vertices[faces]).reshape(-1, 3)


@pytest.mark.parametrize(
    ("shape", "size", "truth"),
    [
        (box, (0.1, 0.2, 0.3), 0.006),
        (cylinder, (0.05, 0.4), np.pi * 0.05**2 * 0.4),
        (sphere, (0.07,), 4 / 3 * np.pi * 0.07**3),
    ],
)
def test_volumes_and_closed_surfaces(shape, size, truth) -> None:
    vertices, faces, error = shape(size)
    assert volume(vertices, faces) == pytest.approx(truth, rel=3e-3)
    assert error <= TESSELLATION_ERROR
    mesh = LinkMesh.from_triangles(vertices, faces)
    assert mesh.n_open_edges == 0
    assert len(mesh.vertices) - len(mesh.edges) + len(mesh.faces) == 2


@pytest.mark.parametrize("radius", [0.002, 0.05, 0.3])
def test_spheres_stay_within_their_error(radius: float) -> None:
    vertices, faces, error = sphere((radius,))
    off = np.linalg.norm(surface_samples(vertices, faces), axis=1) - radius
    assert np.abs(off).max() <= error * (1 + 1e-9)
    assert off.min() < 0 < off.max()


@pytest.mark.parametrize("radius", [0.002, 0.05, 0.3])
def test_cylinders_stay_within_their_error(radius: float) -> None:
    vertices, faces, error = cylinder((radius, 0.4))
    walls = faces[np.ptp(vertices[faces][..., 2], axis=1) > 0.1]
    off = np.linalg.norm(surface_samples(vertices, walls)[:, :2], axis=1) - radius
    assert np.abs(off).max() <= error * (1 + 1e-9)
    assert off.min() < 0 < off.max()
    np.testing.assert_allclose(np.abs(vertices[:, 2]), 0.2)
