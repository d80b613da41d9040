from __future__ import annotations

from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from scenes_small import photographed

from easyhecpp.camera import Camera
from easyhecpp.errors import CalibrationError, InputError
from easyhecpp.geometry import pose_error
from easyhecpp.rig import Rig
from easyhecpp.segment.classical import calibrate_from_images
from easyhecpp.segment.classical.looks import Look, better_look, looked
from easyhecpp.segment.classical.search import Scored
from easyhecpp.segment.classical.segmenter import ClassicalConfig, ClassicalSegmenter


@pytest.mark.parametrize("seed", [0, 3])
def test_from_images_alone(seed):
    case = photographed(seed, n_views=6, exposures=(1.0, 0.9, 1.06))
    result = calibrate_from_images(case.rig, case.camera, case.images, case.joints)
    metres, radians = pose_error(result.T_mount_cam, case.T_mount_cam)
    assert metres < 0.003
    assert radians < np.deg2rad(0.12)
    assert result.sure, result.reasons
    for made, true in zip(result.masks, case.masks, strict=True):
        assert (made.mask & true).sum() / (made.mask | true).sum() > 0.95


@pytest.mark.parametrize("quarters", [1, 2])
def test_a_camera_on_its_side_or_upside_down(quarters):
    """Or one that stands upright before an arm on a wall or a ceiling."""
    case = photographed(3, n_views=6)
    images = [np.ascontiguousarray(np.rot90(image, quarters)) for image in case.images]
    camera, turn = case.camera, np.eye(4)
    for _ in range(quarters):
        # One turn, counter-clockwise as seen, takes (x, y) to (y, width - 1 - x).
        camera = Camera(
            camera.height, camera.width, camera.fy, camera.fx, camera.cy,
            camera.width - 1 - camera.cx,
        )  # fmt: skip
        turn[:3, :3] = turn[:3, :3] @ np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    result = calibrate_from_images(case.rig, camera, images, case.joints)
    metres, radians = pose_error(result.T_mount_cam, case.T_mount_cam @ turn)
    assert metres < 0.003
    assert radians < np.deg2rad(0.12)
    assert result.sure, result.reasons


