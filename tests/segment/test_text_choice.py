"""The arm among what a text prompt found."""

from __future__ import annotations

import numpy as np
import pytest
from stage import ARM, OTHER_ARM, OTHER_POSES, POSES, AllArms

from easyhecpp.errors import CalibrationError, InputError
from easyhecpp.geometry import exp_se3, look_at, pose_error
from easyhecpp.rig import Rig
from easyhecpp.segment import ScoredMasks, choose_arm, masks_from_text
from easyhecpp.segment.text import Hypotheses

TABLE = (slice(150, 240), slice(0, 320))
WRONG = [look_at((0.2, 1.7, 0.3), (0, 0, 0.4)), look_at((-1.2, -1.2, 1.5), (0, 0, 0.2))]


def knowing(stage, *, calls=None):
    """A pose finder that offers wrong poses and, somewhat off, the right one."""
    right = stage.T_mount_cam @ exp_se3([0.01, -0.01, 0.02, 0.004, 0.003, -0.005])

    def first_pose(rig, camera, observations):
        if calls is not None:
            calls.append([o.id for o in observations])
        return [*WRONG, right]

    return first_pose


class Blind:
    """Sees nothing in the pictures of some views."""

    name = "blind"

    def __init__(self, *dark):
        self.dark, self.seen = dark, 0

    def segment(self, image, text):
        self.seen += 1
        if self.seen - 1 in self.dark:
            return ScoredMasks(np.zeros((0, *image.shape[:2]), dtype=bool), np.zeros(0))
        return AllArms().segment(image, text)


def arm_masks(stage):
    return [stage.arm(q) >= 0 for q in POSES]


@pytest.mark.parametrize("table", [None, TABLE], ids=["two arms", "two arms and a table"])
def test_the_arm_whose_joints_were_recorded_wins(stage, table):
    """Nothing is given but the pictures and the joints; the favourite is always the other arm."""
    capture = stage.capture(others=list(OTHER_POSES), table=table)
    masks = masks_from_text(capture, AllArms(), "robot arm")
    metres, radians = pose_error(masks.belief.T_mount_cam, stage.T_mount_cam)
    assert metres < 0.02
    assert np.rad2deg(radians) < 1.0
    for view, truth in zip(masks.views, arm_masks(stage), strict=True):
        assert np.array_equal(view.mask, truth)
        assert view.score > 0.9
        assert view.notes == (f"{1 + (table is not None)} other detections are not this arm.",)
    assert masks.doubts == ()
    assert masks.margin > 0.3


def test_a_clear_case_is_solved_once(stage):
    calls = []
    capture = stage.capture()
    masks = masks_from_text(capture, AllArms(), "robot arm", knowing(stage, calls=calls))
    assert len(masks.usable) == len(POSES)
    assert len(calls) == 1


def test_an_arm_in_two_pieces_is_put_together(stage):
    found = []
    for q, truth in zip(POSES, arm_masks(stage), strict=True):
        columns = np.flatnonzero(truth.any(axis=0))
        cut = int(columns.mean())
        left, right = truth.copy(), truth.copy()
        left[:, cut:], right[:, :cut] = False, False
        found.append(Hypotheses("v", q, np.stack([left, np.flip(truth), right])))
    choice = choose_arm(Rig(stage.robot), stage.camera, found, knowing(stage))
    assert choice.assignment == ((0, 2),) * len(POSES)
    assert choice.doubts == ()


def test_views_in_which_the_arm_was_not_found_are_left_out(stage):
    capture = stage.capture(others=list(OTHER_POSES))
    for i in (1, 3):  # only the other arm is outlined there
        labels = capture.views[i].image
        labels[(labels >= ARM) & (labels < OTHER_ARM)] = 0
    masks = masks_from_text(capture, Blind(0), "robot arm", knowing(stage))
    assert [v.mask is not None for v in masks.views] == [False, False, True, False, True]
    assert masks.views[0].notes == ("blind found no 'robot arm'.",)
    assert masks.views[1].notes == ("Nothing that was found lies where the joints put the arm.",)


def test_nothing_found_anywhere_names_the_views_and_what_next(stage):
    with pytest.raises(InputError) as caught:
        masks_from_text(stage.capture(), Blind(*range(5)), "robot arm", knowing(stage))
    text = str(caught.value)
    assert "blind gave a usable mask in 0 of 5 views" in text
    assert "view 0004: blind found no 'robot arm'." in text
    assert "--segmenter classical" in text


def test_what_does_not_move_as_the_joints_say_is_not_the_arm(stage):
    """Masks of another arm alone: no camera explains them with these joints."""
    seen = [stage.renderer.visible_links(stage.Ts_cam_link(q, stage.T_base_other)) >= 0
            for q in OTHER_POSES]  # fmt: skip
    found = [Hypotheses("v", q, m[None]) for q, m in zip(POSES, seen, strict=True)]
    with pytest.raises(CalibrationError, match=r"moves as the joints say.*--segmenter classical"):
        choose_arm(Rig(stage.robot), stage.camera, found, knowing(stage))


def test_a_thing_that_never_moves_is_not_explained_by_a_close_look_at_the_base(stage):
    close = look_at((0.35, -0.2, 0.1), (0.0, 0.0, 0.07))
    T_cam_base = np.linalg.inv(close)
    looks = [
        stage.renderer.visible_links(T_cam_base @ stage.robot.link_poses(q)) >= 0 for q in POSES
    ]
    still = np.min(looks, axis=0)  # what such a camera sees of the arm in every view
    overlap = [(still & look).sum() / (still | look).sum() for look in looks]
    assert np.mean(overlap) > 0.8, "the trap must be a trap"
    found = [
        Hypotheses(f"{i}", q, np.stack([still, truth]))
        for i, (q, truth) in enumerate(zip(POSES, arm_masks(stage), strict=True))
    ]
    right = stage.T_mount_cam @ exp_se3([0.02, -0.02, 0.02, 0.01, 0.01, -0.01])
    choice = choose_arm(Rig(stage.robot), stage.camera, found, lambda *_: [close, right])
    assert choice.assignment == ((1,),) * len(POSES)
    assert np.array_equal(choice.T_mount_cam, right)


def test_one_view_is_judged_by_all_of_its_pixels(stage):
    found = [
        Hypotheses("v", POSES[0], np.stack([np.flip(arm_masks(stage)[0]), arm_masks(stage)[0]]))
    ]
    choice = choose_arm(Rig(stage.robot), stage.camera, found, knowing(stage))
    assert choice.assignment == ((1,),)


def test_two_things_that_fit_alike_are_said(stage):
    """A twin in every view, a little aside: the masks cannot tell, and a doubt says so."""
    twins = [np.roll(m, 4, axis=1) for m in arm_masks(stage)]

    class Twins:
        name = "twins"

        def __init__(self):
            self.pairs = iter(zip(arm_masks(stage), twins, strict=True))

        def segment(self, image, text):
            return ScoredMasks(np.stack(next(self.pairs)), np.array([0.5, 0.5]))

    aside = stage.T_mount_cam @ exp_se3([-0.025, 0, 0, 0, 0, 0])
    both = masks_from_text(
        stage.capture(), Twins(), "robot arm", lambda *_: [aside, stage.T_mount_cam]
    )
    (doubt,) = both.doubts
    assert "Two things that the text model found are explained by the joints about as well" in doubt
    assert "Check that the outlined arm is the one whose joints were recorded." in doubt
    assert 0.0 <= both.margin < 0.1
