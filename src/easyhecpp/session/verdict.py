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
from easyhecpp.solve.reasons import FEW_CONTOUR
from easyhecpp.solve.workspace import point_sigma_mm

Word = Literal["ok", "doubtful", "failed"]

_FAILED_IOU, _DOUBTFUL_IOU = 0.6, 0.9
_DOUBTFUL_OUTLIERS = 0.3
_SMALLEST_MARGIN = 0.03
_SHORT_CONTOUR_PX = 500.0
_DOUBTFUL_ERROR, _FAILED_ERROR = 0.006, 0.05
_FEWEST_AGREEING, _LARGEST_SHARE_OUT = 2, 0.26
_STRAIN_Z, _FOCAL_Z = 4.5, 3.3
"""The focal length moves all outlines alike, so chance imitates it less than a joint's zero."""
_STRAIN_SIZE = {"focal": 0.008, "cx": 8.0, "cy": 8.0}
_STRAIN_JOINT = 0.006


@dataclass(frozen=True)
class Verdict:
    """The verdict on a calibration.

    Attributes:
        verdict: ``ok``, ``doubtful`` or ``failed``.
        reasons: Sentences: what was found and what to do next. An ``ok`` may come with some too:
            views that were left out.
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
    failed, doubtful = _agreement_reasons(findings)
    doubtful += doubts
    for reasons in (
        _fit_reasons(estimate, findings),
        _error_reasons(estimate),
        _contour_reasons(estimate, findings, camera),
    ):
        failed += reasons[0]
        doubtful += reasons[1]
    doubtful += _strain_reasons(findings, rig)
    if margin < _SMALLEST_MARGIN:
        doubtful.append(
            "Another, very different camera pose explains the masks almost as well (by "
            f"{100 * margin:.1f} % of overlap). Add views in which the arm looks different."
        )
    about_views = [v.sentence for v in findings.views if v.sentence]
    word: Word = "failed" if failed else "doubtful" if doubtful else "ok"
    return Verdict(word, (*failed, *doubtful, *about_views))


Reasons = tuple[list[str], list[str]]


def _telling(findings: Findings) -> list[bool]:
    """Which views agree with the pose and show enough of the arm to say so."""
    return [f.consistent and FEW_CONTOUR not in f.flags for f in findings.views]


def _agreement_reasons(findings: Findings) -> Reasons:
    """Views that contradict each other, or too few to check each other."""
    failed: list[str] = []
    doubtful: list[str] = []
    n, out = len(findings.views), len(findings.inconsistent)
    if findings.contradictory:
        failed.append(
            f"No two of the {n} views agree on a camera pose. Check that the joints belong to the "
            "images (order, units, sign), that the masks show this arm, and the URDF."
        )
    elif findings.searched or out > _LARGEST_SHARE_OUT * n:
        doubtful.append(
            f"Only {n - out} of {n} views agree with each other; the pose rests on those. Was the "
            "arm at rest whenever a picture was taken? Take the other views again."
        )
    if sum(_telling(findings)) < _FEWEST_AGREEING:
        doubtful.append(
            "The pose rests on a single view, and nothing checks it. Add views, best three or more "
            "with the arm in very different poses."
        )
    return failed, doubtful


def _fit_reasons(estimate: PoseEstimate, findings: Findings) -> Reasons:
    """Masks that the arm cannot explain."""
    # A view in which the arm can hardly be seen overlaps with its mask by chance, if at all.
    used = [v for v, says in zip(estimate.views, _telling(findings), strict=True) if says]
    iou = float(np.median([v.iou for v in used or estimate.views]))
    outliers = float(np.median([v.outliers for v in used or estimate.views]))
    if iou < _FAILED_IOU:
        return [
            f"The rendered arm does not cover the masks (median IoU {iou:.2f}). Check that the "
            "masks show this arm, the URDF, and the units and order of the joints."
        ], []
    if iou < _DOUBTFUL_IOU or outliers > _DOUBTFUL_OUTLIERS:
        return [], [
            f"The rendered arm and the masks differ more than they should (median IoU {iou:.2f}, "
            f"{outliers:.0%} of the outline disagrees). Look for a tool that the URDF lacks, for "
            "another arm in the masks, and for wrong joint units."
        ]
    return [], []


def _error_reasons(estimate: PoseEstimate) -> Reasons:
    """Predicted error, relative to the distance of the arm."""
    distance = float(np.linalg.norm(estimate.centre_cam))
    covariance = estimate.covariance
    camera_mm = 1e3 * float(np.sqrt(np.trace(covariance[:3, :3])))
    arm_mm = point_sigma_mm(covariance, estimate.centre_cam)
    largest = max(camera_mm, arm_mm)
    numbers = (
        f"{camera_mm:.1f} mm at the camera and {arm_mm:.1f} mm at the arm (one standard deviation)"
    )
    if largest > 1e3 * _FAILED_ERROR * distance or not np.isfinite(largest):
        return [f"The views do not determine the pose: {numbers}. Add views."], []
    if largest > 1e3 * _DOUBTFUL_ERROR * distance:
        axis = np.linalg.eigh(covariance[:3, :3])[1][:, -1]
        along = "along its line of sight" if abs(axis[2]) > 0.8 else "sideways"
        return [], [
            f"The predicted error is large: {numbers}, mostly {along}. Add views in which the arm "
            "stands very differently and fills more of the picture."
        ]
    return [], []


def _contour_reasons(estimate: PoseEstimate, findings: Findings, camera: Camera) -> Reasons:
    used = [v for v, f in zip(estimate.views, findings.views, strict=True) if f.consistent]
    total = sum(v.contour_px * min(1.0, v.weight) for v in used)
    unit = max(0.5, max(camera.width, camera.height) / 1280.0)
    if total >= _SHORT_CONTOUR_PX * unit:
        return [], []
    return [], [
        f"Only {total:.0f} px of the arm's outline can be seen in all views together. Add views "
        "with more of the arm in the picture."
    ]


def _strain_reasons(findings: Findings, rig: Rig) -> list[str]:
    """Intrinsics or joint zeros that the residuals ask to change."""
    reasons = []
    by_name = {s.name: s for s in findings.strains}
    lens = [by_name[n] for n in ("focal", "cx", "cy") if n in by_name]
    strange = [s for s in lens if abs(s.z) > (_FOCAL_Z if s.name == "focal" else _STRAIN_Z)]
    if any(abs(s.value) > _STRAIN_SIZE[s.name] for s in strange):
        asked = ", ".join(
            f"{s.name} by {100 * s.value:+.1f} %"
            if s.name == "focal"
            else f"{s.name} by {s.value:+.0f} px"
            for s in strange
        )
        reasons.append(
            "The outline is off in a way that no camera pose explains but other intrinsics would "
            f"({asked}, at least). Check camera_info: does it belong to this camera, resolution "
            "and lens?"
        )
    joints = [by_name[n] for n in rig.robot.joint_names if n in by_name]
    off = [s for s in joints if abs(s.z) > _STRAIN_Z and abs(s.value) > _STRAIN_JOINT]
    if off and not reasons:
        worst = max(off, key=lambda s: abs(s.z))
        reasons.append(
            "The outline is off in a way that no camera pose explains but another arm would: for "
            f"one, {worst.name} looks off by {np.degrees(worst.value):+.1f} deg. Check that the "
            "URDF is that of this arm, with its tool, and the zeros of its joints."
        )
    return reasons