def test_what_moves_besides_the_arm_does_no_harm():
    case = photographed(1)
    rng = np.random.default_rng(5)
    images = [image.copy() for image in case.images]
    for view, image in enumerate(images):
        x = 20 + 15 * (view // 2)
        image[40:160, x : x + 50] = rng.integers(0, 255, 3)
    result = calibrate_from_images(case.rig, case.camera, images, case.joints)
    assert pose_error(result.T_mount_cam, case.T_mount_cam)[0] < 0.005


@pytest.mark.parametrize("seed", [5, 6])
def test_an_arm_that_hardly_differs_from_the_background_is_found_beside_its_shadow(seed):
    """The shadow changes the pictures more than the arm does, and moves in another way."""
    case = photographed(seed, n_views=6)
    background = np.median(np.stack(case.images), axis=0)
    images = []
    for image, mask in zip(case.images, case.masks, strict=True):
        shade = np.roll(mask, (18, 40), (0, 1)).astype(np.float32)
        shade = 0.3 * np.asarray(cv2.GaussianBlur(shade, (0, 0), 4.0)) * ~mask
        faint = 0.7 * background + 0.3 * image
        seen = np.where(mask[..., None], faint, image - shade[..., None] * background)
        images.append(np.clip(seen, 0, 255).astype(np.uint8))
    result = calibrate_from_images(case.rig, case.camera, images, case.joints)
    metres, radians = pose_error(result.T_mount_cam, case.T_mount_cam)
    assert metres < 0.01
    assert radians < np.deg2rad(0.5)
    assert result.sure, result.reasons


class SixViews:
    """What the choice between two looks asks of the scene."""

    radius = 1.0
    camera = Camera(1000, 800, 800.0, 800.0, 499.5, 399.5)

    def __len__(self) -> int:
        return 6


def look_at(share: float, x: float, margin: float, length_px: float = 9000.0) -> Look:
    """A look that came to a camera at ``x`` metres, with edges on that share of the outline."""
    T = np.eye(4)
    T[0, 3] = x
    refinement = SimpleNamespace(
        support=SimpleNamespace(share=share, length_px=length_px, covered=0.1),
        estimate=SimpleNamespace(T_mount_cam=T),
    )
    segmenter = SimpleNamespace(scene=SixViews(), config=ClassicalConfig(), something_moved=True)
    segmenter.without_shadows = segmenter.thorough = lambda: segmenter
    return Look(segmenter, (), margin, T, None, refinement, ())


@pytest.mark.parametrize(
    ("first", "second", "better", "margin"),
    [
        # The same pose twice: what stood beside it in either look does not matter.
        (look_at(0.7, 0.0, 0.1), look_at(0.71, 0.002, 0.6), "second", 0.6),
        (look_at(0.71, 0.0, 0.1), look_at(0.7, 0.002, 0.6), "first", 0.6),
        # The edges tell two poses apart.
        (look_at(0.1, 0.0, 0.1), look_at(0.7, 0.4, 0.6), "second", 0.6),
        (look_at(0.7, 0.0, 0.1), look_at(0.1, 0.4, 0.6), "first", 0.1),
        # They do not: neither is sure.
        (look_at(0.5, 0.0, 0.1), look_at(0.65, 0.4, 0.6), "second", 0.0),
        (look_at(0.2, 0.0, 0.1), look_at(0.5, 0.4, 0.6), "second", 0.0),
        # A little of an outline lies on edges by chance.
        (look_at(0.66, 0.0, 0.1), look_at(0.95, 0.4, 0.6, 2000.0), "first", 0.0),
    ],
)
def test_of_two_looks_the_edges_choose(first, second, better, margin):
    found = better_look(first, second)
    wanted = {"first": first, "second": second}[better]
    assert found.refinement is wanted.refinement
    assert found.margin == margin


def looks(monkeypatch, *results: Look | CalibrationError) -> list[int]:
    """Let the looks come to these results; the list grows with every look."""
    taken: list[int] = []

    def of(segmenter, lap):
        taken.append(len(taken))
        result = results[len(taken) - 1]
        if isinstance(result, CalibrationError):
            raise result
        return result

    monkeypatch.setattr(Look, "of", of)
    return taken


class Unsettled:
    """A segmenter whose masks stay at the pose they are made at, and edges move it on."""

    scene = SixViews()
    config = ClassicalConfig()

    def __init__(self, steps: list[float], share: float) -> None:
        self.steps, self.share, self.started_at = steps, share, []

    def first_pose(self):
        return [Scored(np.eye(4), 0.5)]

    def settle(self, candidates):
        return candidates

    def anew(self):
        return self

    def masks_at(self, T):
        self.started_at.append(float(T[0, 3]))
        return T

    def solve(self, T, masks):
        return SimpleNamespace(T_mount_cam=T)

    def refine(self, estimate):
        moved = estimate.T_mount_cam.copy()
        moved[0, 3] += self.steps[len(self.started_at) - 1]
        support = SimpleNamespace(share=self.share, length_px=9000.0, covered=0.1)
        at = SimpleNamespace(T_mount_cam=moved)
        return SimpleNamespace(support=support, estimate=at), ()


def test_masks_are_made_again_where_the_edges_put_the_camera_until_both_agree():
    segmenter = Unsettled([0.2, 0.05, 0.001], 0.7)
    look = Look.of(segmenter, lambda stage: None)
    assert segmenter.started_at == pytest.approx([0.0, 0.2, 0.25])
    assert look.settled
    segmenter = Unsettled([0.01], 0.7)
    assert Look.of(segmenter, lambda stage: None).settled
    assert len(segmenter.started_at) == 1
    # A pose that no edges bear out is not worth it; one that moves on for ever is given up.
    segmenter = Unsettled([0.2], 0.2)
    assert not Look.of(segmenter, lambda stage: None).settled
    segmenter = Unsettled([0.2, 0.2, 0.2], 0.7)
    assert not Look.of(segmenter, lambda stage: None).settled
    assert len(segmenter.started_at) == 3


HIDDEN = CalibrationError("No image shows the arm.")


def test_one_look_is_enough_where_it_convinces(monkeypatch):
    first = look_at(0.7, 0.0, 0.5)
    taken = looks(monkeypatch, first)
    assert looked(first.segmenter, lambda stage: None) is first
    assert len(taken) == 1


@pytest.mark.parametrize("first", [look_at(0.7, 0.0, 0.1), look_at(0.2, 0.0, 0.9), HIDDEN])
def test_doubt_or_failure_asks_for_another_look(monkeypatch, first):
    second = look_at(0.8, 0.4, 0.7)
    taken = looks(monkeypatch, first, second)
    found = looked(second.segmenter, lambda stage: None)
    assert found.refinement is second.refinement
    assert len(taken) == 2


@pytest.mark.parametrize("poor", [look_at(0.2, 0.0, 0.9), look_at(0.7, 0.0, 0.9, 500.0), HIDDEN])
def test_a_thorough_search_follows_where_no_edges_bear_a_pose_out(monkeypatch, poor):
    good = look_at(0.8, 0.4, 0.7)
    taken = looks(monkeypatch, poor, HIDDEN, good)
    found = looked(good.segmenter, lambda stage: None)
    assert found.refinement is good.refinement
    assert len(taken) == 3
    taken = looks(monkeypatch, poor, poor, HIDDEN, good)
    found = looked(good.segmenter, lambda stage: None)
    assert found.refinement is good.refinement
    assert len(taken) == 4


def test_later_looks_that_find_nothing_leave_the_first(monkeypatch):
    first = look_at(0.2, 0.0, 0.1)
    looks(monkeypatch, first, HIDDEN, HIDDEN, HIDDEN)
    assert looked(first.segmenter, lambda stage: None) is first
    blank = CalibrationError("The images hardly differ.")
    looks(monkeypatch, HIDDEN, blank, blank, blank)
    with pytest.raises(CalibrationError, match="No image shows the arm"):
        looked(first.segmenter, lambda stage: None)


def test_joints_of_another_recording_are_not_called_sure():
    case = photographed(0)
    rng = np.random.default_rng(1)
    wrong = [rng.uniform(-1.0, 1.0, len(q)) for q in case.joints]
    try:
        reasons = calibrate_from_images(case.rig, case.camera, case.images, wrong).reasons
    except CalibrationError as error:
        reasons = (str(error),)
    assert reasons
    assert all(reason.endswith(".") for reason in reasons)


def test_pictures_without_motion_are_refused():
    case = photographed(0)
    with pytest.raises(CalibrationError, match="nothing moved"):
        calibrate_from_images(case.rig, case.camera, [case.images[0]] * 4, case.joints[:4])


def test_refusals():
    case = photographed(0)
    with pytest.raises(InputError, match="at least 3"):
        calibrate_from_images(case.rig, case.camera, case.images[:2], case.joints[:2])
    with pytest.raises(InputError, match="5 images but joints for 4"):
        calibrate_from_images(case.rig, case.camera, case.images, case.joints[:4])
    with pytest.raises(InputError, match="the size in camera_info"):
        small = [image[::2, ::2] for image in case.images]
        calibrate_from_images(case.rig, case.camera, small, case.joints)
    moving = Rig(case.rig.robot, "eye-in-hand", "hand")
    with pytest.raises(InputError, match="stands still"):
        calibrate_from_images(moving, case.camera, case.images, case.joints)


def test_a_second_look_starts_from_the_recorded_joints():
    case = photographed(2, n_views=8)
    off = np.deg2rad([0.0, -0.3, -0.3, -0.3])
    recorded = np.stack(case.joints) - off
    first = ClassicalSegmenter(case.rig, case.camera, case.images, list(recorded))
    T = case.T_mount_cam
    found = first.refine(first.solve(T, first.masks_at(T)))[0]
    assert found.joint_offsets.any()
    assert first.backgrounds(T).scene.joints == pytest.approx(recorded + found.joint_offsets)
    second = first.without_shadows()
    assert (second.backgrounds(T).scene.joints == recorded).all()
    again = second.refine(second.solve(T, second.masks_at(T)))[0]
    assert again.joint_offsets == pytest.approx(found.joint_offsets, abs=1e-3)
