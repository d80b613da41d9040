from __future__ import annotations

import numpy as np
import pytest

from easyhecpp.robot.link_mesh import LinkMesh
from easyhecpp.sim.creases import cut, face_areas, label_faces, smoothed
from easyhecpp.sim.finishes import dress, random_look
from easyhecpp.sim.robots import load_robot
from easyhecpp.sim.shapes import box, cylinder, lathe, panel, sphere, tube


def volume(surface) -> float:
    """Signed volume: positive when the faces look outwards."""
    a, b, c = np.moveaxis(surface.vertices[surface.faces], 1, 0)
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


@pytest.mark.parametrize(
    ("surface", "expected", "tolerance"),
    [
        (box((0.2, 0.3, 0.5)), 0.03, 1e-12),
        (sphere(0.5, 96), 4 / 3 * np.pi * 0.125, 2e-3),
        (cylinder(0.2, 0.7, 128), np.pi * 0.04 * 0.7, 1e-3),
        (lathe(np.array([[0, 0], [0.2, 0], [0, 0.6]]), 128), np.pi * 0.04 * 0.2, 1e-3),
    ],
)
def test_closed_shapes_enclose_their_volume_and_look_outwards(surface, expected, tolerance):
    assert volume(surface) == pytest.approx(expected, rel=max(tolerance, 1e-12))


@pytest.mark.parametrize(
    "surface",
    [
        box((0.2, 0.3, 0.5)),
        sphere(0.5),
        cylinder(0.2, 0.7),
        panel(1.0, 2.0),
        tube(
            np.column_stack([np.linspace(0, 1, 40), np.sin(np.linspace(0, 3, 40)), [0.1] * 40]),
            0.02,
        ),
    ],
    ids=["box", "sphere", "cylinder", "panel", "tube"],
)
def test_shading_normals_are_unit_and_on_the_side_that_the_faces_look_to(surface):
    assert np.linalg.norm(surface.normals, axis=1) == pytest.approx(1.0)
    a, b, c = np.moveaxis(surface.vertices[surface.faces], 1, 0)
    flat = np.cross(b - a, c - a)
    real = np.linalg.norm(flat, axis=1) > 1e-9
    smooth = surface.normals[surface.faces].mean(axis=1)
    assert (np.einsum("ij,ij->i", flat, smooth)[real] > 0).all()


def test_a_cube_has_six_patches_and_one_piece():
    cube = box((1.0, 1.0, 1.0))
    mesh = LinkMesh.from_triangles(cube.vertices, cube.faces)
    assert len(np.unique(label_faces(mesh))) == 6
    assert len(np.unique(label_faces(mesh, np.pi))) == 1


def test_smoothed_normals_are_exact_on_a_sphere_and_break_at_creases():
    ball = sphere(1.0, 96)
    mesh = LinkMesh.from_triangles(ball.vertices, ball.faces)
    surface = smoothed(mesh.vertices, mesh.faces, label_faces(mesh))
    radial = surface.vertices / np.linalg.norm(surface.vertices, axis=1, keepdims=True)
    assert np.einsum("ij,ij->i", surface.normals, radial).min() > 0.999
    cube = box((1.0, 1.0, 1.0))
    mesh = LinkMesh.from_triangles(cube.vertices, cube.faces)
    flat = smoothed(mesh.vertices, mesh.faces, label_faces(mesh))
    assert len(flat.vertices) == 24
    assert np.abs(flat.normals).max(axis=1) == pytest.approx(1.0)


def test_cutting_moves_nothing_and_leaves_no_face_across_the_plane():
    ball = sphere(1.0)
    normal = np.array([2.0, -1.0, 2.0]) / 3.0
    vertices, faces, origin = cut(ball.vertices, ball.faces, normal, 0.237)
    side = (vertices @ normal - 0.237)[faces]
    assert not ((side > 1e-9).any(axis=1) & (side < -1e-9).any(axis=1)).any()
    pieces = np.bincount(origin, weights=face_areas(vertices, faces), minlength=len(ball.faces))
    assert pieces == pytest.approx(face_areas(ball.vertices, ball.faces), abs=1e-12)


def test_dressing_a_link_keeps_its_surface():
    robot = load_robot("xarm7")
    look = random_look(np.random.default_rng(0), robot.reach)
    for mesh, parts in zip(robot.meshes, dress(robot, look), strict=True):
        dressed = sum(face_areas(s.vertices, s.faces).sum() for s, _ in parts)
        assert dressed == pytest.approx(mesh.area, rel=1e-9)


def test_the_joints_of_a_dressed_arm_get_bands():
    robot = load_robot("xarm7")
    look = random_look(np.random.default_rng(0), robot.reach)
    banded = [any(m is look.band for _, m in parts) for parts in dress(robot, look)]
    assert sum(banded) >= 5
