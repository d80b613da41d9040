"""Masks against the kinematic prior."""

from __future__ import annotations

import numpy as np
import pytest

from easyhecpp.segment import JudgeConfig, Prior, judge

SIZE = (80, 120)
NAMES = ("lower", "upper")
CONFIG = JudgeConfig(slack_px=2.0)


def block(rows, columns):
    mask = np.zeros(SIZE, dtype=bool)
    mask[rows[0] : rows[1], columns[0] : columns[1]] = True
    return mask


LOWER = block((40, 70), (40, 60))
UPPER = block((20, 40), (40, 90))
TABLE = block((60, 80), (0, 120))
OTHER = block((0, 30), (95, 118))


@pytest.fixture
def prior():
    visible = np.full(SIZE, -1)
    visible[LOWER], visible[UPPER] = 0, 1
    return Prior(visible, NAMES, np.array([3.0, 3.0]))


def judged(masks, labels, prior):
    return judge(np.stack(masks), labels, prior, CONFIG)


def test_masks_that_agree_are_united(prior):
    result = judged([LOWER, UPPER, LOWER | UPPER], ("lower", "upper", "lower + upper"), prior)
    assert np.array_equal(result.mask, LOWER | UPPER)
    assert not result.ignore.any()
    assert result.agreement == 1.0
    assert result.rejected == (None, None, None)
    assert result.notes == ()


def test_a_swallowed_table_is_rejected_with_its_reason(prior):
    result = judged([LOWER | TABLE, UPPER, LOWER], ("lower", "upper", "lower again"), prior)
    assert np.array_equal(result.mask, LOWER | UPPER)
    assert result.rejected[1:] == (None, None)
    assert result.rejected[0].startswith("The mask of lower is rejected: ")
    assert "it has swallowed something beside the arm" in result.rejected[0]
    assert result.notes == (result.rejected[0],)


def test_a_second_arm_is_rejected_as_another_thing(prior):
    result = judged([LOWER, OTHER, UPPER], ("lower", "upper", "upper again"), prior)
    assert np.array_equal(result.mask, LOWER | UPPER)
    assert "100% of it lies off the arm; it is another thing." in result.rejected[1]


def test_an_empty_mask_is_rejected(prior):
    result = judged([np.zeros(SIZE, bool), LOWER | UPPER], ("lower", "both"), prior)
    assert result.rejected == ("The mask of lower is empty.", None)


def test_a_link_without_a_mask_is_ignored_not_taken_for_background(prior):
    big = judge(np.stack([UPPER]), ["upper"], prior, JudgeConfig(slack_px=2.0, min_arm_cover=0.3))
    assert np.array_equal(big.mask, UPPER)
    assert big.ignore[LOWER].all()
    assert not big.ignore[20:34].any(), "the other link's outline stays in use"
    assert big.notes == ("No mask covers lower (10% of it): its outline is not used.",)
    assert big.agreement == 1.0


def test_a_thin_link_is_not_given_up_because_the_pose_is_unsure(prior):
    moved = np.roll(LOWER | UPPER, 4, axis=1)
    sure = Prior(prior.visible, NAMES, np.array([0.0, 0.0]))
    assert judged([moved], ["both"], sure).agreement > 0.8
    thin = np.full(SIZE, -1)
    strip = block((10, 70), (50, 53))
    thin[strip] = 0
    answer = np.stack([np.roll(strip, 5, axis=1)])
    unsure = judge(
        answer, ["it"], Prior(thin, ["it"], np.array([6.0])), JudgeConfig(min_arm_cover=0)
    )
    assert not unsure.ignore.any()
    sure = judge(answer, ["it"], Prior(thin, ["it"], np.array([1.0])), JudgeConfig(min_arm_cover=0))
    assert sure.ignore.any()


def test_a_tool_that_comes_with_a_mask_is_cut_off_and_its_root_ignored(prior):
    tool = block((24, 36), (90, 110))
    result = judged([LOWER, UPPER | tool], ("lower", "upper"), prior)
    assert result.rejected == (None, None)
    assert not result.mask[:, 96:].any()
    assert result.ignore[24:36, 88:110].all(), "where the tool begins is not known"
    assert not result.ignore[:, :78].any()


def test_masks_that_miss_most_of_the_arm_make_no_mask(prior):
    result = judged([block((40, 46), (40, 60))], ["lower"], prior)
    assert result.mask is None
    assert result.agreement == 0.0
    assert "the pose or the masks are wrong, so this view is left out" in result.notes[0]
    nothing = judged([OTHER, TABLE], ("lower", "upper"), prior)
    assert nothing.mask is None
    assert nothing.notes[0] == "None of the 2 masks agrees with the kinematics."


def test_no_masks_at_all(prior):
    result = judge(np.zeros((0, *SIZE), dtype=bool), (), prior, CONFIG)
    assert result.mask is None
