from __future__ import annotations

import numpy as np
import pytest
from sim_pictures import CAMERAS, shift_px

from easyhecpp.camera import Camera
from easyhecpp.errors import InputError
from easyhecpp.geometry import inverse, look_at
from easyhecpp.render.reference_compiled import reference_coverage_compiled
from easyhecpp.sim.lens import plan_pinhole
from easyhecpp.sim.robots import load_robot


def test_a_camera_with_square_pixels_and_no_distortion_is_its_own_pinhole():
    camera = Camera(64, 48, 60.0, 60.0, 30.2, 25.1)
    plan = plan_pinhole(camera)
    picture = np.random.default_rng(0).random((48, 64, 3), dtype=np.float32)
    assert plan.pinhole is camera
    assert plan.finish(picture) is picture
    assert plan.samples(7) == 7


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS.keys())
def test_resampling_the_pinhole_picture_gives_the_cameras_to_a_hundredth_of_a_pixel(camera):
    robot = load_robot("xarm7")
    q = np.array([0.3, -0.4, 0.2, 0.9, 0.1, 1.2, 0.0])
    Ts_cam_link = inverse(look_at([1.1, 0.5, 0.7], [0.1, 0.0, 0.35])) @ robot.link_poses(q)
    plan = plan_pinhole(camera)
    seen = reference_coverage_compiled(robot.meshes, plan.pinhole, Ts_cam_link, 7)
    truth = reference_coverage_compiled(robot.meshes, camera, Ts_cam_link, 7)
    picture = plan.finish(np.repeat(seen[..., None], 3, axis=2))[..., 0]
    assert np.abs(shift_px(picture, truth)).max() < 0.015
    assert abs(picture.sum() - truth.sum()) < 3e-3 * truth.sum()


def test_too_wide_a_view_is_refused():
    with pytest.raises(InputError, match="70 degrees"):
        plan_pinhole(Camera(200, 200, 50.0, 50.0, 99.5, 99.5, "equidistant", (0.0,) * 4))
