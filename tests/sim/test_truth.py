from __future__ import annotations

import numpy as np
import pytest

from easyhecpp.camera import Camera
from easyhecpp.geometry import inverse, look_at, make_transform
from easyhecpp.render.reference_compiled import reference_coverage_compiled
from easyhecpp.robot.link_mesh import LinkMesh
from easyhecpp.sim.robots import load_robot
from easyhecpp.sim.shapes import box, panel, sphere
from easyhecpp.sim.truth import TruthRenderer, cropped, subdivided

CAMERA = Camera(160, 90, 115.0, 115.0, 81.3, 43.8)
FAR = Camera(160, 90, 115.0, 115.0, 81.3, 43.8, "plumb_bob", (-0.2, 0.05, 0.0, 0.0))


def mesh_of(surface) -> LinkMesh:
    return LinkMesh.from_triangles(surface.vertices, surface.faces)


def at(x: float, y: float, z: float) -> np.ndarray:
    return make_transform(np.eye(3), np.array([x, y, z]))


@pytest.fixture(scope="module")
def arm():
    robot = load_robot("xarm7")
    q = np.array([0.3, -0.4, 0.2, 0.9, 0.1, 1.2, 0.0])
    return robot.meshes, inverse(look_at([1.1, 0.5, 0.7], [0.1, 0.0, 0.35])) @ robot.link_poses(q)


@pytest.mark.parametrize("camera", [CAMERA, FAR], ids=["pinhole", "distorted"])
def test_with_nothing_in_front_the_mask_is_the_references(arm, camera):
    meshes, poses = arm
    wall = mesh_of(panel(8.0, 8.0))
    facing = make_transform(np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.0, 3.0]))
    truth = TruthRenderer(meshes, [wall], camera).render(poses, facing[None])
    expected = reference_coverage_compiled(meshes, camera, poses, 5)
    assert np.array_equal(truth.coverage, expected)
    assert truth.depth[truth.links < 0] == pytest.approx(3.0, abs=1e-5)
    assert (truth.depth[truth.links >= 0] < 2.0).all()


@pytest.mark.parametrize("camera", [CAMERA, FAR], ids=["pinhole", "distorted"])
def test_something_in_front_hides_the_share_of_each_pixel_that_it_covers(camera):
    # A wall as the arm, half of it hidden by a ball: what is left is one minus the ball's cover.
    wall, ball = mesh_of(panel(9.0, 9.0)), mesh_of(sphere(0.2, 128))
    facing = make_transform(np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.0, 2.0]))[None]
    place = at(0.05, -0.02, 1.0)[None]
    truth = TruthRenderer([wall], [ball], camera).render(facing, place)
    cover = reference_coverage_compiled([ball], camera, place, 15)
    assert 0.03 < cover.mean() < 0.3
    assert np.abs(truth.coverage - (1.0 - cover)).max() < 0.15
    assert abs((truth.coverage - (1.0 - cover)).sum()) < 0.01 * cover.sum()
    assert (truth.links[cover == 1] == -1).all()
    assert not truth.mask[cover > 0.6].any()


def test_something_behind_hides_nothing(arm):
    meshes, poses = arm
    behind = mesh_of(box((0.5, 0.5, 0.1)))
    truth = TruthRenderer(meshes, [behind], CAMERA).render(poses, at(0.0, 0.0, 4.0)[None])
    assert np.array_equal(truth.coverage, reference_coverage_compiled(meshes, CAMERA, poses, 5))


def test_link_masks_share_no_pixel_and_make_up_the_visible_arm(arm):
    meshes, poses = arm
    truth = TruthRenderer(meshes, [mesh_of(sphere(0.05))], CAMERA).render(
        poses, at(0.0, 0.0, 9.0)[None]
    )
    masks = truth.link_masks(len(meshes))
    assert masks.sum(axis=0).max() == 1
    assert np.array_equal(masks.any(axis=0), truth.links >= 0)
    assert (masks.any(axis=0) == truth.mask).mean() > 0.99


def test_a_crop_sees_what_the_camera_sees_there():
    points = np.array([[0.1, -0.05, 1.0], [0.3, 0.2, 1.3]])
    part = cropped(CAMERA, 20, 10, 120, 80)
    assert part.project(points) == pytest.approx(CAMERA.project(points) - [20, 10])
    assert (part.width, part.height) == (100, 70)


def test_subdividing_keeps_the_surface_and_shortens_its_edges():
    plate = mesh_of(box((1.0, 0.6, 0.01)))
    fine = subdivided(plate, 0.15)
    assert fine.area == pytest.approx(plate.area)
    corners = fine.vertices[fine.faces]
    assert np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max() <= 0.15
