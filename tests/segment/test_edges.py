from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from composites import encode
from scenes_small import photographed
from scipy.special import ndtr

from easyhecpp.geometry import inverse, log_se3, perturb_about, pose_error
from easyhecpp.segment._edge_kernel import AGAINST_PLATE, COLOUR, NONE, find_edges
from easyhecpp.segment._rim_kernel import BEYOND, STEP, WITHIN
from easyhecpp.segment.backgrounds import Backgrounds
from easyhecpp.segment.edge_reading import EdgeReader
from easyhecpp.segment.edge_rim import RimModel
from easyhecpp.segment.edges import UnseenCost, refine_edges
from easyhecpp.segment.scene import Scene
from easyhecpp.solve import Observation, SolveConfig, solve_pose


def _edge_picture(
    at: float,
    inside: float,
    outside: float | np.ndarray,
    width: int = 60,
    fade_px: float = 1e-6,
    at_rim: float = 0.0,
    blur_px: float = 0.6,
) -> np.ndarray:
    """Arm left of ``at`` (in pixels, between centres), mixed in linear light.

    Over ``fade_px`` inside of the edge the arm's light falls to the share ``at_rim``, the rest is
    the background's.
    """
    fine = np.zeros((20, width * 16, 3))
    x = (np.arange(width * 16) + 0.5) / 16 - 0.5
    arm = np.where(x < at, at_rim + (1.0 - at_rim) * np.clip((at - x) / fade_px, 0.0, 1.0), 0.0)
    behind = outside if np.ndim(outside) == 0 else np.interp(x, np.arange(width), outside)
    fine[:] = (behind + (inside - behind) * arm)[None, :, None]
    light = cv2.GaussianBlur(fine, (0, 0), blur_px * 16).reshape(20, width, 16, 3).mean(axis=2)
    return (255.0 * encode(light)).astype(np.float32)


def _taps() -> np.ndarray:
    k = np.arange(-5, 6)
    taps = k * np.exp(-0.5 * np.square(k / 2.0))
    return taps / (np.sum(taps * k) * 0.5)


def _find(picture, plate, at, reach=6.0, noise=1.0):
    covered = np.zeros(picture.shape[:2], np.uint8)
    covered[:, : int(at) + 1] = 1
    points, normals = np.array([[at, 10.0]]), np.array([[1.0, 0.0]])
    offset, contrast, misfit = np.zeros(1), np.zeros(1), np.zeros(1)
    kind = np.zeros(1, np.int8)
    # A lens of 0.6, the pixels themselves (0.29), and what is mixed between two of them (0.35).
    rim = RimModel.behind(0.75)
    find_edges(
        picture, plate, covered, points, normals, reach, _taps(), noise,
        rim.shifts, rim.explains, rim.step_width_px, offset, contrast, misfit, kind,
    )  # fmt: skip
    return float(offset[0]), int(kind[0])


@pytest.mark.parametrize("at", [28.0, 29.3, 30.5, 31.8])
@pytest.mark.parametrize(("inside", "outside"), [(0.7, 0.1), (0.05, 0.5)])
def test_an_edge_is_found_to_a_twentieth_of_a_pixel(at, inside, outside):
    picture = _edge_picture(at, inside, outside)
    plate = np.full_like(picture, 255.0 * encode(np.array(outside)))
    offset, kind = _find(picture, plate, 30.0)
    assert kind == AGAINST_PLATE
    assert offset == pytest.approx(at - 30.0, abs=0.05)
    offset, kind = _find(picture, np.full_like(picture, np.nan), 30.0)
    assert kind == COLOUR
    assert offset == pytest.approx(at - 30.0, abs=0.05)


@pytest.mark.parametrize("fade_px", [4.0, 8.0])
@pytest.mark.parametrize("at", [29.3, 30.5])
def test_a_rim_that_fades_towards_the_background_is_found_where_it_ends(at, fade_px):
    # A curved surface: a fifth of its light at the rim, all of it some pixels inside.
    picture = _edge_picture(at, 0.6, 0.15, fade_px=fade_px, at_rim=0.2)
    plate = np.full_like(picture, 255.0 * encode(np.array(0.15)))
    offset, kind = _find(picture, plate, 30.0)
    assert kind == AGAINST_PLATE
    assert offset == pytest.approx(at - 30.0, abs=0.2)
    steepest, _ = _find(picture, np.full_like(picture, np.nan), 30.0)
    assert steepest < at - 30.0 - 0.4


