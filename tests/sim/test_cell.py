from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from easyhecpp.errors import InputError
from easyhecpp.geometry import inverse, make_transform, rotation_angle
from easyhecpp.render.reference_compiled import reference_coverage_compiled
from easyhecpp.sim.arm_surface import ArmSurface
from easyhecpp.sim.cell import Cell
from easyhecpp.sim.distractor import Distractor
from easyhecpp.sim.options import DIFFICULTIES, CellOptions
from easyhecpp.sim.placement import tripod_camera
from easyhecpp.sim.robots import load_robot
from easyhecpp.sim.sensor import Sensor, to_srgb
from easyhecpp.sim.studio import Quality

SMALL = CellOptions(width=160, height=90, distractor=0.0)
ROUGH = Quality(samples=2, depth=1)


def make(seed: int = 1, robot: str = "xarm7", **changes) -> Cell:
    return Cell.random(robot, np.random.default_rng(seed), options=replace(SMALL, **changes))


@pytest.fixture(scope="module")
def cell() -> Cell:
    return make()


@pytest.fixture(scope="module")
def joints(cell) -> np.ndarray:
    return cell.random_joints(3, np.random.default_rng(2))


@pytest.fixture
def tracer():
    return pytest.importorskip("mitsuba", reason="path-traced pictures need the extra sim")


def test_pictures_are_the_same_for_the_same_seed(tracer, cell, joints):
    first = cell.capture(joints[:2], quality=ROUGH)
    again = make().capture(joints[:2], quality=ROUGH)
    for a, b in zip(first, again, strict=True):
        assert a.image.shape == (90, 160, 3)
        assert a.image.dtype == np.uint8
        assert np.array_equal(a.image, b.image)
        assert np.array_equal(a.truth.coverage, b.truth.coverage)
    alone = cell.capture(joints[1], quality=ROUGH, first_index=1)[0]
    assert np.array_equal(alone.image, first[1].image)
    assert alone.as_view().id == "0001"


def test_noise_depends_on_the_number_of_the_picture(tracer, cell, joints):
    a, b = (cell.capture(joints[0], quality=ROUGH, first_index=k)[0] for k in (0, 1))
    difference = a.image.astype(int) - b.image
    assert 0.2 < np.abs(difference).mean() < 20
    assert np.array_equal(a.mask, b.mask)


def test_arms_and_rooms_are_neither_black_nor_blown_out(tracer):
    for seed in (3, 4, 5):
        view = make(seed).capture(load_robot("xarm7").neutral, quality=ROUGH)[0]
        arm = view.image[view.mask].mean(axis=-1)
        assert np.percentile(arm, 95) > 40
        assert (arm > 253).mean() < 0.2
        assert 10 < view.image.mean() < 235
        assert view.image.std() > 10


def test_another_seed_is_another_cell(cell):
    other = make(2)
    assert not np.allclose(other.T_mount_cam, cell.T_mount_cam)
    assert other.camera != cell.camera


def test_random_poses_are_in_view_above_the_table_within_limits(cell):
    joints = cell.random_joints(12, np.random.default_rng(5))
    robot, surface = cell.robot, ArmSurface.of(cell.robot)
    assert joints.shape == (12, robot.n_joints)
    assert (joints >= robot.lower).all()
    assert (joints <= robot.upper).all()
    moving = surface.in_base(joints)[:, surface.moves]
    assert moving[..., 2].min() > cell.stand_z
    assert surface.share_in_view(cell.camera, cell.T_mount_cam, joints).min() > 0.6
    assert not any(surface.collides(q) for q in joints)
    again = cell.random_joints(12, np.random.default_rng(5))
    assert np.array_equal(joints, again)


def test_the_camera_stands_where_the_options_say():
    robot = load_robot("xarm7")
    poses = ArmSurface.of(robot).draw_poses(64, np.random.default_rng(0))
    middle = robot.centre(poses).mean(axis=0)
    for seed in range(30):
        T_base_cam = tripod_camera(
            np.random.default_rng(seed),
            robot,
            0.0,
            azimuth_deg=30.0,
            elevation_deg=(20.0, 40.0),
            distance=(1.0, 1.2),
        )
        offset = T_base_cam[:3, 3] - middle
        away = np.linalg.norm(offset)
        assert 0.8 < away < 1.4
        assert 8 < np.degrees(np.arcsin(offset[2] / away)) < 52
        assert abs(np.degrees(np.arctan2(offset[1], offset[0]))) < 45
        assert T_base_cam[:3, 2] @ -offset / away > np.cos(np.radians(12))


