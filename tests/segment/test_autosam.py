"""AutoSAM over a capture, with a stand-in that outlines coloured things perfectly."""

from __future__ import annotations

import numpy as np
import pytest
from stage import OTHER_POSES, POSES, AllArms, PerfectSam

from easyhecpp.capture import Capture, View
from easyhecpp.errors import InputError
from easyhecpp.geometry import exp_se3
from easyhecpp.segment import (
    AutoSam,
    AutoSamConfig,
    CaptureMasks,
    PoseBelief,
    RememberingSegmenter,
    ViewMask,
)
from easyhecpp.segment.protocols import require_usable

TABLE = (slice(150, 240), slice(0, 320))


def iou(mask, truth, ignore=None):
    keep = np.ones_like(truth) if ignore is None else ~ignore
    return (mask & truth & keep).sum() / ((mask | truth) & keep).sum()


@pytest.fixture
def belief(stage):
    return PoseBelief(stage.T_mount_cam)


@pytest.mark.parametrize("variant", "cdef")
def test_with_a_perfect_model_link_by_link_gives_the_arm(stage, belief, variant):
    sam = PerfectSam()
    source = AutoSam(sam, config=AutoSamConfig(variant, unknown_error_px=0.0))
    masks = source.masks(stage.capture(), belief)
    assert len(sam.encoded) == len(POSES)
    assert masks.belief is belief
    for view, q in zip(masks.views, POSES, strict=True):
        assert np.array_equal(view.mask, stage.arm(q) >= 0)
        assert view.score == 1.0
        assert not view.ignore.any()


@pytest.mark.parametrize("with_covariance", [True, False])
def test_a_pose_that_is_off_by_its_uncertainty_still_gives_the_arm(stage, with_covariance):
    sigmas = np.array([8e-3] * 3 + [6e-3] * 3)
    off = exp_se3(sigmas * np.array([1, -1, 1, -1, 1, 1]))
    belief = PoseBelief(stage.T_mount_cam @ off, np.diag(sigmas**2) if with_covariance else None)
    masks = AutoSam(PerfectSam()).masks(stage.capture(), belief)
    for view, q in zip(masks.views, POSES, strict=True):
        assert iou(view.mask, stage.arm(q) >= 0, view.ignore) > 0.97


def test_a_table_and_a_second_arm_do_not_get_into_the_masks(stage, belief):
    capture = stage.capture(others=list(OTHER_POSES), table=TABLE)
    masks = AutoSam(PerfectSam(), config=AutoSamConfig(unknown_error_px=2.0)).masks(capture, belief)
    reasons = [note for view in masks.views for note in view.notes]
    assert any("swallowed something" in note or "another thing" in note for note in reasons)
    assert len(masks.usable) >= 4
    for view, q in zip(masks.views, POSES, strict=True):
        if view.mask is not None:
            assert iou(view.mask, stage.arm(q) >= 0, view.ignore) > 0.97


def test_rounds_at_better_poses_encode_nothing_again(stage, belief):
    sam = PerfectSam()
    source = AutoSam(RememberingSegmenter(sam))
    for _ in range(3):
        source.masks(stage.capture(), belief)
    assert len(sam.encoded) == len(POSES)
    assert len(sam.asked) == 3 * len(POSES)


def test_text_finds_the_first_masks_and_pose(stage):
    answers = []

    def first_pose(rig, camera, observations):
        answers.append(len(observations))
        return [stage.T_mount_cam]

    source = AutoSam(PerfectSam(), AllArms(), first_pose=first_pose)
    assert source.name == "all arms"
    masks = source.masks(stage.capture(others=list(OTHER_POSES)))
    assert np.array_equal(masks.belief.T_mount_cam, stage.T_mount_cam)
    for view, q in zip(masks.views, POSES, strict=True):
        assert np.array_equal(view.mask, stage.arm(q) >= 0)
    assert answers


def test_a_box_model_alone_says_what_it_lacks(stage):
    with pytest.raises(InputError, match=r"cannot find the arm by itself.*grounded-sam.*classical"):
        AutoSam(PerfectSam()).masks(stage.capture())


def test_a_view_without_an_image_is_named(stage, belief):
    capture = Capture(
        "dark", None, "eye-to-hand", stage.robot, stage.camera, (View("0003", POSES[0]),)
    )
    with pytest.raises(InputError, match=r"view 0003 has no image \(capture dark\)"):
        AutoSam(PerfectSam()).masks(capture, belief)


def test_when_no_view_has_a_mask_each_is_named_with_what_next(stage, belief):
    black = np.zeros((240, 320, 3), dtype=np.uint8)
    views = (View("0001", POSES[0], image=black), View("0002", POSES[1], image=black))
    capture = Capture("night", None, "eye-to-hand", stage.robot, stage.camera, views)
    with pytest.raises(InputError) as caught:
        AutoSam(PerfectSam()).masks(capture, belief)
    text = str(caught.value)
    assert "perfect gave a usable mask in 0 of 2 views" in text
    assert "view 0001: None of the 9 masks agrees with the kinematics. The mask of" in text
    assert "view 0002" in text
    assert "--segmenter classical" in text


def test_an_arm_out_of_view_costs_no_encoding(stage):
    sam = PerfectSam()
    away = stage.T_mount_cam @ np.diag([1.0, -1, -1, 1])
    with pytest.raises(InputError, match=r"view 0000: The arm is out of view\."):
        AutoSam(sam).masks(stage.capture(), PoseBelief(away))
    assert sam.encoded == []


def test_usable_views_are_those_with_a_mask():
    some = ViewMask("1", np.ones((2, 2), bool))
    none = ViewMask("2", None, notes=("Nothing there.",))
    assert CaptureMasks((some, none)).usable == (some,)
    require_usable([some, none], "it")
    with pytest.raises(InputError, match=r"1 of 2 views \(view 2: Nothing there\.\)"):
        require_usable([some, none], "it", at_least=2)
