"""Chosen joint poses: better than random ones, allowed, explained."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from known_arm import known
from numpy.typing import NDArray
from small_arm import small_arm

from easyhecpp.camera import Camera
from easyhecpp.errors import InputError
from easyhecpp.explore import (
    CollisionChecker,
    ConsistencyConfig,
    ExploreConfig,
    Knowledge,
    Limits,
    choose_many,
    choose_next,
    consistency_scores,
)
from easyhecpp.explore.box_check import BoxCheck
from easyhecpp.explore.feasible import COLLISION, LOW, OUT_OF_VIEW, REPEATED, Feasible
from easyhecpp.explore.floor import floor_height, lowest_points
from easyhecpp.explore.forecast import Forecast
from easyhecpp.geometry import inverse, look_at
from easyhecpp.rig import Rig

F64 = NDArray[np.float64]
CONFIG = ExploreConfig(candidates=60, hypotheses=2)


@dataclass(frozen=True)
class YawOnly:
    """Lets the arm turn to one side only."""

    description: str = "one side only"

    def collides(self, joints: F64) -> NDArray[np.bool_]:
        return np.asarray(joints[:, 0] > 0.0)


def test_chosen_poses_leave_less_error_than_random_ones() -> None:
    s, rig, knowledge = known()
    chosen = choose_next(rig, s.camera, knowledge, CONFIG, np.random.default_rng(0))
    random = [
        choose_next(
            rig, s.camera, knowledge, replace(CONFIG, method="random"), np.random.default_rng(i)
        ).predicted_position_mm
        for i in range(20)
    ]
    assert chosen.predicted_position_mm < np.percentile(random, 5)
    # Judged by other hypotheses than those that it was chosen with.
    judge = Forecast.of(rig, s.camera, knowledge, 6, np.random.default_rng(99))
    assert judge.expected(chosen.joints)[0] == pytest.approx(chosen.predicted_position_mm, rel=0.25)


def test_a_proposal_tells_what_it_is() -> None:
    s, rig, knowledge = known()
    p = choose_next(rig, s.camera, knowledge, CONFIG, np.random.default_rng(0))
    assert p.method == "information"
    assert p.considered >= 60
    assert p.gain == pytest.approx(1 - p.predicted_position_mm / p.position_mm)
    assert p.predicted_rotation_deg < p.rotation_deg
    assert f"from {p.position_mm:.2f} to {p.predicted_position_mm:.2f} mm" in p.reason
    assert "easyhecpp[plan]" in p.notes[0]
    again = choose_next(rig, s.camera, knowledge, CONFIG, np.random.default_rng(0))
    assert np.array_equal(p.joints, again.joints)


def test_several_at_once_build_on_each_other() -> None:
    s, rig, knowledge = known()
    many = choose_many(rig, s.camera, knowledge, CONFIG, 3, np.random.default_rng(0))
    assert [p.position_mm for p in many[1:]] == pytest.approx(
        [p.predicted_position_mm for p in many[:2]], rel=0.1
    )
    assert many[2].predicted_position_mm < many[0].predicted_position_mm
    Ts = rig.robot.link_poses(np.stack([p.joints for p in many]))
    for i in range(3):
        for j in range(i):
            assert np.linalg.norm(Ts[i, :, :3, 3] - Ts[j, :, :3, 3], axis=-1).max() > 0.03


def test_what_is_demanded_is_kept_and_counted() -> None:
    s, rig, knowledge = known()
    limits = Limits(min_in_view=0.9, floor=0.105)
    feasible = Feasible(rig, s.camera, knowledge.T_mount_cam, YawOnly(), limits, knowledge.joints)
    joints = feasible.draw(40, np.random.default_rng(0))
    assert np.all(joints[:, 0] <= 0.0)
    assert feasible.rejected[COLLISION] > 0
    assert feasible.rejected[LOW] > 0
    assert np.all(lowest_points(rig.robot, joints) >= 0.105)
    assert floor_height(rig.robot, "foot") == pytest.approx(-0.002)
    # Shares in view by vertices of the boxes that the arm is made of: near enough for the rule.
    for q in joints[:5]:
        Ts = inverse(knowledge.T_mount_cam) @ rig.robot.link_poses(q)
        px = np.concatenate(
            [
                s.camera.project(m.vertices @ T[:3, :3].T + T[:3, 3])
                for m, T in zip(rig.robot.meshes, Ts, strict=True)
            ]
        )
        inside = ((px > 0) & (px < [s.camera.width, s.camera.height])).all(axis=1)
        assert inside.mean() > 0.75


def test_an_earlier_view_is_not_taken_again() -> None:
    s, rig, knowledge = known()
    feasible = Feasible(
        rig, s.camera, knowledge.T_mount_cam, BoxCheck(rig.robot), Limits(floor=None),
        knowledge.joints,
    )  # fmt: skip
    assert len(feasible.keep(knowledge.joints + 0.01)) == 0
    assert feasible.rejected[REPEATED] == 2


def test_it_stops_at_the_target_and_when_nothing_is_to_be_gained() -> None:
    s, rig, knowledge = known()
    rng = np.random.default_rng(0)
    open_end = choose_next(rig, s.camera, knowledge, CONFIG, rng)
    assert not open_end.stop
    assert open_end.stop_reason == ""
    reached = choose_next(rig, s.camera, knowledge, replace(CONFIG, target_position_mm=100.0), rng)
    assert reached.stop
    assert "the target was 100 mm" in reached.stop_reason
    not_yet = choose_next(rig, s.camera, knowledge, replace(CONFIG, target_position_mm=1e-3), rng)
    assert not not_yet.stop
    idle = choose_next(rig, s.camera, knowledge, replace(CONFIG, min_gain=0.99), rng)
    assert idle.stop
    assert "% only" in idle.stop_reason


def test_the_papers_way_takes_the_largest_variance() -> None:
    s, rig, knowledge = known()
    config = replace(CONFIG, method="consistency", consistency=ConsistencyConfig(40, hypotheses=6))
    p = choose_next(rig, s.camera, knowledge, config, np.random.default_rng(0))
    assert p.considered == 40
    assert "masks differ most" in p.reason
    # The same draws again, by hand.
    rng = np.random.default_rng(0)
    Forecast.of(rig, s.camera, knowledge, config.hypotheses, rng)
    drawn = Feasible(
        rig, s.camera, knowledge.T_mount_cam, BoxCheck(rig.robot), config.limits, knowledge.joints
    ).draw(40, rng)
    Ts = knowledge.hypotheses(6, rng)
    scores = consistency_scores(rig, s.camera, Ts, drawn, config.consistency)
    assert np.array_equal(p.joints, drawn[np.argmax(scores)])
    assert p.score == pytest.approx(scores.max())


def test_a_camera_on_the_wrist() -> None:
    robot = small_arm()
    rig = Rig(robot, "eye-in-hand", "hand")
    # It looks back at the arm's foot.
    T_base_hand = robot.frame_pose(robot.neutral, "hand")
    T_mount_cam = inverse(T_base_hand) @ look_at(
        T_base_hand[:3, 3] + [0.3, 0.2, 0.3], [0.0, 0.0, 0.1]
    )
    knowledge = Knowledge(T_mount_cam, 1e-6 * np.eye(6), robot.neutral[None])
    camera = Camera(480, 360, 300.0, 300.0, 239.5, 179.5)
    p = choose_next(rig, camera, knowledge, CONFIG, np.random.default_rng(0))
    assert p.predicted_position_mm < p.position_mm


def test_unknown_method() -> None:
    with pytest.raises(InputError, match="information, consistency, random"):
        ExploreConfig(method="best")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="at least one of each"):
        ExploreConfig(candidates=0)


def test_no_pose_in_view() -> None:
    s, rig, knowledge = known()
    away = replace(knowledge, T_mount_cam=knowledge.T_mount_cam @ np.diag([-1.0, 1.0, -1.0, 1.0]))
    with pytest.raises(InputError) as caught:
        choose_next(rig, s.camera, away, CONFIG, np.random.default_rng(0))
    assert OUT_OF_VIEW in str(caught.value)
    assert "a camera that sees most of the arm" in str(caught.value)


def test_the_rough_check_is_a_checker_and_knows_a_folded_arm() -> None:
    robot = small_arm()
    check = BoxCheck(robot)
    assert isinstance(check, CollisionChecker)
    folded = np.array([0.0, 1.2, 1.5, 0.0])  # fore-arm and hand down through the base
    assert check.collides(np.stack([robot.neutral, folded])).tolist() == [False, True]