def test_a_camera_may_be_turned_about_its_axis():
    def tilts(roll_deg):
        cameras = [
            tripod_camera(
                np.random.default_rng(seed),
                load_robot("xarm7"),
                0.0,
                azimuth_deg=30.0,
                elevation_deg=(20.0, 40.0),
                distance=(1.0, 1.2),
                roll_deg=roll_deg,
            )
            for seed in range(40)
        ]
        # Which way is up in the picture, seen along its x axis and against its y axis.
        return np.array([np.arctan2(-T[2, 0], -T[2, 1]) for T in cameras])

    assert np.degrees(np.abs(tilts(0.0))).max() < 8.0
    any_way = np.degrees(tilts(180.0))
    assert any_way.min() < -140.0
    assert any_way.max() > 140.0


def test_without_a_second_arm_only_clutter_can_hide_the_arm(joints):
    bare = make(clutter=(0, 0))
    for q in joints:
        Ts_cam_link = bare.rig.Ts_cam_link(bare.T_mount_cam, q)
        alone = reference_coverage_compiled(bare.robot.meshes, bare.camera, Ts_cam_link, 5)
        seen = bare.truth(q).coverage
        assert (seen <= alone).all()
        assert seen.sum() > 0.97 * alone.sum()  # the table may hide the rim of the base


def test_moving_the_camera_moves_what_it_sees_but_not_the_room(tracer, cell, joints):
    shifted = cell.T_mount_cam @ make_transform(np.eye(3), np.array([0.05, 0.0, 0.0]))
    moved = cell.with_camera(shifted)
    assert moved.surroundings is cell.surroundings
    a, b = cell.truth(joints[0]).mask, moved.truth(joints[0]).mask
    assert (a != b).any()
    assert moved.capture(joints[0], quality=ROUGH)[0].image.shape == (90, 160, 3)
    assert np.array_equal(cell.truth(joints[0]).mask, a)


def test_a_camera_on_the_wrist_rides_along_and_sees_the_arm():
    cell = make(1, setup="eye-in-hand")
    assert cell.rig.mount == "link7"
    joints = cell.random_joints(3, np.random.default_rng(1))
    for q in joints:
        T_base_ee = cell.robot.frame_pose(q, "link7")
        assert np.allclose(inverse(T_base_ee) @ cell.T_base_cam(q), cell.T_mount_cam)
        assert 0.005 < cell.truth(q).mask.mean() < 0.8
    turn = inverse(cell.T_base_cam(joints[0])) @ cell.T_base_cam(joints[1])
    assert rotation_angle(turn[:3, :3]) > 0.1


def test_a_second_arm_keeps_its_distance_and_moves_only_if_told(joints):
    poses = {}
    for moves in (0.0, 1.0):
        cell = make(7, distractor=1.0, distractor_moves=moves, same_arm=1.0)
        second = cell.distractor
        assert isinstance(second, Distractor)
        arm = ArmSurface.of(cell.robot).in_base(joints[0])
        poses[moves] = [second.joints(view, arm) for view in range(3)]
        other = ArmSurface.of(second.robot).in_base(poses[moves][0])
        other = other @ second.T_base_other[:3, :3].T + second.T_base_other[:3, 3]
        gaps = np.linalg.norm(arm[:, None] - other[None], axis=-1)
        assert gaps.min() > 0.04
    assert np.array_equal(poses[0.0][0], poses[0.0][1])
    assert not np.array_equal(poses[1.0][0], poses[1.0][1])


def test_difficulties_are_known_by_name():
    assert DIFFICULTIES["hard"].distractor > DIFFICULTIES["normal"].distractor
    with pytest.raises(InputError, match="easy, normal, anywhere, hard"):
        Cell.random("xarm7", np.random.default_rng(0), difficulty="brutal")
    with pytest.raises(InputError, match="picture quality"):
        make().capture(np.zeros(7), quality="best")


def test_poses_that_no_camera_sees_are_an_error_with_advice(cell):
    away = cell.with_camera(cell.T_mount_cam @ np.diag([-1.0, 1.0, -1.0, 1.0]))
    with pytest.raises(InputError, match="random poses"):
        away.random_joints(1, np.random.default_rng(0))


def test_the_tone_curve_is_the_srgb_one_below_the_highlights_and_rises_above():
    level = np.array([[[0.0, 0.0031308, 0.21586]]], np.float32)
    assert to_srgb(level).tolist() == [[[0, 10, 128]]]
    ramp = to_srgb(np.linspace(0, 3, 400, dtype=np.float32).reshape(-1, 1, 1).repeat(3, 2))
    assert (np.diff(ramp[:, 0, 0].astype(int)) >= 0).all()
    assert ramp[-1, 0, 0] == 255


def test_sensor_noise_has_the_strength_that_it_claims():
    sensor = Sensor(blur_px=0.0, full_well=1000.0, read_noise=0.0)
    flat = np.full((200, 200, 3), 0.2, np.float32)
    image = sensor.develop(flat, 1.0, np.random.default_rng(0)).astype(float) / 255
    linear = ((image + 0.055) / 1.055) ** 2.4
    assert linear.std() == pytest.approx(np.sqrt(0.2 / 1000), rel=0.05)
    assert linear.mean() == pytest.approx(0.2, abs=0.003)
