from __future__ import annotations

import numpy as np
import pytest
from scenes_small import photographed

from easyhecpp.camera import Camera
from easyhecpp.geometry import (
    exp_so3,
    inverse,
    perturb_about,
    pose_error,
    rotation_angle,
    transform_points,
)
from easyhecpp.segment.classical.change import change_maps, pairs_to_compare
from easyhecpp.segment.classical.climb import climb
from easyhecpp.segment.classical.grid import TURNED, UPRIGHT
from easyhecpp.segment.classical.lines import line_posteriors
from easyhecpp.segment.classical.plate import PlateConfig, plate_distance, plate_maker
from easyhecpp.segment.classical.region import Round, fit_regions
from easyhecpp.segment.classical.search import (
    PairScore,
    Scored,
    distinct,
    informative_pairs,
    search,
)
from easyhecpp.segment.pictures import Pictures, equalised, load_pictures
from easyhecpp.segment.scene import Scene

ONE_PAIR = np.array([[0, 1]], np.int32)


def test_exposure_and_white_balance_are_recovered_though_half_of_the_pictures_change():
    rng = np.random.default_rng(0)
    still = rng.uniform(40, 180, (90, 160, 3))
    balances = ((1, 1, 1), (1.2, 1.2, 1.2), (0.8, 1.0, 1.25), (1.1, 0.9, 0.8), (1, 1, 1))
    pictures = np.stack([still * balance for balance in balances])
    for view in range(len(pictures)):
        pictures[view, :, 30 * view : 30 * view + 40] = 5.0
    equal = equalised(list(pictures.astype(np.float32)))
    for view in range(1, len(pictures)):
        # Where neither this picture nor the one before shows the arm.
        both = [i for i in range(160) if not 30 * (view - 1) <= i < 30 * view + 40]
        assert np.abs(equal[view, :, both] - equal[view - 1, :, both]).max() < 1.0


def test_the_edge_of_a_change_lies_at_half_height_however_strong_it_is():
    for height in (15.0, 60.0):
        lab = np.full((2, 60, 80, 3), 40.0, np.float32)
        lab[1, :, 40:, 0] += height
        maps = change_maps(Pictures(lab, 0.6, 4), ONE_PAIR).maps[0]
        assert (maps[30, 42:70] > 0).all()
        assert (maps[30, 10:38] < 0).all()
        crossing = np.flatnonzero(np.diff(np.sign(maps[30])))
        assert len(crossing) == 1
        assert abs(crossing[0] + 0.5 - 39.5) <= 1.0


@pytest.mark.parametrize("shift", [-3, 0, 2, 4])
def test_a_line_finds_where_the_evidence_turns(shift):
    evidence = np.full((40, 60), -0.8, np.float32)
    evidence[:, : 30 + shift] = 0.8
    coverage = np.zeros((40, 60), np.float32)
    coverage[:, :30] = 1.0
    points, normals = np.array([[29.5, 20.0]]), np.array([[1.0, 0.0]])
    mean, weight = np.empty(1), np.empty(1)
    line_posteriors(evidence, coverage, points, normals, 8, 3.0, 4.8, True, mean, weight)
    assert weight[0] > 1.0
    assert mean[0] == pytest.approx(shift, abs=0.3)


def test_a_line_is_silent_where_the_background_is_unknown_or_nothing_differs():
    coverage = np.zeros((40, 60), np.float32)
    coverage[:, :30] = 1.0
    points, normals = np.array([[29.5, 20.0]]), np.array([[1.0, 0.0]])
    mean, weight = np.empty(1), np.empty(1)
    unknown = np.full((40, 60), np.nan, np.float32)
    line_posteriors(unknown, coverage, points, normals, 8, 3.0, 4.8, False, mean, weight)
    assert weight[0] == 0.0
    same = np.full((40, 60), -0.9, np.float32)
    line_posteriors(same, coverage, points, normals, 8, 3.0, 4.8, True, mean, weight)
    assert weight[0] == 0.0


def test_the_plate_has_several_states_and_may_hold_a_wrong_view():
    lab = np.zeros((6, 3, 3, 3), np.float32)
    lab[3:, ..., 0] = 50.0
    covers = np.zeros((6, 3, 3), np.float32)
    band = np.ones((3, 3), np.uint8)
    out = np.empty((3, 3), np.float32)
    for view in range(6):
        plate_distance(lab, covers, view, band, 0.02, out)
        assert (out == 0.0).all()
    # A single other view that looks the same may be an arm that was not predicted there.
    lab[:] = 0.0
    lab[0, ..., 0] = lab[5, ..., 0] = 30.0
    plate_distance(lab, covers, 0, band, 0.02, out)
    assert (out == 30.0).all()


