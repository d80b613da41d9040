"""The first pose: any distance, any side, rolled, half out of view."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from numpy.typing import NDArray
from small_arm import observe, scene, small_arm

from easyhecpp.camera import Camera
from easyhecpp.errors import InputError
from easyhecpp.geometry import exp_se3, exp_so3, inverse, look_at, pose_error, rotation_angle
from easyhecpp.initialise import InitialPose, SamplingConfig, sample_initial_pose
from easyhecpp.initialise.seeds import default_seeds, paper_seeds, seeds_between, turned_seeds
from easyhecpp.rig import Rig
from easyhecpp.robot import Robot
from easyhecpp.sim.robots import load_robot
from easyhecpp.sim.scenes import SimScene
from easyhecpp.solve import Observation

F64 = NDArray[np.float64]

JOINTS = np.array([[0.3, 0.4, 0.5, 0.2], [-0.7, -0.3, 0.9, 1.0], [1.5, 0.6, -0.4, -0.8]])


def seen_from(
    eye: tuple[float, float, float],
    *,
    target: tuple[float, float, float] = (0.1, 0.0, 0.4),
    roll_deg: float = 0.0,
    focal: float = 300.0,
    joints: F64 = JOINTS,
) -> SimScene:
    camera = Camera(320, 240, focal, focal, 159.5, 119.5)
    T = look_at(eye, target) @ exp_se3([0, 0, 0, 0, 0, np.deg2rad(roll_deg)])
    return SimScene(small_arm(), camera, T, joints)


def find(view: SimScene, config: SamplingConfig | None = None, **options: object) -> InitialPose:
    return sample_initial_pose(Rig(view.robot), view.camera, observe(view), config, **options)  # type: ignore[arg-type]


def assert_in_the_basin(found: InitialPose, view: SimScene) -> None:
    metres, radians = pose_error(found.T_mount_cam, view.T_base_cam)
    distance = np.linalg.norm(view.T_base_cam[:3, 3] - [0.1, 0, 0.4])
    assert metres < 0.04 * distance
    assert np.degrees(radians) < 2.5
    assert found.score > 0.9


@pytest.mark.parametrize("roll", [-30.0, 30.0, 75.0, -100.0, 135.0, 180.0])
def test_rolled_cameras(roll: float) -> None:
    view = seen_from((1.4, 0.5, 0.8), roll_deg=roll)
    assert_in_the_basin(find(view), view)


@pytest.mark.parametrize("roll", [75.0, 180.0])
def test_one_view_of_a_rolled_camera(roll: float) -> None:
    view = seen_from((1.4, 0.5, 0.8), roll_deg=roll, joints=JOINTS[:1])
    assert_in_the_basin(find(view), view)


def test_a_camera_below_the_base_that_looks_up() -> None:
    view = seen_from((1.1, -0.7, -0.5))
    assert_in_the_basin(find(view), view)


def test_a_camera_above_that_looks_straight_down() -> None:
    view = seen_from((0.25, 0.1, 2.0), roll_deg=70.0)
    assert_in_the_basin(find(view), view)


def test_an_arm_beside_the_middle_and_partly_out_of_view() -> None:
    view = seen_from((1.2, 0.8, 0.6), target=(0.1, 0.55, 0.55))
    shares = view.shares_in_view
    assert shares.min() < 0.9
    columns = [np.nonzero(mask)[1].mean() for mask in view.masks]
    assert abs(np.mean(columns) - 160) > 60
    assert_in_the_basin(find(view), view)


@pytest.mark.parametrize("distance", [0.9, 1.5, 4.0, 9.0])
def test_the_distance_is_not_assumed(distance: float) -> None:
    direction = np.array([0.8, -0.45, 0.4]) / np.linalg.norm([0.8, -0.45, 0.4])
    eye = tuple(np.array([0.1, 0.0, 0.4]) + distance * direction)
    view = seen_from(eye, focal=180.0 * max(1.0, distance))  # type: ignore[arg-type]
    assert_in_the_basin(find(view), view)


def test_bent_lens() -> None:
    view = scene(4, 3, 320, 240)
    lens = Camera(
        320, 240, 288.0, 288.0, 159.5, 119.5, "plumb_bob", (-0.25, 0.08, 0.002, -0.001, 0.0)
    )
    bent = SimScene(view.robot, lens, view.T_base_cam, view.joints)
    assert_in_the_basin(find(bent), bent)


def test_views_without_the_arm_do_not_matter() -> None:
    view = seen_from((1.4, 0.5, 0.8))
    empty = Observation(np.array([2.0, 0.0, 0.0, 0.0]), np.zeros((240, 320), bool), id="empty")
    found = sample_initial_pose(Rig(view.robot), view.camera, [empty, *observe(view)])
    assert_in_the_basin(found, view)


# What is said about the pose


def test_candidates_are_distinct_and_best_first() -> None:
    found = find(seen_from((1.4, 0.5, 0.8)))
    scores = [score for _, score in found.candidates]
    assert scores == sorted(scores, reverse=True)
    assert found.score == scores[0]
    np.testing.assert_array_equal(found.T_mount_cam, found.candidates[0][0])
    assert found.margin == pytest.approx(scores[0] - scores[1])
    assert found.margin > 0.1
    for i, (a, _) in enumerate(found.candidates):
        for b, _ in found.candidates[:i]:
            apart = pose_error(a, b)
            assert apart[0] > 0.02 or np.degrees(apart[1]) > 2.0


POST = """<robot name="post"><link name="base"><visual><origin xyz="0 0 0.3"/>
  <geometry><box size="0.1 0.1 0.6"/></geometry></visual></link>
  <link name="head"><visual><geometry><box size="0.3 0.3 0.05"/></geometry></visual></link>
  <joint name="lift" type="prismatic"><parent link="base"/><child link="head"/>
    <origin xyz="0 0 0.6"/><axis xyz="0 0 1"/>
    <limit lower="0" upper="0.3" effort="1" velocity="1"/></joint></robot>"""


@pytest.mark.parametrize(
    ("grid", "distance", "focal"), [("sphere", 1.6, 300.0), ("paper", 1.1, 230.0)]
)
def test_the_margin_of_a_symmetric_robot_is_small(
    grid: Literal["sphere", "paper"], distance: float, focal: float, tmp_path: Path
) -> None:
    """A square post looks the same from four sides: no mask can tell which."""
    (tmp_path / "post.urdf").write_text(POST)
    robot = Robot.from_urdf(tmp_path / "post.urdf")
    camera = Camera(320, 240, focal, focal, 159.5, 119.5)
    eye = np.array([0.0, 0.0, 0.4]) + distance * np.array([0.92, 0.25, 0.31])
    T = look_at(eye, (0, 0, 0.4))
    view = SimScene(robot, camera, T, np.array([[0.0], [0.15], [0.3]]))
    found = find(view, SamplingConfig(grid=grid))
    assert found.margin < 0.02
    turns = [
        np.degrees(rotation_angle(T[:3, :3] @ other[:3, :3].T))
        for other, score in found.candidates
        if found.score - score < 0.02
    ]
    assert len(turns) > 1
    assert all(min(abs(turn - quarter) for quarter in (0, 90, 180)) < 3 for turn in turns)


# Seeds


def test_the_papers_grid() -> None:
    """Section "Implementation Details": 1 m, elevation 0-70 step 10, azimuth 0-330 step 30."""
    centre = np.array([0.2, -0.1, 0.5])
    seeds = paper_seeds(centre)
    assert seeds.shape == (96, 4, 4)
    offset = seeds[:, :3, 3] - centre
    np.testing.assert_allclose(np.linalg.norm(offset, axis=1), 1.0)
    elevation = np.degrees(np.arcsin(offset[:, 2]))
    azimuth = np.degrees(np.arctan2(offset[:, 1], offset[:, 0])) % 360
    assert sorted(set(np.rint(elevation).astype(int))) == list(range(0, 71, 10))
    assert sorted(set(np.rint(azimuth).astype(int) % 360)) == list(range(0, 360, 30))
    # Every camera looks at the middle, upright.
    middle = inverse(seeds) @ np.append(centre, 1.0)
    np.testing.assert_allclose(middle[:, :3], np.tile([0, 0, 1.0], (96, 1)), atol=1e-9)
    np.testing.assert_allclose(seeds[:, 2, 0], 0.0, atol=1e-9)


def test_the_papers_grid_can_be_chosen() -> None:
    middle = small_arm().centre(JOINTS).mean(axis=0)
    T = paper_seeds(middle)[30] @ exp_se3([0.04, -0.03, 0.05, 0.03, -0.04, 0.05])
    view = SimScene(small_arm(), Camera(320, 240, 220.0, 220.0, 159.5, 119.5), T, JOINTS)
    found = find(view, SamplingConfig(grid="paper"))
    assert_in_the_basin(found, view)


def test_seeds_lie_all_around_below_too_and_rolled() -> None:
    seeds = default_seeds(np.zeros(3), 2.0)
    eyes = seeds[:, :3, 3]
    np.testing.assert_allclose(np.linalg.norm(eyes, axis=1), 2.0)
    rng = np.random.default_rng(0)
    wanted = rng.normal(size=(500, 3))
    wanted = wanted[np.abs(wanted[:, 2]) < 0.8 * np.linalg.norm(wanted, axis=1)]
    wanted /= np.linalg.norm(wanted, axis=1, keepdims=True)
    gaps = np.degrees(np.arccos(np.clip(wanted @ eyes.T / 2.0, -1, 1).max(axis=1)))
    assert gaps.max() < 25.0
    tilt = np.degrees(np.arcsin(np.clip(seeds[:, 2, 0], -1, 1)))
    assert tilt.min() < -20.0
    assert tilt.max() > 20.0


def test_with_the_turned_seeds_no_camera_is_far_from_a_seed() -> None:
    place = np.zeros(3), 2.0
    parts = [default_seeds(*place), seeds_between(*place), turned_seeds(*place)]
    seeds = np.concatenate(parts)[:, :3, :3]
    rng = np.random.default_rng(0)
    for wanted in exp_so3(rng.normal(size=(200, 3)) * 2.0):
        assert np.degrees(rotation_angle(wanted.T @ seeds).min()) < 35.0


def test_a_random_azimuth_on_request() -> None:
    view = seen_from((1.4, 0.5, 0.8))
    fixed, again = find(view), find(view)
    np.testing.assert_array_equal(fixed.T_mount_cam, again.T_mount_cam)
    turned = find(view, rng=np.random.default_rng(5))
    assert_in_the_basin(turned, view)


# Bad input


def test_no_view_shows_the_arm() -> None:
    view = seen_from((1.4, 0.5, 0.8))
    blank = observe(view, np.zeros_like(view.masks))
    with pytest.raises(InputError, match=r"cannot be seen in any view.*check the masks"):
        sample_initial_pose(Rig(view.robot), view.camera, blank)


HARD_SINGLE_VIEWS = {
    # Eye and target (metres), focal length (px), joints: the seeds nearest to these cameras rank
    # behind dozens of others.
    "from above": (
        (0.746, -0.637, 0.712),
        (-0.0085, -0.1443, 0.2783),
        900.0,
        [-0.9195, 0.7691, -0.1728, 2.7254, -1.6369, 0.5208, 2.592],
    ),
    "steeply from above": (
        (0.462, -0.511, 0.993),
        (0.0112, -0.0647, 0.22),
        911.0,
        [-0.9195, 0.7691, -0.1728, 2.7254, -1.6369, 0.5208, 2.592],
    ),
}


@pytest.mark.parametrize("case", HARD_SINGLE_VIEWS)
def test_one_view_whose_nearest_seed_ranks_far_down(case: str) -> None:
    eye, target, focal, joints = HARD_SINGLE_VIEWS[case]
    camera = Camera(1280, 720, focal, focal, 645.0, 358.0)
    view = SimScene(load_robot("xarm7"), camera, look_at(eye, target), np.array([joints]))
    found = find(view)
    assert_in_the_basin(found, view)
    assert "again" in found.timings_s  # else the case is not hard, and the test shows nothing
