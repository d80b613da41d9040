"""Joint poses to begin with."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from small_arm import small_arm

from easyhecpp.camera import Camera
from easyhecpp.errors import InputError
from easyhecpp.explore import draw_candidates, first_joint_poses
from easyhecpp.explore.floor import floor_height, lowest_points
from easyhecpp.explore.information import ViewPredictor
from easyhecpp.geometry import look_at, pose_covariance_from_centred
from easyhecpp.rig import Rig

F64 = NDArray[np.float64]
CAMERA = Camera(480, 360, 432.0, 432.0, 239.5, 179.5)


class Never:
    description = "nothing is allowed"

    def collides(self, joints: F64) -> NDArray[np.bool_]:
        return np.ones(len(joints), bool)


@pytest.fixture(scope="module")
def first() -> F64:
    return first_joint_poses(small_arm(), CAMERA, 2, np.random.default_rng(0))


def expected_mm(joints: F64) -> F64:
    """Expected error of the position with each pose alone, mean over cameras of our own."""
    robot = small_arm()
    centre = np.array([0.0, 0.0, 0.35])
    rng = np.random.default_rng(5)
    predictor = ViewPredictor(Rig(robot), CAMERA)
    found = []
    for _ in range(16):
        azimuth, elevation = rng.uniform(-np.pi, np.pi), rng.uniform(0.0, 1.0)
        direction = [np.cos(azimuth), np.sin(azimuth), np.tan(elevation)]
        eye = centre + 1.2 * robot.reach * np.array(direction) / np.linalg.norm(direction)
        T = look_at(eye, centre)
        N = predictor.information(T[None], joints, centre)[:, 0] + np.diag([1.0] * 6 + [4.0])
        c = (np.linalg.inv(T) @ [*centre, 1.0])[:3]
        C = [pose_covariance_from_centred(np.linalg.inv(n)[:6, :6], c) for n in N]
        found.append([1e3 * np.sqrt(np.trace(x[:3, :3])) for x in C])
    return np.minimum(np.array(found), 50.0).mean(axis=0)


def test_they_tell_more_than_random_ones_from_all_sides(first: F64) -> None:
    random = expected_mm(draw_candidates(small_arm(), 60, np.random.default_rng(7)))
    ours = expected_mm(first)
    assert ours[0] < np.percentile(random, 15)
    assert ours[1] < np.median(random)


def test_they_differ_and_stay_above_the_foot(first: F64) -> None:
    robot = small_arm()
    assert first.shape == (2, 4)
    assert np.all(lowest_points(robot, first) >= floor_height(robot, "foot"))
    Ts = robot.link_poses(first)
    assert np.linalg.norm(Ts[0, :, :3, 3] - Ts[1, :, :3, 3], axis=-1).max() > 0.1
    assert np.all(first > robot.lower)
    assert np.all(first < robot.upper)


def test_nothing_is_allowed() -> None:
    with pytest.raises(InputError, match="drawn within the limits collide"):
        first_joint_poses(small_arm(), CAMERA, 1, np.random.default_rng(0), checker=Never())
