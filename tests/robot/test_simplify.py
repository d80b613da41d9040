"""Fewer faces, and an error that others measure, too."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import trimesh

from easyhecpp.errors import InputError
from easyhecpp.robot import LinkMesh, Robot, cache, simplify
from easyhecpp.robot.primitives import box, sphere
from easyhecpp.robot.simplify import simplify_mesh
from easyhecpp.robot.surface_distance import Surface, hausdorff, squared_distances


@pytest.fixture(scope="module")
def xarm(robots_folder: Path) -> Robot:
    return Robot.from_urdf(robots_folder / "xarm_description/urdf/xarm7.urdf")


def random_points(mesh: LinkMesh, count: int) -> np.ndarray:
    """Points spread over a surface, and some of its corners."""
    rng = np.random.default_rng(3)
    surface = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    points, _ = trimesh.sample.sample_surface(surface, count, seed=3)
    return np.concatenate([points, rng.permutation(mesh.vertices)[:count]])


def one_sided(points: np.ndarray, mesh: LinkMesh) -> float:
    """Largest distance of points to a mesh, by brute force over all its triangles."""
    corners = mesh.vertices[mesh.faces]
    squared = [squared_distances(p, corners).min() for p in points]
    return float(np.sqrt(max(squared)))


def test_distances_to_triangles_agree_with_trimesh() -> None:
    rng = np.random.default_rng(0)
    triangles = rng.normal(size=(300, 3, 3))
    points = rng.normal(size=(300, 3)) * 2
    closest = trimesh.triangles.closest_point(triangles, points)
    truth = np.linalg.norm(closest - points, axis=1)
    np.testing.assert_allclose(np.sqrt(squared_distances(points, triangles)), truth, atol=1e-12)
    line = np.array([[[0, 0, 0], [2, 0, 0], [1, 0, 0]]], float)
    np.testing.assert_allclose(squared_distances(np.array([[3.0, 0, 1]]), line), 2.0)


def test_distance_between_known_surfaces() -> None:
    vertices, faces, _ = box((0.2, 0.2, 0.2))
    spacing = 0.01
    bigger = Surface(vertices * 1.5, faces, spacing)
    # The corners of the bigger box are farthest: half of 0.1 in each direction.
    assert hausdorff(Surface(vertices, faces, spacing), bigger) == pytest.approx(0.05 * 3**0.5)
    moved = Surface(vertices + [0.01, 0, 0], faces, spacing)
    assert hausdorff(Surface(vertices, faces, spacing), moved) == pytest.approx(0.01)
    half = Surface(vertices, faces[:6], spacing)
    assert hausdorff(half, Surface(vertices, faces, spacing)) > 0.09


@pytest.mark.parametrize(("link", "max_error"), [(1, 0.004), (6, 0.001), (6, 0.004), (7, 0.002)])
def test_the_reported_error_holds_under_other_sampling(
    xarm: Robot, link: int, max_error: float
) -> None:
    mesh = xarm.meshes[link]
    simple = simplify_mesh(mesh, max_error)
    assert len(simple.faces) < 0.5 * len(mesh.faces)
    assert 0 < simple.error <= max_error
    measured = max(
        one_sided(random_points(mesh, 300), simple), one_sided(random_points(simple, 300), mesh)
    )
    assert 0.5 * simple.error <= measured <= 1.02 * simple.error


def test_a_whole_robot(xarm: Robot) -> None:
    simple = xarm.simplified(0.003)
    assert simple.n_faces < xarm.n_faces / 5
    assert 0 < simple.mesh_error <= 0.003
    assert simple.link_names == xarm.link_names
    np.testing.assert_allclose(simple.centre(xarm.neutral), xarm.centre(xarm.neutral), atol=5e-3)
    assert xarm.mesh_error == 0.0


def test_errors_add_up() -> None:
    vertices, faces, error = sphere((0.1,))
    mesh = LinkMesh.from_triangles(vertices, faces, error=error)
    simple = simplify_mesh(mesh, 0.002)
    assert error < simple.error <= 0.002
    radii = np.linalg.norm(random_points(simple, 3000), axis=1)
    assert np.abs(radii - 0.1).max() <= 1.02 * simple.error
    again = simplify_mesh(simple, 0.004)
    assert len(again.faces) < len(simple.faces)
    radii = np.linalg.norm(random_points(again, 3000), axis=1)
    assert np.abs(radii - 0.1).max() <= again.error <= 0.004


def test_a_mesh_that_cannot_get_simpler_stays() -> None:
    vertices, faces, _ = box((0.1, 0.2, 0.3))
    mesh = LinkMesh.from_triangles(vertices, faces)
    assert simplify_mesh(mesh, 0.001) is mesh
    rough = dataclasses.replace(mesh, error=0.01)
    assert simplify_mesh(rough, 0.001) is rough


@pytest.mark.parametrize("max_error", [0.0, -1.0, float("nan")])
def test_errors_that_are_none(xarm: Robot, max_error: float) -> None:
    with pytest.raises(InputError, match="metres above 0"):
        xarm.simplified(max_error)


@pytest.fixture
def ball() -> LinkMesh:
    return LinkMesh.from_triangles(*sphere((0.05,))[:2])


def forbid_decimation(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise AssertionError("decimated again")

    monkeypatch.setattr(simplify, "_decimated", fail)


def test_results_are_kept_in_memory_and_on_disk(
    ball: LinkMesh, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    first = simplify_mesh(ball, 0.001)
    forbid_decimation(monkeypatch)
    assert simplify_mesh(ball, 0.001) is first
    twin = LinkMesh.from_triangles(*sphere((0.05,))[:2])
    second = simplify_mesh(twin, 0.001)
    np.testing.assert_array_equal(second.vertices, first.vertices)
    assert second.error == first.error
    assert len(list((tmp_path / "easyhecpp" / "meshes").glob("*.npz"))) == 1


@pytest.mark.parametrize("obstacle", ["a file in the way", "damaged entries"])
def test_the_cache_may_fail(
    ball: LinkMesh, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, obstacle: str
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    if obstacle == "a file in the way":
        (tmp_path / "easyhecpp").write_text("")
    else:
        simplify_mesh(LinkMesh.from_triangles(*sphere((0.05,))[:2]), 0.001)
        for entry in cache.cache_folder().glob("*.npz"):
            entry.write_bytes(entry.read_bytes()[:100])
    assert 0 < simplify_mesh(ball, 0.001).error <= 0.001