def test_the_arms_own_shadow_on_a_textured_background_is_no_edge():
    wall = 0.4 + 0.1 * np.sin(np.arange(60) / 2.0)
    plate = _edge_picture(-100.0, 0.0, wall)
    picture = _edge_picture(29.6, 0.7, 0.45 * wall)
    offset, kind = _find(picture, plate, 30.0)
    assert kind == AGAINST_PLATE
    assert offset == pytest.approx(-0.4, abs=0.1)


def test_the_rims_own_model_explains_step_and_ramp_and_nothing_else():
    rim = RimModel.behind(0.7)
    z = (rim.shifts[10] - np.arange(-WITHIN, BEYOND + 1) * STEP) / 0.7
    step = ndtr(z)
    left = [float(step @ step - np.square(pair @ step).sum()) for pair in rim.explains]
    assert int(np.argmin(left)) == 10
    assert left[10] == pytest.approx(0.0, abs=1e-4)
    assert min(left[:9] + left[12:]) > 1e-3
    assert rim.step_width_px == pytest.approx(0.5 / (0.5 * (ndtr(1 / 0.7) - ndtr(-1 / 0.7))))


def test_the_cameras_blur_is_measured_from_its_edges():
    case = photographed(0)
    scene = Scene(case.rig, case.camera, case.joints)

    def measured(images):
        reader = EdgeReader(Backgrounds(scene, images, case.T_mount_cam))
        reader.measure_blur(case.T_mount_cam)
        return reader.rim.blur_px

    sharp = measured(case.images)
    for more in (0.5, 0.9):
        blurred = [cv2.GaussianBlur(image, (0, 0), more) for image in case.images]
        assert measured(blurred) == pytest.approx(np.hypot(sharp, more), rel=0.12)


def test_texture_of_arm_and_background_is_no_edge_when_the_background_is_known():
    picture = _edge_picture(29.5, 0.6, 0.2)
    plate = np.full_like(picture, 255.0 * encode(np.array(0.2)))
    for image in (picture, plate):
        image[:, 33:] *= 0.5  # a stripe of the wall, in the picture and in the plate
    picture[:, :27] *= 0.6  # a stripe of the arm
    offset, kind = _find(picture, plate, 30.0)
    assert kind == AGAINST_PLATE
    assert offset == pytest.approx(-0.5, abs=0.1)


def test_an_unknown_thing_outside_silences_the_line():
    picture = _edge_picture(29.5, 0.6, 0.2)
    plate = np.full_like(picture, 255.0 * encode(np.array(0.2)))
    picture[:, 34:] += 60.0
    assert _find(picture, plate, 30.0)[1] == NONE


def test_the_edge_stage_finds_the_truth_from_a_few_pixels_away():
    case = photographed(0, exposures=(1.0, 0.9, 1.06))
    start = _start(case, np.array([0.004, -0.003, 0.006, 0.006, -0.005, 0.006]))
    scene = Scene(case.rig, case.camera, case.joints)
    refined = refine_edges(Backgrounds(scene, case.images, start.T_mount_cam), start)
    assert refined.accepted, refined.reason
    before = pose_error(start.T_mount_cam, case.T_mount_cam)
    after = pose_error(refined.estimate.T_mount_cam, case.T_mount_cam)
    assert after[0] < 0.5 * before[0]
    assert after[0] < 0.0015
    assert after[1] < np.deg2rad(0.06)
    assert refined.support.share > 0.8
    assert abs(refined.estimate.dilation_px) < 0.15


