"""A tip sent to a corner: exact pose, wrong pose, no pose."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from easyhecpp.bench import targeting
from easyhecpp.bench.eye_to_hand import EyeToHandBench
from easyhecpp.bench.stages import MaskStage
from easyhecpp.bench.targeting import (
    BOARD,
    Target,
    run_targeting,
    scene_targets,
    targeting_plot,
    targeting_table,
)
from easyhecpp.errors import CalibrationError, InputError, MissingExtraError
from easyhecpp.geometry import inverse, make_transform, transform_points
from easyhecpp.sim.robots import load_robot

BENCH = EyeToHandBench(1, 3, views=1, size=(640, 360))


@pytest.fixture(scope="module")
def stage() -> MaskStage:
    return MaskStage.random(load_robot("xarm7"), (1280, 720), [51, 0])


def attempts(stage: MaskStage, T_base_cam: np.ndarray) -> list[Target]:
    rng = np.random.default_rng(1)
    return list(targeting._attempts(stage, T_base_cam, "link7", 3, 0, rng))


def test_with_the_true_pose_only_finding_the_corner_costs(stage: MaskStage):
    for target in attempts(stage, stage.T_mount_cam):
        assert target.tip_mm == target.ideal_mm
        assert target.tip_mm < 3.0


def test_a_camera_moved_by_a_centimetre_misses_by_a_centimetre(stage: MaskStage):
    moved = make_transform(np.eye(3), np.array([0.0, 0.0, 0.01])) @ stage.T_mount_cam
    for target in attempts(stage, moved):
        assert target.tip_mm == pytest.approx(10.0, abs=3.0)
        assert target.ideal_mm < 3.0


def test_the_board_lies_face_up_on_the_table_and_in_the_picture(stage: MaskStage):
    T_base_board = targeting._board_on_table(stage, np.random.default_rng(0))
    corners = transform_points(T_base_board, BOARD.corners)
    np.testing.assert_allclose(corners[:, 2], stage.poses.floor_z, atol=1e-12)
    in_cam = transform_points(inverse(stage.T_mount_cam), corners)
    px = stage.camera.project(in_cam)
    assert ((px > 0) & (px < [1280, 720])).all()
    assert np.linalg.det(T_base_board[:3, :3]) == pytest.approx(1.0)
    # z points away from the camera: the print is seen, not its back.
    assert T_base_board[2, 2] == -1.0


def test_the_tip_goes_there_or_as_near_as_it_can():
    robot = load_robot("xarm7")
    rng = np.random.default_rng(0)
    near = np.array([0.4, 0.2, 0.1])
    np.testing.assert_allclose(targeting._tip_at(robot, "link7", near, rng), near, atol=1e-4)
    far = np.array([3.0, 0.0, 0.0])
    assert np.linalg.norm(targeting._tip_at(robot, "link7", far, rng) - far) > 1.0


def test_without_a_pose_every_attempt_is_a_miss(monkeypatch: pytest.MonkeyPatch):
    def lost(stage: MaskStage) -> None:
        raise CalibrationError("lost")

    monkeypatch.setattr(MaskStage, "estimate", lost)
    monkeypatch.setattr(MaskStage, "look", lambda stage, joints: None)
    found = scene_targets(BENCH, 2, "link7", np.zeros((1, 7)), 0)
    assert [t.tip_mm for t in found] == [None, None]
    table = targeting_table(BENCH, found)
    assert any("2 of 2" in note for note in table.notes)
    assert "Failed, scene 0, attempt 1: lost" in table.notes


def test_the_table_and_the_plot():
    targets = [Target(0, 0, 2.0, 0.5, 1.2), Target(0, 1, 4.0, 0.3, 1.5)]
    table = targeting_table(BENCH, targets)
    lines = {row[0]: row[1:] for row in table.rows}
    assert lines["ours, 1 view"][:2] == (2, 3.0)
    assert lines["published EasyHeC++, real arm"][1] == 3.0
    assert len(targeting_plot(targets).axes) == 1


def test_a_small_real_run():
    """Nothing is replaced: joint poses are chosen, masks are made, the camera is found."""
    targets = run_targeting(replace(BENCH, size=(1280, 720)), 3)
    assert [target.trial for target in targets] == [0, 1, 2]
    made = [target for target in targets if target.status == ""]
    assert made
    for target in made:
        assert target.tip_mm < 20.0
        assert target.ideal_mm < 5.0


@pytest.mark.parametrize(
    "error", [InputError("an option is wrong"), MissingExtraError("torch", "models", "It")]
)
def test_what_concerns_all_scenes_is_no_miss(error: Exception, monkeypatch: pytest.MonkeyPatch):
    def refuse(stage: MaskStage, joints: np.ndarray) -> None:
        raise error

    monkeypatch.setattr(MaskStage, "look", refuse)
    with pytest.raises(type(error)):
        scene_targets(BENCH, 2, "link7", np.zeros((1, 7)), 0)


@pytest.mark.parametrize(
    ("bench", "trials", "ee_link", "words"),
    [
        (BENCH, 0, None, "trials is 0"),
        (replace(BENCH, views=0), 1, None, "views is 0"),
        (replace(BENCH, robot="hal"), 1, None, "no built-in robot"),
        (BENCH, 1, "hand", "No link is called 'hand'"),
    ],
)
def test_bad_input(bench: EyeToHandBench, trials: int, ee_link: str | None, words: str):
    with pytest.raises(InputError, match=words):
        run_targeting(bench, trials, ee_link=ee_link)
