"""What the stages of a calibration hand on to the verdict."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from easyhecpp.capture import Capture
from easyhecpp.geometry import inverse
from easyhecpp.segment.protocols import CaptureMasks
from easyhecpp.segment.quality import ViewQuality
from easyhecpp.solve import Observation, PoseEstimate
from easyhecpp.solve.consistency import Findings
from easyhecpp.solve.leave_out import leave_one_out
from easyhecpp.solve.problem import PoseProblem

_NOTABLE_JOINT_NOISE, _FEWEST_FOR_JOINTS = 2.5e-3, 4
"""Radians, above what masks are mistaken for when nothing is wrong with the joints; and views."""


@dataclass(frozen=True)
class Outcome:
    """A pose and what speaks for and against it.

    Attributes:
        estimate: The pose.
        findings: How the views agree.
        masks: The masks it rests on.
        margin: By how much the first pose beat its best rival, in mean IoU.
        before_edges: The pose before the edge stage; None where that stage was left out.
        doubts: Reasons, beyond those of the estimate, why it may be wrong; sentences.
        notes: What the user should know about how it was done.
        quality: How well pictures and pose agree, view by view and link by link; empty where the
            edges were not looked at.
    """

    estimate: PoseEstimate
    findings: Findings
    masks: CaptureMasks
    margin: float
    before_edges: PoseEstimate | None = None
    doubts: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    quality: tuple[ViewQuality, ...] = ()


def observations_of(capture: Capture, masks: CaptureMasks) -> list[Observation]:
    """The views that have a mask, as the optimiser takes them."""
    joints = {view.id: view.joints for view in capture.views}
    return [
        Observation(joints[v.view_id], _plain(v.mask), v.ignore, id=v.view_id)
        for v in masks.views
        if v.mask is not None
    ]


def with_final_views(capture: Capture, outcome: Outcome) -> Outcome:
    """The same pose, with what is said about each view stated for this pose.

    That is the overlap of rendered and observed mask, and how well the other views predict its
    outline. The edge stage, which does not look at masks, hands on those of where it began.
    """
    problem = PoseProblem(capture.rig, capture.camera, observations_of(capture, outcome.masks))
    T_cam_mount = inverse(outcome.estimate.T_mount_cam)
    seen = problem.gather(T_cam_mount, 1, smoothing_px=0.0, spacing=4.0)
    iou = {o.id: e.iou for o, e in zip(problem.observations, seen, strict=True)}
    views = tuple(
        replace(view, iou=iou.get(view.id, view.iou), prediction_px=prediction.rms_px)
        for view, prediction in zip(
            outcome.estimate.views, leave_one_out(outcome.estimate), strict=True
        )
    )
    return replace(outcome, estimate=replace(outcome.estimate, views=views))


def joint_notes(estimate: PoseEstimate) -> tuple[str, ...]:
    """What the user should know about the joints: nothing, or a sentence."""
    views = sum(view.weight > 0.0 for view in estimate.views)
    if estimate.joint_noise < _NOTABLE_JOINT_NOISE or views < _FEWEST_FOR_JOINTS:
        return ()
    return (
        f"joints: the arm stands about {np.degrees(estimate.joint_noise):.1f} deg off its recorded "
        "joints, in every view another way; this limits the accuracy. Wait longer after each "
        "motion, and read the joints with the picture.",
    )


def _plain(
    mask: NDArray[np.bool_] | NDArray[np.float32],
) -> NDArray[np.bool_] | NDArray[np.float32]:
    return mask if mask.dtype == np.bool_ else mask.astype(np.float32)
