"""What was stated wrongly is refined, and what cannot be known is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from easyhecpp.bench.metrics import PoseError
from easyhecpp.bench.trust_scenes import build_case
from easyhecpp.errors import CalibrationError, InputError
from easyhecpp.geometry import exp_se3
from easyhecpp.solve import solve_pose
from easyhecpp.solve.consistency import solve_consistent
from easyhecpp.solve.nuisance import read_priors, refine_nuisances

START = np.array([0.01, -0.01, 0.01, 0.008, -0.006, 0.005])


@pytest.fixture(scope="module")
def scene():
    return build_case("five good views", np.random.default_rng([43, 0]), 640)


def refined(scene, camera, observations, words):
    """The pose with everything taken as stated, and the refinement that starts from it."""
    start = scene.T_mount_cam @ exp_se3(START)
    plain = solve_pose(scene.rig, camera, observations, start)
    priors = read_priors(words, scene.rig.robot.joint_names)
    return plain, refine_nuisances(scene.rig, camera, observations, plain.T_mount_cam, priors)


def test_a_joint_whose_zero_is_off_is_set_right(scene):
    joint, off = 3, 0.012
    name = scene.rig.robot.joint_names[joint]
    shift = off * np.eye(scene.rig.robot.n_joints)[joint]
    wrong = [replace(o, joints=o.joints + shift) for o in scene.observations]
    plain, found = refined(scene, scene.camera, wrong, (f"{name}=0.02",))
    (correction,) = found.corrections
    assert correction.name == name
    assert abs(correction.value + off) < 3.0 * correction.sigma
    assert correction.sigma < 0.3 * off
    before = PoseError.between(plain.T_mount_cam, scene.T_mount_cam)
    after = PoseError.between(found.T_mount_cam, scene.T_mount_cam)
    assert after.position_mm < 0.7 * before.position_mm


def test_an_arm_that_sags_is_set_right(scene):
    give = 0.02
    robot = scene.rig.robot
    high = [replace(o, joints=o.joints - give * robot.sag(o.joints)) for o in scene.observations]
    plain, found = refined(scene, scene.camera, high, ("sag=0.02",))
    (correction,) = found.corrections
    assert correction.name == "sag"
    assert abs(correction.value - give) < 3.0 * correction.sigma
    assert correction.sigma < 0.3 * give
    before = PoseError.between(plain.T_mount_cam, scene.T_mount_cam)
    after = PoseError.between(found.T_mount_cam, scene.T_mount_cam)
    assert after.position_mm < 0.7 * before.position_mm


def test_masks_ask_for_sag_where_there_is_some():
    asked = {0.0: 0, 8e-3: 0}
    for k in range(6):
        case = build_case("five good views", np.random.default_rng([48, k]), 640)
        robot = case.rig.robot
        for give in asked:
            seen = [
                replace(o, joints=o.joints - give * robot.sag(o.joints)) for o in case.observations
            ]
            _, findings = solve_consistent(case.rig, case.camera, seen, case.T_mount_cam)
            asked[give] += findings.sag_asked
    assert asked[8e-3] == 6
    assert asked[0.0] <= 1


def test_a_focal_length_that_is_off_is_set_right_and_widens_the_error_bar(scene):
    camera = scene.camera
    wrong = replace(camera, fx=1.02 * camera.fx, fy=1.02 * camera.fy)
    _, found = refined(scene, wrong, scene.observations, ("focal",))
    (correction,) = found.corrections
    assert abs(found.camera.fx / camera.fx - 1.0) < 3.0 * correction.sigma
    assert correction.sigma < 0.01
    # The focal length trades with the distance: knowing it less well is knowing the pose less well.
    assert np.linalg.eigvalsh(found.pose_covariance).min() > -1e-12
    assert np.trace(found.pose_covariance[:3, :3]) > 0.0


def test_the_error_bars_allow_for_joints_that_are_off_anew_in_every_view():
    z = []
    for k in range(6):
        case = build_case("five good views", np.random.default_rng([46, k]), 640)
        rng = np.random.default_rng(k)
        moved = [
            replace(o, joints=o.joints + rng.normal(0.0, 3e-3, len(o.joints)))
            for o in case.observations
        ]
        _, found = refined(case, case.camera, moved, ("focal", "sag"))
        # Both are as stated.
        z.append([c.value / c.sigma for c in found.corrections])
    # Without the joints' share: 1.9 and 1.7.
    assert (np.sqrt(np.square(z).mean(axis=0)) < 1.5).all()


def test_the_zero_of_the_first_joint_cannot_be_told_from_the_base_s_yaw(scene):
    first = scene.rig.robot.joint_names[0]
    with pytest.raises(CalibrationError, match=f"cannot tell {first} from the camera's pose"):
        refined(scene, scene.camera, scene.observations, (first,))


def test_words_are_read_with_and_without_a_number():
    assert read_priors(("focal", "joint2=0.5"), ("joint1", "joint2")) == {
        "focal": 0.03,
        "joint2": 0.5,
    }
    assert read_priors(("principal_point=4",), ()) == {"cx": 4.0, "cy": 4.0}
    assert read_priors(("lens=0.1",), ()) == {"k1": 0.1, "k2": 0.2}
    assert read_priors((), ("joint1",)) == {}


@pytest.mark.parametrize(
    ("word", "text"),
    [
        ("elbow", "'elbow' cannot be refined.*some of focal, principal_point, lens, sag, joint1"),
        ("focal=", "'focal=' does not say how far off"),
        ("joint1=-1", "a number above 0"),
        ("joint1=nan", "a number above 0"),
    ],
)
def test_nonsense_words_are_refused(word, text):
    with pytest.raises(InputError, match=text):
        read_priors((word,), ("joint1",))
