from __future__ import annotations

import numpy as np
import pytest
from scenes_small import photographed

from easyhecpp.errors import CalibrationError, InputError
from easyhecpp.geometry import pose_error
from easyhecpp.rig import Rig
from easyhecpp.segment.classical import calibrate_from_images


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
