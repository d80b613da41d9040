"""Welding and adjacency: the invariants that silhouettes rest on."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from easyhecpp.robot import LinkMesh, Robot
from easyhecpp.robot.primitives import box, sphere


def soup(vertices: np.ndarray, faces: np.ndarray) -> LinkMesh:
    """A mesh whose triangles share no vertices, as in an STL file."""
    return LinkMesh.from_triangles(
        vertices[faces].reshape(-1, 3), np.arange(faces.size).reshape(-1, 3)
    )


def check_adjacency(mesh: LinkMesh) -> None:
    """Every half-edge of every face stands in one row, run in the right direction."""
    half_edges = sorted(
        (int(face[i]), int(face[(i + 1) % 3]), f)
        for f, face in enumerate(mesh.faces)
        for i in range(3)
    )
    stored = [
        (int(a), int(b), int(f)) for (a, b), (f, _) in zip(mesh.edges, mesh.edge_faces, strict=True)
    ]
    stored += [
        (int(b), int(a), int(g))
        for (a, b), (_, g) in zip(mesh.edges, mesh.edge_faces, strict=True)
        if g >= 0
    ]
    assert sorted(stored) == half_edges


def check_planes(mesh: LinkMesh) -> None:
    corners = mesh.vertices[mesh.faces]
    normals, offsets = mesh.face_planes[:, :3], mesh.face_planes[:, 3]
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-12)
    heights = np.einsum("fi,fki->fk", normals, corners) - offsets[:, None]
    np.testing.assert_allclose(heights, 0.0, atol=1e-9)
    turned = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (np.einsum("fi,fi->f", turned, normals) > 0).all()


def test_a_welded_box() -> None:
    mesh = soup(*box((1.0, 2.0, 3.0))[:2])
    assert (len(mesh.vertices), len(mesh.faces), len(mesh.edges)) == (8, 12, 18)
    assert mesh.n_open_edges == 0
    assert mesh.area == pytest.approx(22.0)
    np.testing.assert_allclose(mesh.centroid, 0.0, atol=1e-12)
    check_adjacency(mesh)
    check_planes(mesh)


@pytest.mark.parametrize("robot", ["xarm7", "so100"])
def test_real_meshes(robot: str, robots_folder: Path) -> None:
    files = {
        "xarm7": "xarm_description/urdf/xarm7.urdf",
        "so100": "so_arm_description/urdf/so100.urdf",
    }
    for mesh in Robot.from_urdf(robots_folder / files[robot]).meshes[:4]:
        check_adjacency(mesh)
        check_planes(mesh)
        closed = mesh.edge_faces[:, 1] >= 0
        assert closed.mean() > 0.99
        assert trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).area == pytest.approx(
            mesh.area
        )


def test_nearly_equal_vertices_are_one_and_slivers_are_gone() -> None:
    vertices, faces, _ = box((1.0, 1.0, 1.0))
    corners = vertices[faces].reshape(-1, 3)
    shaken = corners + np.random.default_rng(0).uniform(-1e-8, 1e-8, corners.shape)
    sliver = [[0, 0, 0], [0.5, 0, 0], [0.25, 0, 0]]
    mesh = LinkMesh.from_triangles(
        np.concatenate([shaken, sliver]), np.arange(len(corners) + 3).reshape(-1, 3)
    )
    assert (len(mesh.vertices), len(mesh.faces), mesh.n_open_edges) == (8, 12, 0)


def test_open_and_crowded_edges() -> None:
    """Three walls on one edge: two pair up, the third has a boundary there."""
    vertices = np.array([[0, 0, 0], [0, 0, 1], [1, 0, 0], [0, 1, 0], [-1, 0, 0]], float)
    faces = np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4]])
    mesh = LinkMesh.from_triangles(vertices, faces)
    check_adjacency(mesh)
    crowded = [
        tuple(sorted(pair))
        for edge, pair in zip(mesh.edges, mesh.edge_faces.tolist(), strict=True)
        if np.ptp(mesh.vertices[edge], axis=0).tolist() == [0, 0, 1]
    ]
    assert len(crowded) == 2
    assert [-1 in pair for pair in crowded].count(True) == 1
    assert mesh.n_open_edges == 7


def test_windings_that_disagree_are_not_paired() -> None:
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], float)
    mesh = LinkMesh.from_triangles(vertices, np.array([[0, 1, 2], [1, 2, 3]]))
    check_adjacency(mesh)
    assert mesh.n_open_edges == 6


def test_the_shadow_of_any_faces_is_their_signed_boundary() -> None:
    """Signed area swept under the edges of front faces equals the faces' projected area."""
    vertices, faces, _ = sphere((0.3,))
    mesh = soup(vertices, faces[:-5])
    view = np.array([0.3, -0.5, 0.8])
    front = np.append(mesh.face_planes[:, :3] @ view > 0, False)
    sign = front[mesh.edge_faces[:, 0]].astype(int) - front[mesh.edge_faces[:, 1]]
    start, end = mesh.vertices[mesh.edges[:, 0], :2], mesh.vertices[mesh.edges[:, 1], :2]
    swept = 0.5 * (sign * (start[:, 0] * end[:, 1] - start[:, 1] * end[:, 0])).sum()
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces[front[:-1]]], 1, 0)
    assert swept == pytest.approx(0.5 * np.cross(b - a, c - a)[:, 2].sum(), rel=1e-9)


def test_arrays_cannot_be_changed() -> None:
    mesh = soup(*box((1.0, 1.0, 1.0))[:2])
    for name in ("vertices", "faces", "face_planes", "edges", "edge_faces"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(mesh, name)[0] = 0
    assert mesh.vertices.dtype == mesh.face_planes.dtype == np.float64
    assert mesh.faces.dtype == mesh.edges.dtype == mesh.edge_faces.dtype == np.int32
