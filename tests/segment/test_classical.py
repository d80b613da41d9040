from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from scenes_small import photographed

from easyhecpp.errors import CalibrationError, InputError
from easyhecpp.geometry import pose_error
from easyhecpp.rig import Rig
from easyhecpp.segment.classical import calibrate_from_images
from easyhecpp.segment.classical.calibrate import _Look, _second_look


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


@dataclass(frozen=True)
class LookedAgain:
    """Of two looks at the same pictures, what `_second_look` needs."""

    share: float
    x: float
    margin: float

    def __call__(self, segmenter=None) -> _Look:
        T = np.eye(4)
        T[0, 3] = self.x
        refinement = SimpleNamespace(
            support=SimpleNamespace(share=self.share), estimate=SimpleNamespace(T_mount_cam=T)
        )
        return _Look(segmenter, (), self.margin, None, refinement, ())


@pytest.mark.parametrize(
    ("first", "second", "chosen", "margin"),
    [
        # The same pose twice: what stood beside it in either look does not matter.
        (LookedAgain(0.7, 0.0, 0.1), LookedAgain(0.71, 0.002, 0.6), "second", 0.6),
        (LookedAgain(0.71, 0.0, 0.1), LookedAgain(0.7, 0.002, 0.6), "first", 0.6),
        # The edges tell two poses apart.
        (LookedAgain(0.1, 0.0, 0.1), LookedAgain(0.7, 0.4, 0.6), "second", 0.6),
        (LookedAgain(0.7, 0.0, 0.1), LookedAgain(0.1, 0.4, 0.6), "first", 0.1),
        # They do not: neither is sure.
        (LookedAgain(0.5, 0.0, 0.1), LookedAgain(0.55, 0.4, 0.6), "second", 0.0),
    ],
)
def test_of_two_looks_the_edges_choose(monkeypatch, first, second, chosen, margin):
    segmenter = SimpleNamespace(scene=SimpleNamespace(radius=1.0), without_shadows=lambda: None)
    monkeypatch.setattr(_Look, "of", lambda segmenter, lap: second(segmenter))
    found = _second_look(first(segmenter), lambda stage: None)
    wanted = {"first": first, "second": second}[chosen]
    assert found.refinement.support.share == wanted.share
    assert found.margin == margin


def test_a_second_look_that_finds_nothing_leaves_the_first(monkeypatch):
    def fail(segmenter, lap):
        raise CalibrationError("No camera pose explains the motion in the images.")

    segmenter = SimpleNamespace(scene=SimpleNamespace(radius=1.0), without_shadows=lambda: None)
    first = LookedAgain(0.2, 0.0, 0.1)(segmenter)
    monkeypatch.setattr(_Look, "of", fail)
    assert _second_look(first, lambda stage: None) is first


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
