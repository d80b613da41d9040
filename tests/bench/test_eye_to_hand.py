"""The loop of choosing and calibrating, with a stage that knows the truth; and the real stages."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from easyhecpp.bench import eye_to_hand
from easyhecpp.bench.eye_to_hand import (
    EyeToHandBench,
    Step,
    run_eye_to_hand,
    scene_steps,
)
from easyhecpp.bench.eye_to_hand_table import eye_to_hand_plot, eye_to_hand_table
from easyhecpp.bench.metrics import PoseError
from easyhecpp.bench.stages import MaskStage
from easyhecpp.errors import CalibrationError, InputError, MissingExtraError
from easyhecpp.sim.possible_poses import PossiblePoses
from easyhecpp.sim.robots import load_robot

BENCH = EyeToHandBench(2, 3, views=3, choose=("random",), size=(160, 90))


@pytest.fixture(scope="module")
def blind() -> np.ndarray:
    robot = load_robot("xarm7")
    poses = MaskStage.random(robot, (160, 90), [0]).poses
    return poses.draw(3, np.random.default_rng(0))


@pytest.fixture
def known_poses(blind: np.ndarray, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(eye_to_hand, "blind_poses", lambda bench: blind)


def test_masks_at_the_papers_overlap_lead_to_the_truth(blind: np.ndarray):
    stage = MaskStage.random(load_robot("xarm7"), (320, 180), [3, 1])
    for joints in stage.poses.draw(3, np.random.default_rng(1)):
        stage.look(joints)
    assert len(stage.observations) == 3
    error = PoseError.between(stage.estimate().T_mount_cam, stage.T_mount_cam)
    assert error.is_right


def test_a_stage_depends_on_its_seed_alone():
    robot = load_robot("xarm7")
    one, two, other = (MaskStage.random(robot, (96, 54), [5, k]) for k in (1, 1, 2))
    np.testing.assert_array_equal(one.T_mount_cam, two.T_mount_cam)
    assert not np.allclose(one.T_mount_cam, other.T_mount_cam)
    assert 0.8 < np.linalg.norm(one.T_mount_cam[:3, 3]) < 2.0


def test_what_reaches_below_the_table_collides():
    stage = MaskStage.random(load_robot("xarm7"), (96, 54), [5, 1])
    checker = PossiblePoses.of(stage.poses)
    above = stage.poses.draw(1, np.random.default_rng(0))[0]
    below = np.array([0.0, 1.9, 0.0, 0.3, 0.0, 0.0, 0.0])  # leans over and down
    assert not stage.poses.is_free(below[None])[0]
    assert checker.collides(np.array([above, below]))[1]
    assert "table" in checker.description


def test_an_arm_that_is_not_in_the_picture_is_an_error():
    stage = MaskStage.random(load_robot("xarm7"), (96, 54), [5, 1])
    with pytest.raises(CalibrationError, match="in no picture"):
        stage.estimate()


def test_every_step_counts_and_a_lost_camera_gets_blind_poses(
    known_poses: None, blind: np.ndarray, monkeypatch: pytest.MonkeyPatch
):
    looked: list[np.ndarray] = []

    def look(stage: MaskStage, joints: np.ndarray) -> None:
        looked.append(joints)

    def lost(stage: MaskStage) -> None:
        raise CalibrationError("lost")

    monkeypatch.setattr(MaskStage, "look", look)
    monkeypatch.setattr(MaskStage, "estimate", lost)
    steps = scene_steps(BENCH, blind, 0)
    assert [step.views for step in steps] == [1, 2, 3]
    assert [step.error for step in steps] == [None] * 3
    assert [step.status for step in steps] == ["lost"] * 3
    assert [step.blind for step in steps] == [False, True, True]
    np.testing.assert_array_equal(looked, blind)


@pytest.mark.parametrize(
    "error", [InputError("an option is wrong"), MissingExtraError("torch", "models", "It")]
)
def test_what_concerns_all_scenes_is_no_failed_scene(
    error: Exception, blind: np.ndarray, monkeypatch: pytest.MonkeyPatch
):
    def refuse(stage: MaskStage) -> None:
        raise error

    monkeypatch.setattr(MaskStage, "estimate", refuse)
    with pytest.raises(type(error)):
        scene_steps(BENCH, blind, 0)


def test_a_small_real_run():
    """Nothing is replaced: both joint poses are chosen, the first one for an unknown camera."""
    bench = EyeToHandBench(1, 3, views=2, size=(320, 180))
    first, second = run_eye_to_hand(bench)
    assert first.error is not None, first.status
    assert second.error is not None, second.status
    assert second.error.is_right
    assert second.choosing_s is not None
    assert not second.blind


def test_scenes_are_resumed(known_poses: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    done: list[int] = []

    def steps(bench: EyeToHandBench, blind: np.ndarray, scene: int) -> tuple[Step, ...]:
        done.append(scene)
        return tuple(Step(scene, "random", n, 1.0 / n, 0.1 / n, 2.0) for n in (1, 2, 3))

    monkeypatch.setattr(eye_to_hand, "scene_steps", steps)
    path = tmp_path / "rows.jsonl"
    first = run_eye_to_hand(BENCH, rows_file=path)
    more = run_eye_to_hand(
        EyeToHandBench(3, 3, 3, choose=("random",), size=(160, 90)), rows_file=path
    )
    assert done == [0, 1, 2]
    assert more[: len(first)] == first


def test_the_table_puts_ours_beside_the_published_rows():
    steps = [
        *(Step(k, "random", n, 2.0 * k / n, 0.1, 3.0) for k in (1, 2) for n in (1, 2)),
        Step(3, "random", 1, status="The arm is in no picture."),
        Step(3, "random", 2, 100.0, 9.0, 3.0, blind=True),
    ]
    bench = EyeToHandBench(3, 1, views=2, choose=("random",))
    table = eye_to_hand_table(bench, steps)
    cells = {(row[0], row[1]): row[2:] for row in table.rows}
    assert cells["ours, random views", "mm mean"] == pytest.approx((3.0, 1.5))
    assert cells["ours, random views", "failures"] == (1, 1)
    assert cells["published EasyHeC++", "mm mean"] == (3.18, 1.76)
    assert cells["published DREAM", "deg mean"] == (1.924, 1.240)
    assert any("1 of 6" in note for note in table.notes)
    assert "Failed, scene 3, random, view 1: The arm is in no picture." in table.notes
    assert len(eye_to_hand_plot(bench, steps).axes) == 2


@pytest.mark.parametrize(
    ("bench", "words"),
    [
        (EyeToHandBench(0, 1), "scenes is 0"),
        (EyeToHandBench(1, 1, choose=("luck",)), "called luck"),
        (EyeToHandBench(1, 1, choose=()), "called nothing"),
        (EyeToHandBench(1, 1, choose=("random", "random")), "named twice: random, random"),
        (EyeToHandBench(1, 1, samples=0), "spp is 0"),
        (EyeToHandBench(1, 1, robot="hal"), "no built-in robot"),
    ],
)
def test_bad_input(bench: EyeToHandBench, words: str):
    with pytest.raises(InputError, match=words):
        run_eye_to_hand(bench)