def test_pairs_use_every_view_and_prefer_change():
    rng = np.random.default_rng(1)
    i, j = np.triu_indices(6, k=1)
    pairs = np.column_stack([i, j]).astype(np.int32)
    maps = rng.uniform(-1, 1, (len(pairs), 5, 5)).astype(np.float32)
    maps[0] = -1.0
    chosen = informative_pairs(maps, pairs, 8)
    assert len(set(chosen)) == 8
    assert 0 not in chosen
    assert set(pairs[chosen].ravel()) == set(range(6))


def test_few_views_are_all_compared_and_many_each_with_some():
    rng = np.random.default_rng(0)
    for n in (3, 12):
        motion = rng.uniform(size=(n, n))
        i, j = np.triu_indices(n, k=1)
        np.testing.assert_array_equal(pairs_to_compare(motion + motion.T), np.column_stack([i, j]))
    where = rng.uniform(size=(60, 2))
    motion = np.linalg.norm(where[:, None] - where[None], axis=-1)
    pairs = pairs_to_compare(motion)
    assert len(pairs) == 66 + 3 * 48
    assert len(np.unique(pairs, axis=0)) == len(pairs)
    assert (pairs[:, 0] < pairs[:, 1]).all()
    assert set(pairs.ravel()) == set(range(60))
    i, j = np.triu_indices(60, k=1)
    assert motion[pairs[:, 0], pairs[:, 1]].mean() > 1.2 * motion[i, j].mean()


def test_distinct_keeps_the_best_of_each_group():
    T = np.eye(4)
    near, far = T.copy(), T.copy()
    near[0, 3], far[0, 3] = 0.01, 1.0
    found = [Scored(T, 0.5), Scored(near, 0.9), Scored(far, 0.1)]
    kept = distinct(found, 5, metres=0.1, radians=0.1)
    assert [k.score for k in kept] == [0.9, 0.1]


def test_seeds_look_at_the_arm_from_all_sides_and_from_below():
    scene = _scene()
    seeds = UPRIGHT.poses(scene)
    ahead = seeds[:, :3, 2]
    towards = scene.centre_mount - seeds[:, :3, 3]
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    np.testing.assert_allclose(np.sum(ahead * towards, axis=1), 1.0, atol=1e-9)
    assert seeds[:, 2, 3].min() < scene.centre_mount[2] - 0.2


def test_a_seed_is_turned_to_where_the_change_is():
    case, scene = photographed(2), _scene()
    changes = change_maps(
        load_pictures(case.images, case.camera, 4), pairs_to_compare(scene.motion)
    )
    T_cam_mount = inverse(case.T_mount_cam)
    turn = perturb_about(T_cam_mount, np.zeros(3), np.array([0, 0, 0, 0.06, -0.05, 0.0]))
    size = {"size_px": 80, "max_pairs": 8}
    best = search(scene, changes, inverse(turn)[None], np.zeros(1), keep=1, **size)[0]
    assert pose_error(best.T_mount_cam, case.T_mount_cam)[1] < np.deg2rad(1.5)
    score = PairScore(scene, changes, 0.3)
    assert score(best.T_mount_cam) > score(inverse(turn))
    assert score(case.T_mount_cam) > 0.5


def test_a_seed_is_tried_at_every_turn_about_its_axis():
    case, scene = photographed(2), _scene()
    changes = change_maps(
        load_pictures(case.images, case.camera, 4), pairs_to_compare(scene.motion)
    )
    turns = TURNED.turns
    for k in (3, 11, 20):
        off = inverse(perturb_about(np.eye(4), np.zeros(3), np.array([0, 0, 0, 0, 0, turns[k]])))
        seed = case.T_mount_cam @ off
        found = search(scene, changes, seed[None], turns, size_px=80, max_pairs=8, keep=30)
        scores = [s.score for s in found]
        assert scores == sorted(scores, reverse=True)
        assert pose_error(found[0].T_mount_cam, case.T_mount_cam)[1] < np.deg2rad(2.0)
        assert scores[0] > 1.5 * scores[1]


def test_the_turned_seeds_leave_no_camera_far_from_a_seed():
    scene = _scene()
    seeds, turns = TURNED.poses(scene)[:, :3, :3], exp_so3(np.outer(TURNED.turns, [0, 0, 1]))
    every = np.unique((seeds[:, None] @ turns).reshape(-1, 9).round(6), axis=0).reshape(-1, 3, 3)
    rng = np.random.default_rng(0)
    for wanted in exp_so3(rng.normal(size=(200, 3)) * 2.0):
        # The nearest seed looks along nearly the same line and is turned nearly the same.
        assert np.degrees(rotation_angle(wanted.T @ every).min()) < 20.0


