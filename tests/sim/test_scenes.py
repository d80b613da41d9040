from __future__ import annotations

import numpy as np
import pytest

from easyhecpp.errors import InputError
from easyhecpp.geometry import inverse, transform_points
from easyhecpp.render.reference import reference_coverage
from easyhecpp.robot import Robot
from easyhecpp.sim.arm_surface import sample_surface
from easyhecpp.sim.robots import load_robot
from easyhecpp.sim.scenes import SimScene, random_scene

SMALL = {"width": 320, "height": 180, "focal": 225.0}


@pytest.fixture(scope="module")
def xarm() -> Robot:
    return load_robot("xarm7")


@pytest.fixture(scope="module")
def scenes(xarm: Robot) -> list[SimScene]:
    return [random_scene(xarm, np.random.default_rng([7, i]), **SMALL) for i in range(12)]


def elevation_deg(scene: SimScene) -> float:
    # The mean middle over all poses, which the camera circles, is close to that of many draws.
    rng = np.random.default_rng(0)
    joints = rng.uniform(
        np.maximum(scene.robot.lower, -np.pi), np.minimum(scene.robot.upper, np.pi), (500, 7)
    )
    offset = scene.T_base_cam[:3, 3] - scene.robot.centre(joints).mean(axis=0)
    return float(np.rad2deg(np.arcsin(offset[2] / np.linalg.norm(offset))))


def test_joints_are_within_limits(scenes: list[SimScene]) -> None:
    for scene in scenes:
        assert scene.joints.shape == (5, 7)
        assert (scene.joints >= scene.robot.lower).all()
        assert (scene.joints <= scene.robot.upper).all()
        assert (np.abs(scene.joints) <= np.pi + 1.0).all()


def test_enough_of_the_arm_is_in_view(scenes: list[SimScene]) -> None:
    rng = np.random.default_rng(5)
    for scene in scenes:
        assert (scene.shares_in_view >= 0.7).all()
        # Independently: other points, area by area.
        areas = np.array([mesh.area for mesh in scene.robot.meshes])
        counts = np.round(3000 * areas / areas.sum()).astype(int)
        for poses, share in zip(scene.Ts_cam_link, scene.shares_in_view, strict=True):
            points = np.concatenate(
                [
                    transform_points(T, sample_surface(mesh.vertices, mesh.faces, count, rng))
                    for T, mesh, count in zip(poses, scene.robot.meshes, counts, strict=True)
                ]
            )
            px = scene.camera.project(points)
            inside = ((px > -0.5) & (px < [319.5, 179.5])).all(axis=1)
            assert inside.mean() == pytest.approx(share, abs=0.06)


def test_cameras_are_where_they_are_asked_to_be(xarm: Robot, scenes: list[SimScene]) -> None:
    for scene in scenes:
        middle = xarm.centre(scene.joints).mean(axis=0)
        assert 0.8 < np.linalg.norm(scene.T_base_cam[:3, 3] - middle) < 1.9
        assert -15 < elevation_deg(scene) < 75
    below = random_scene(xarm, np.random.default_rng(1), elevation_deg=(-40.0, -25.0), **SMALL)
    assert -45 < elevation_deg(below) < -20


def test_roll_is_bounded(xarm: Robot) -> None:
    rolls = []
    for seed in range(12):
        scene = random_scene(xarm, np.random.default_rng(seed), roll_deg=5.0, n_views=1, **SMALL)
        # The picture's x axis is level but for the roll.
        rolls.append(np.rad2deg(np.arcsin(scene.T_base_cam[2, 0])))
    assert np.abs(rolls).max() <= 5.0 + 1e-9
    assert np.abs(rolls).max() > 1.0


def test_masks_are_the_reference_thresholded(scenes: list[SimScene]) -> None:
    scene = scenes[0]
    meshes, poses = (
        scene.robot.meshes,
        inverse(scene.T_base_cam) @ scene.robot.link_poses(scene.joints[2]),
    )
    coverage = reference_coverage(meshes, scene.camera, poses, 5)
    np.testing.assert_array_equal(scene.coverage(2), coverage)
    np.testing.assert_array_equal(scene.masks[2], coverage > 0.5)
    assert scene.masks.shape == (5, 180, 320)
    assert scene.masks.any(axis=(1, 2)).all()


def test_visible_links_cover_the_mask(scenes: list[SimScene]) -> None:
    links = scenes[0].visible_links(0)
    mask = scenes[0].masks[0]
    assert (mask == (links >= 0)).mean() > 0.99  # they differ on outlines only
    assert set(np.unique(links)) <= {-1, *range(len(scenes[0].robot.meshes))}


def test_same_generator_same_scene(xarm: Robot) -> None:
    one, other = (random_scene(xarm, np.random.default_rng([3, 4]), **SMALL) for _ in range(2))
    np.testing.assert_array_equal(one.joints, other.joints)
    np.testing.assert_array_equal(one.T_base_cam, other.T_base_cam)
    different = random_scene(xarm, np.random.default_rng([3, 5]), **SMALL)
    assert not np.array_equal(one.T_base_cam, different.T_base_cam)


def test_other_arms_are_seen_from_a_distance_in_proportion(xarm: Robot) -> None:
    so100 = load_robot("so100")
    scene = random_scene(so100, np.random.default_rng(0), n_views=2, **SMALL)
    middle = so100.centre(scene.joints).mean(axis=0)
    distance = np.linalg.norm(scene.T_base_cam[:3, 3] - middle)
    assert 0.7 < distance / so100.reach < 1.8


def test_impossible_wish_is_refused(xarm: Robot) -> None:
    with pytest.raises(InputError, match=r"no camera 0.10 to 0.12 m from .* was found that sees"):
        random_scene(xarm, np.random.default_rng(0), distance=(0.1, 0.12), **SMALL)