def test_a_lens_that_nobody_stated_is_found_with_the_pose():
    case = photographed(1, n_views=8, lens=(0.16, -0.25, 0.0, 0.0, 0.0))
    unstated = replace(case, camera=replace(case.camera, distortion_model="none", distortion=()))
    start = _start(unstated, np.zeros(6))
    scene = Scene(case.rig, unstated.camera, case.joints)
    refined = refine_edges(Backgrounds(scene, case.images, start.T_mount_cam), start)
    assert refined.accepted, refined.reason
    assert [c.name for c in refined.corrections] == ["k1", "k2"]
    off = np.array(refined.camera.distortion[:2]) - case.camera.distortion[:2]
    assert (np.abs(off) < 3.0 * np.array([c.sigma for c in refined.corrections])).all()
    # What it bends matters, not the numbers: where the arm is, to a fraction of a pixel.
    points = np.concatenate([c.points for c in refined.estimate.contours])
    bends = refined.camera.project(case.camera.unproject(points)) - points
    assert np.quantile(np.linalg.norm(bends, axis=1), 0.9) < 0.4
    step = log_se3(inverse(refined.estimate.T_mount_cam) @ case.T_mount_cam)
    assert step @ np.linalg.solve(refined.estimate.covariance, step) < 22.5
    # Told the right lens, the edges leave it alone.
    told = Scene(case.rig, case.camera, case.joints)
    known = refine_edges(Backgrounds(told, case.images, start.T_mount_cam), start)
    assert known.corrections == ()
    assert known.camera is case.camera


@pytest.mark.parametrize("seed", [0, 2])
def test_joint_zeros_that_are_off_are_found_with_the_pose(seed):
    case = photographed(seed, n_views=8)
    rng = np.random.default_rng(seed)
    off = np.deg2rad(0.3) * rng.choice([-1.0, 1.0], case.rig.robot.n_joints)
    off[0] = 0.0  # the base turned looks the same
    recorded = [q - off for q in case.joints]
    start = _start(case, np.zeros(6), recorded)
    scene = Scene(case.rig, case.camera, recorded)
    refined = refine_edges(Backgrounds(scene, case.images, start.T_mount_cam), start)
    assert refined.accepted, refined.reason
    # The first joint turns the arm as the pose does: it is taken at its word.
    assert [c.name for c in refined.corrections] == list(case.rig.robot.joint_names[1:])
    assert (refined.joint_offsets[:, 0] == 0.0).all()
    sigma = np.array([c.sigma for c in refined.corrections])
    assert (np.abs(refined.joint_offsets - off)[:, 1:] < 3.5 * sigma).all()
    before = pose_error(start.T_mount_cam, case.T_mount_cam)[0]
    after = pose_error(refined.estimate.T_mount_cam, case.T_mount_cam)[0]
    assert after < 0.5 * before
    step = log_se3(inverse(refined.estimate.T_mount_cam) @ case.T_mount_cam)
    assert step @ np.linalg.solve(refined.estimate.covariance, step) < 22.5


@pytest.mark.parametrize("seed", [0, 2])
def test_an_arm_that_sags_is_found_as_it_hangs(seed):
    case = photographed(seed, n_views=8)
    give = 7e-3
    hangs = give * case.rig.robot.sag(np.stack(case.joints))
    recorded = list(np.stack(case.joints) - hangs)
    start = _start(case, np.zeros(6), recorded)
    scene = Scene(case.rig, case.camera, recorded)
    refined = refine_edges(Backgrounds(scene, case.images, start.T_mount_cam), start)
    assert refined.accepted, refined.reason
    (sag,) = refined.corrections
    assert sag.name == "sag"
    assert abs(sag.value - give) < 3.5 * sag.sigma
    assert sag.sigma < 0.2 * give
    assert refined.joint_offsets == pytest.approx(hangs * sag.value / give, abs=1e-4)
    after = pose_error(refined.estimate.T_mount_cam, case.T_mount_cam)[0]
    assert after < 0.5 * pose_error(start.T_mount_cam, case.T_mount_cam)[0]
    step = log_se3(inverse(refined.estimate.T_mount_cam) @ case.T_mount_cam)
    assert step @ np.linalg.solve(refined.estimate.covariance, step) < 22.5


