"""AutoSAM's prompts from what a renderer says is visible."""

from __future__ import annotations

import numpy as np
import pytest
from stage import LINKS, POSES

from easyhecpp.errors import InputError
from easyhecpp.geometry import exp_se3, inverse, transform_points
from easyhecpp.segment import VARIANTS, arm_prompts, padding_from_covariance

NAMES = ("l0", "l1", "l2", "l3")
PARENTS = (-1, 0, 1, 1)  # l3 branches off l1 like l2
BOXES = np.array([[10.0, 50, 19, 59], [10, 30, 19, 49], [20, 30, 49, 34], [0, 0, 4, 39]])


def drawn(boxes=BOXES, size=(60, 80)):
    visible = np.full(size, -1)
    for i, box in enumerate(boxes):
        if np.isfinite(box).all():
            x0, y0, x1, y1 = box.astype(int)
            visible[y0 : y1 + 1, x0 : x1 + 1] = i
    return visible


@pytest.mark.parametrize(
    ("letter", "n_boxes", "with_points"),
    [
        ("a", 1, False),
        ("b", 1, True),
        ("c", 4, False),
        ("d", 4, True),
        ("e", 7, False),
        ("f", 7, True),
    ],
)
def test_the_six_variants_of_the_paper(letter, n_boxes, with_points):
    asked = arm_prompts(BOXES, drawn(), NAMES, PARENTS, letter)
    assert len(asked.prompts) == len(asked.targets) == len(asked.labels) == n_boxes
    if with_points:
        centres = (asked.prompts.boxes[:, :2] + asked.prompts.boxes[:, 2:]) / 2
        assert np.array_equal(asked.prompts.points[:, 0], centres)
    else:
        assert asked.prompts.points is None
    assert asked.skipped == ()


def test_a_single_box_holds_all_links_and_a_connector_its_pair():
    whole = arm_prompts(BOXES, drawn(), NAMES, PARENTS, "a")
    assert whole.prompts.boxes.tolist() == [[0, 0, 49, 59]]
    assert whole.labels == ("the whole arm",)
    asked = arm_prompts(BOXES, drawn(), NAMES, PARENTS)
    assert asked.prompts.boxes[:4].tolist() == BOXES.tolist()
    assert asked.targets[4:] == ((0, 1), (1, 2), (1, 3))
    assert asked.labels[4:] == ("l0 + l1", "l1 + l2", "l1 + l3")
    assert asked.prompts.boxes[4:].tolist() == [[10, 30, 19, 59], [10, 30, 49, 49], [0, 0, 19, 49]]


def test_hidden_links_get_no_prompt_and_no_connector():
    boxes = BOXES.copy()
    boxes[1] = np.nan
    boxes[3] = [0, 0, 4, 3]
    asked = arm_prompts(boxes, drawn(boxes), NAMES, PARENTS)
    assert asked.labels == ("l0", "l2")
    assert asked.skipped == (
        "l1 is out of view or hidden: no prompt.",
        "l3 shows 20 px only: no prompt.",
    )
    nothing = arm_prompts(np.full((4, 4), np.nan), np.full((60, 80), -1), NAMES, PARENTS)
    assert nothing.prompts is None
    assert len(nothing.skipped) == 4


def test_boxes_grow_with_the_uncertainty_inside_the_image():
    padding = np.array([[2.0, 3.0], [0, 0], [100, 100], [1, 1]])
    asked = arm_prompts(BOXES, drawn(), NAMES, PARENTS, "c", padding)
    assert asked.prompts.boxes.tolist() == [
        [8, 47, 21, 59],  # the image ends at 59
        [10, 30, 19, 49],
        [5, 27.5, 64, 36.5],  # by half its side at most
        [0, 0, 5, 40],
    ]


def test_unknown_variants_are_refused():
    with pytest.raises(InputError, match=r"unknown prompt variant 'g'.*one of a, b, c, d, e, f"):
        arm_prompts(BOXES, drawn(), NAMES, PARENTS, "g")


def test_the_paper_s_numbers_stand_beside_the_variants():
    table = {letter: variant.paper_iou for letter, variant in VARIANTS.items()}
    assert table == {"a": 92.3, "b": 93.0, "c": 93.7, "d": 94.2, "e": 98.2, "f": 98.2}


def test_padding_is_two_standard_deviations_of_the_projection(stage):
    """Against poses drawn from the covariance, projected one by one."""
    rng = np.random.default_rng(2)
    root = rng.normal(size=(6, 6)) * np.array([3e-3] * 3 + [2e-3] * 3)[:, None]
    covariance = root @ root.T
    T_cam_base = inverse(stage.T_mount_cam)
    Ts_cam_link = stage.Ts_cam_link(POSES[0])
    padding = padding_from_covariance(stage.camera, stage.robot.meshes, Ts_cam_link, covariance)

    moved = exp_se3(rng.multivariate_normal(np.zeros(6), covariance, size=4000))
    for i, mesh in enumerate(stage.robot.meshes):
        T_base_link = inverse(T_cam_base) @ Ts_cam_link[i]
        Ts = inverse(stage.T_mount_cam @ moved) @ T_base_link
        px = stage.camera.project(transform_points(Ts, mesh.vertices))
        assert 2 * px.std(axis=0).max(axis=0) == pytest.approx(padding[i], rel=0.1)


def test_what_is_behind_the_camera_asks_for_no_padding(stage):
    behind = np.tile(np.diag([1.0, -1, -1, 1]), (len(LINKS), 1, 1))
    behind[:, 2, 3] = -1.0
    padding = padding_from_covariance(stage.camera, stage.robot.meshes, behind, np.eye(6))
    assert np.array_equal(padding, np.zeros((len(LINKS), 2)))


@pytest.mark.parametrize("q", POSES)
def test_every_visible_link_lies_in_its_box(stage, q):
    visible = stage.arm(q)
    boxes = stage.renderer.boxes(stage.Ts_cam_link(q))
    asked = arm_prompts(boxes, visible, LINKS, stage.robot.link_parents)
    for (x0, y0, x1, y1), targets in zip(asked.prompts.boxes, asked.targets, strict=True):
        rows, columns = np.nonzero(np.isin(visible, targets))
        assert [columns.min(), rows.min(), columns.max(), rows.max()] == [x0, y0, x1, y1]
    pairs = [t for t in asked.targets if len(t) == 2]
    assert set(pairs) <= {(0, 1), (1, 2), (2, 3), (3, 4)}
    assert len(pairs) >= 3
