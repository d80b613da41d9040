"""The paper's table on prompts, with stand-ins for the model whose answers are known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from stage import POSES, PerfectSam, Stage

from easyhecpp.bench.prompts import prompts_table, run_prompts_bench
from easyhecpp.capture import Capture, View
from easyhecpp.errors import InputError
from easyhecpp.segment import ScoredMasks


@pytest.fixture(scope="module")
def stage(tmp_path_factory) -> Stage:
    return Stage.build(tmp_path_factory.mktemp("stage"))


class BoxFiller:
    """Answers every box with all of the box."""

    name = "box filler (no weights)"

    def encode(self, image):
        return _Filled(image.shape[:2])


@dataclass
class _Filled:
    size: tuple[int, int]

    def predict(self, prompts):
        masks = np.zeros((len(prompts), *self.size), dtype=bool)
        for mask, box in zip(masks, prompts.boxes.astype(int), strict=True):
            mask[box[1] : box[3] + 1, box[0] : box[2] + 1] = True
        return ScoredMasks(masks, np.ones(len(masks)))


def test_a_perfect_model_scores_one_hundred_where_links_are_asked_for(stage):
    sam = PerfectSam()
    bench = run_prompts_bench(stage.capture(), sam, stage.T_mount_cam)
    assert len(sam.encoded) == len(POSES), "one encoding serves all six variants"
    assert len(sam.asked) == 6 * len(POSES)
    for letter in "cdef":
        scores = bench.of(letter)
        assert [s.view_id for s in scores] == ["0000", "0001", "0002", "0003", "0004"]
        assert all(s.iou == s.judged_iou == 1.0 and s.rejected == 0 for s in scores)


def test_iou_is_that_of_the_union_of_all_masks(stage):
    bench = run_prompts_bench(stage.capture(), BoxFiller(), stage.T_mount_cam)
    for index, q in enumerate(POSES):
        visible = stage.arm(q)
        truth = visible >= 0
        rows, columns = np.nonzero(truth)
        single = np.zeros_like(truth)
        single[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1] = True
        assert bench.of("a")[index].iou == pytest.approx(truth.sum() / single.sum())
        assert bench.of("a")[index].prompts == 1
        assert bench.of("c")[index].iou >= bench.of("a")[index].iou
        assert bench.of("e")[index].iou <= bench.of("c")[index].iou, "connectors hold more air"


def test_masks_off_the_arm_are_counted_and_judged_away(stage):
    capture = stage.capture(table=(slice(150, 240), slice(0, 320)))
    bench = run_prompts_bench(capture, PerfectSam(), stage.T_mount_cam)
    assert sum(s.rejected for s in bench.of("e")) > 0
    judged = [s.judged_iou for s in bench.of("e") if s.judged_iou]
    assert np.mean(judged) > np.mean([s.iou for s in bench.of("e")])


def test_without_a_pose_the_true_masks_are_calibrated_first(stage):
    bench = run_prompts_bench(stage.capture(), PerfectSam())
    assert "calibrated with the true masks" in bench.pose
    assert np.mean([s.iou for s in bench.of("e")]) > 0.99


def test_the_paper_s_table_stands_beside(stage):
    bench = run_prompts_bench(stage.capture(), BoxFiller(), stage.T_mount_cam)
    table = prompts_table(bench)
    assert table.title == "Prompts for box filler (no weights) on stage, 5 views"
    assert [row[0] for row in table.rows] == list("abcdef")
    assert [row[-1] for row in table.rows] == [92.3, 93.0, 93.7, 94.2, 98.2, 98.2]
    assert [row[1:4] for row in table.rows] == [
        ("single", "no", "no"),
        ("single", "yes", "no"),
        ("per link", "no", "no"),
        ("per link", "yes", "no"),
        ("per link", "no", "yes"),
        ("per link", "yes", "yes"),
    ]
    assert table.rows[0][4] == pytest.approx(100 * np.mean([s.iou for s in bench.of("a")]))
    assert any("hold for those images and weights only" in note for note in table.notes)


def test_an_arm_out_of_view_scores_nothing(stage):
    away = stage.T_mount_cam @ np.diag([1.0, -1, -1, 1])
    bench = run_prompts_bench(stage.capture(), PerfectSam(), away)
    assert all(s.iou == s.judged_iou == 0.0 and s.prompts == 0 for s in bench.scores)
    assert prompts_table(bench).rows[4][4] == 0.0


def test_true_masks_are_needed(stage):
    view = View("0000", POSES[0], image=stage.picture(POSES[0]))
    capture = Capture("bare", None, "eye-to-hand", stage.robot, stage.camera, (view,))
    with pytest.raises(InputError, match=r"no view has both an image and a mask \(capture bare\)"):
        run_prompts_bench(capture, PerfectSam(), stage.T_mount_cam)