@pytest.mark.parametrize("seed", [4, 6])
def test_joints_that_err_afresh_in_every_view_are_no_zeros_and_no_sure_sag(seed):
    case = photographed(seed, n_views=8)
    rng = np.random.default_rng(seed)
    recorded = [q + 2e-3 * rng.standard_normal(len(q)) for q in case.joints]
    start = _start(case, np.zeros(6), recorded)
    scene = Scene(case.rig, case.camera, recorded)
    refined = refine_edges(Backgrounds(scene, case.images, start.T_mount_cam), start)
    # Chance may look like a little sag; its error bar then says that it is none.
    assert all(c.name == "sag" and abs(c.z) < 2.5 for c in refined.corrections)
    step = log_se3(inverse(refined.estimate.T_mount_cam) @ case.T_mount_cam)
    assert step @ np.linalg.solve(refined.estimate.covariance, step) < 22.5


def test_a_straight_lens_and_exact_joints_stay_as_they_are():
    for seed in (0, 1, 2):
        case = photographed(seed)
        start = _start(case, np.zeros(6))
        scene = Scene(case.rig, case.camera, case.joints)
        refined = refine_edges(Backgrounds(scene, case.images, case.T_mount_cam), start)
        assert refined.corrections == ()
        assert refined.camera is case.camera
        assert not refined.joint_offsets.any()


def test_a_pose_that_is_right_stays_right():
    case = photographed(3)
    start = _start(case, np.zeros(6))
    scene = Scene(case.rig, case.camera, case.joints)
    refined = refine_edges(Backgrounds(scene, case.images, case.T_mount_cam), start)
    assert pose_error(refined.estimate.T_mount_cam, case.T_mount_cam)[0] < 0.0015


def test_pictures_without_the_arm_do_not_move_the_pose():
    case = photographed(0)
    start = _start(case, np.zeros(6))
    scene = Scene(case.rig, case.camera, case.joints)
    rng = np.random.default_rng(0)
    empty = [rng.integers(90, 110, case.images[0].shape).astype(np.uint8) for _ in case.images]
    refined = refine_edges(Backgrounds(scene, empty, start.T_mount_cam), start)
    assert not refined.accepted
    assert refined.estimate is start
    assert refined.support.share < 0.2


def test_support_tells_a_right_pose_from_a_wrong_one():
    case = photographed(0)
    scene = Scene(case.rig, case.camera, case.joints)
    T_cam = inverse(case.T_mount_cam)
    wrong = inverse(
        perturb_about(T_cam, scene.centre_cam(T_cam), np.array([0.05, 0.03, 0, 0, 0, 0.2]))
    )
    right = EdgeReader(Backgrounds(scene, case.images, case.T_mount_cam)).support(case.T_mount_cam)
    other = EdgeReader(Backgrounds(scene, case.images, wrong)).support(wrong)
    assert right.share > 0.75
    assert other.share < 0.36


def _start(case, delta, recorded=None):
    """An estimate from masks that are off by ``delta`` about the arm's middle.

    The joints are as recorded, if they are not those of the masks.
    """
    scene = Scene(case.rig, case.camera, case.joints)
    T_cam = inverse(case.T_mount_cam)
    T = inverse(perturb_about(T_cam, scene.centre_cam(T_cam), delta))
    covers = scene.coverages(inverse(T), 1)
    seen = [
        Observation(q, cover > 0.5, id=str(i))
        for i, (q, cover) in enumerate(
            zip(case.joints if recorded is None else recorded, covers, strict=True)
        )
    ]
    return solve_pose(case.rig, case.camera, seen, T, SolveConfig(start_error_px=4.0))


@pytest.mark.parametrize(
    ("after", "better", "words"),
    [
        (0.10, True, "lie closer to the edges than before: cost 0.1000, before 0.1200."),
        (0.122, True, "about as close to the edges as before: cost 0.1220, before 0.1200."),
        (0.13, False, "lie no closer to the edges than before: cost 0.1300, before 0.1200."),
    ],
)
def test_the_costs_are_told_as_measured_and_what_decided(after, better, words):
    cost = UnseenCost(0.12, after, 0.05)
    assert cost.better is better
    assert words in cost.reason
    assert ("5.0% less, which decided" in cost.reason) == (better and after > 0.12)
