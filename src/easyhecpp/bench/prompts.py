"""The paper's table on prompts, on any capture with true masks: `easyhecpp bench prompts`.

The arm is projected at a known pose, so that the table tells prompts apart and not poses; each view
is encoded once for all six variants.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from easyhecpp.bench.table import Table, describe_machine, machine_sentence
from easyhecpp.capture import Capture
from easyhecpp.errors import InputError
from easyhecpp.initialise import sample_initial_pose
from easyhecpp.render import SilhouetteRenderer
from easyhecpp.segment.autosam import predict
from easyhecpp.segment.judge import JudgeConfig, judge
from easyhecpp.segment.prompts import VARIANTS, Variant
from easyhecpp.segment.protocols import PoseBelief, PromptableSegmenter, image_of, union
from easyhecpp.solve import Observation, solve_pose

F64 = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class PromptScore:
    """How one variant did in one view.

    Attributes:
        view_id: the view.
        variant: letter of the paper's table.
        prompts: how many were asked.
        rejected: how many masks the kinematics rejected.
        iou: of the union of ALL masks with the true mask: the paper's way.
        judged_iou: of the masks that the kinematics let pass, outside of what they ignore; 0 where
            no mask is left.
    """

    view_id: str
    variant: str
    prompts: int
    rejected: int
    iou: float
    judged_iou: float


@dataclass(frozen=True)
class PromptsBench:
    """The prompt ablation of a capture.

    Attributes:
        capture: its name.
        segmenter: model and weights.
        pose: where the pose came from, a sentence.
        scores: one for each view and variant.
    """

    capture: str
    segmenter: str
    pose: str
    scores: tuple[PromptScore, ...]

    def of(self, variant: str) -> list[PromptScore]:
        """The scores of one variant."""
        return [score for score in self.scores if score.variant == variant]


def run_prompts_bench(
    capture: Capture,
    segmenter: PromptableSegmenter,
    T_mount_cam: F64 | None = None,
    pose_error_px: float = 0.0,
) -> PromptsBench:
    """Prompt a segmenter in the paper's six ways and compare with the true masks.

    Args:
        capture: views with an image and a true mask; the others are left out.
        segmenter: turns boxes and points into masks.
        T_mount_cam: (4, 4) pose of the camera at which the arm is projected; None calibrates
            with the true masks first.
        pose_error_px: by how much the boxes grow for a pose that is not exact.

    Raises:
        InputError: no view has an image and a mask.
    """
    views = [i for i, view in enumerate(capture.views) if view.has_image and view.has_mask]
    if not views:
        raise InputError(
            "no view has both an image and a mask",
            where=f"capture {capture.name}",
            expected="true masks to compare with, in masks/",
            fix="take a capture that has them",
        )
    origin = "The camera's pose was given."
    if T_mount_cam is None:
        T_mount_cam = _pose_from_masks(capture, views)
        origin = "The camera's pose was calibrated with the true masks."
    belief = PoseBelief(T_mount_cam)
    renderer = SilhouetteRenderer(capture.robot.meshes, capture.camera)
    scores = [
        score
        for index in views
        for score in _view_scores(capture, index, segmenter, belief, renderer, pose_error_px)
    ]
    return PromptsBench(capture.name, segmenter.name, origin, tuple(scores))


def prompts_table(bench: PromptsBench) -> Table:
    """The measured table beside the paper's."""
    views = len({score.view_id for score in bench.scores})
    return Table(
        title=f"Prompts for {bench.segmenter} on {bench.capture}, {views} views",
        columns=(
            "prompts",
            "boxes",
            "points",
            "connectors",
            "IoU, %",
            "IoU of judged masks, %",
            "rejected",
            "paper's IoU, %",
        ),
        rows=tuple(_line(variant, bench.of(variant.letter)) for variant in VARIANTS.values()),
        notes=(
            "IoU: mean over the views, union of all masks against the given mask, as in the paper. "
            "Judged: after masks that disagree with the kinematics are rejected.",
            "The paper's numbers: its own synthetic xArm images, camera beside the arm, SAM. They "
            "hold for those images and weights only, as do the measured ones for these.",
            bench.pose,
            machine_sentence(describe_machine()),
        ),
    )


def _view_scores(
    capture: Capture,
    index: int,
    segmenter: PromptableSegmenter,
    belief: PoseBelief,
    renderer: SilhouetteRenderer,
    pose_error_px: float,
) -> list[PromptScore]:
    view = capture.views[index]
    assert view.mask is not None  # chosen so
    truth = np.asarray(view.mask, dtype=np.bool_)
    prediction = predict(capture, index, belief, renderer, pose_error_px)
    encoded = segmenter.encode(image_of(capture, index))
    scores = []
    for letter in VARIANTS:
        asked = prediction.prompts(letter)
        if asked.prompts is None:
            scores.append(PromptScore(view.id, letter, 0, 0, 0.0, 0.0))
            continue
        masks = encoded.predict(asked.prompts).masks
        judgement = judge(masks, asked.labels, prediction.prior, JudgeConfig())
        judged = 0.0
        if judgement.mask is not None:
            judged = _iou(judgement.mask, truth, ~judgement.ignore)
        rejected = sum(reason is not None for reason in judgement.rejected)
        raw = _iou(union(masks), truth, np.ones_like(truth))
        scores.append(PromptScore(view.id, letter, len(masks), rejected, raw, judged))
    return scores


def _line(variant: Variant, scores: list[PromptScore]) -> tuple[str | float | None, ...]:
    asked = sum(score.prompts for score in scores)
    rejected = sum(score.rejected for score in scores)
    return (
        variant.letter,
        "per link" if variant.per_link else "single",
        "yes" if variant.points else "no",
        "yes" if variant.connectors else "no",
        100.0 * float(np.mean([score.iou for score in scores])),
        100.0 * float(np.mean([score.judged_iou for score in scores])),
        f"{rejected} of {asked}",
        variant.paper_iou,
    )


def _pose_from_masks(capture: Capture, views: list[int]) -> F64:
    observations = []
    for i in views:
        view = capture.views[i]
        assert view.mask is not None  # chosen so
        observations.append(Observation(view.joints, view.mask, id=view.id))
    start = sample_initial_pose(capture.rig, capture.camera, observations)
    return solve_pose(capture.rig, capture.camera, observations, start.T_mount_cam).T_mount_cam


def _iou(mask: Mask, truth: Mask, where: Mask) -> float:
    either = (mask | truth) & where
    return float((mask & truth & where).sum() / either.sum()) if either.any() else 0.0
