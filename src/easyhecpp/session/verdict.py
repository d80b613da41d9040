"""Whether a pose can be trusted, why, and what to do next."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from easyhecpp.camera import Camera
from easyhecpp.rig import Rig
from easyhecpp.solve import PoseEstimate
from easyhecpp.solve.consistency import Findings

Word = Literal["ok", "doubtful", "failed"]


@dataclass(frozen=True)
class Verdict:
    """The verdict on a calibration.

    Attributes:
        verdict: ``ok``, ``doubtful`` or ``failed``.
        reasons: Sentences: what was found and what to do next.
    """

    verdict: Word
    reasons: tuple[str, ...]


def judge(
    estimate: PoseEstimate,
    findings: Findings,
    rig: Rig,
    camera: Camera,
    *,
    margin: float = 1.0,
    doubts: Sequence[str] = (),
) -> Verdict:
    """Judge a pose.

    Args:
        estimate: The pose.
        findings: How the views agree.
        rig: Robot and set-up.
        camera: Intrinsics.
        margin: Mean IoU by which the first pose beat its best rival, see `InitialPose.margin`.
        doubts: Reasons for doubt that an earlier stage found, sentences.
    """
    failed: list[str] = []
    doubtful: list[str] = list(doubts)
    mean_iou = float(np.mean([v.iou for v in estimate.views]))
    if mean_iou < 0.6:
        failed.append(
            f"The rendered arm covers the masks badly (mean IoU {mean_iou:.2f}). Check that the "
            "masks show this arm, and the URDF and the joint units."
        )
    if margin < 0.02:
        doubtful.append(
            "A very different camera pose explains the first masks almost as well. Add views in "
            "which the arm looks different."
        )
    if findings.inconsistent:
        doubtful.append(
            f"Left out: {', '.join(findings.inconsistent)}. Take them again or remove them."
        )
    if failed:
        return Verdict("failed", (*failed, *doubtful))
    return Verdict("doubtful", tuple(doubtful)) if doubtful else Verdict("ok", ())