def test_a_seed_climbs_to_the_truth():
    case, scene = photographed(2), _scene()
    changes = change_maps(
        load_pictures(case.images, case.camera, 4), pairs_to_compare(scene.motion)
    )
    T_cam_mount = inverse(case.T_mount_cam)
    centre = scene.centre_cam(T_cam_mount)
    off = np.array([0.06, -0.05, 0.1, 0.12, -0.1, 0.1]) * np.array([*[centre[2]] * 3, 1, 1, 1])
    start = inverse(perturb_about(T_cam_mount, centre, off))
    score = PairScore(scene, changes, 0.1)
    found = climb(score, scene, start, step=1.0, evaluations=250)
    assert found.score == pytest.approx(score(found.T_mount_cam))
    assert found.score > 0.95 * score(case.T_mount_cam)
    assert _contour_error(scene, case, start) > 30.0
    assert _contour_error(scene, case, found.T_mount_cam) < 6.0


def test_a_shadow_is_no_change_beside_the_arm():
    rng = np.random.default_rng(4)
    wall = np.full((60, 80, 3), 120.0) + rng.normal(0.0, 1.0, (2, 60, 80, 3))
    wall[0, 20:40, 10:30] = 230.0
    y, x = np.mgrid[:60, :80]
    wall[0] *= 1.0 - 0.12 * np.exp(-((x - 60.0) ** 2 + (y - 30.0) ** 2) / 150.0)[..., None]
    images = [np.clip(w, 0, 255).astype(np.uint8) for w in wall]
    camera = Camera(80, 60, 80.0, 80.0, 39.5, 29.5)
    change = change_maps(load_pictures(images, camera, 1), ONE_PAIR).maps[0]
    assert change[22:38, 12:28].mean() > 0.5
    assert change[20:40, 50:70].mean() < -0.3


def test_shadows_can_be_left_out_and_things_of_another_colour_cannot():
    rng = np.random.default_rng(6)
    table = np.array([150.0, 130.0, 100.0]) + rng.normal(0.0, 12.0, (60, 80, 1))
    pictures = table[None] + rng.normal(0.0, 1.0, (2, 60, 80, 3))
    pictures[0, 5:25, 5:25] *= 0.77  # a shadow: the table's texture shows through
    pictures[0, 5:25, 45:65] = 230.0, 230.0, 240.0  # a white arm
    pictures[0, 35:55, 5:25] = 40.0, 90.0, 150.0  # a blue one
    pictures[0, 35:55, 45:65] = 18.0, 15.0, 12.0  # a black one
    images = [np.clip(p, 0, 255).astype(np.uint8) for p in pictures]
    loaded = load_pictures(images, Camera(80, 60, 80.0, 80.0, 39.5, 29.5), 1)
    whole = change_maps(loaded, ONE_PAIR).maps[0]
    without = change_maps(loaded, ONE_PAIR, shadows=False).maps[0]
    assert whole[8:22, 8:22].mean() > 0.2
    assert without[8:22, 8:22].mean() < 0.05
    for rows, columns in ((8, 48), (38, 8), (38, 48)):
        inside = np.s_[rows : rows + 14, columns : columns + 14]
        assert without[inside].mean() > 0.9 * whole[inside].mean() > 0.4


def test_the_region_stage_brings_a_pose_home():
    case, scene = photographed(2), _scene()
    half = load_pictures(case.images, case.camera, 2)
    T_cam_mount = inverse(case.T_mount_cam)
    delta = np.array([0.008, -0.006, 0.01, 0.012, -0.01, 0.012])
    start = inverse(perturb_about(T_cam_mount, scene.centre_cam(T_cam_mount), delta))
    found = fit_regions(
        scene,
        start,
        2,
        plate_maker(half, PlateConfig(4, 16)),
        (Round(12, 6.0, 4), Round(6, 2.0, 4)),
    )
    assert _contour_error(scene, case, start) > 3.0
    assert _contour_error(scene, case, found) < 2.0


def _contour_error(scene, case, T_mount_cam) -> float:
    """Root mean square displacement of the contours, pixels."""
    T_cam_true = inverse(T_mount_cam) @ case.T_mount_cam
    squares = []
    for contour, _ in scene.contours(inverse(case.T_mount_cam), 1):
        moved = case.camera.project(transform_points(T_cam_true, contour.points_cam))
        squares.append(np.sum(np.square(moved - contour.points), axis=1))
    return float(np.sqrt(np.mean(np.concatenate(squares))))


def _scene() -> Scene:
    case = photographed(2)
    return Scene(case.rig, case.camera, case.joints)
