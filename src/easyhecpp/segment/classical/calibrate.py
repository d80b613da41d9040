"""From images, joints, intrinsics and the URDF alone to the camera's pose."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from easyhecpp.camera import Camera
from easyhecpp.rig import Rig
from easyhecpp.segment.classical.looks import Look, looked
from easyhecpp.segment.classical.search import Scored
from easyhecpp.segment.classical.segmenter import ClassicalConfig, ClassicalSegmenter
from easyhecpp.segment.edges import EdgeRefinement
from easyhecpp.segment.protocols import ViewMask
from easyhecpp.segment.quality import ViewQuality
from easyhecpp.solve import PoseEstimate

F64 = NDArray[np.float64]
U8 = NDArray[np.uint8]


@dataclass(frozen=True)
class ClassicalResult:
    """What the classical way found.

    Attributes:
        T_mount_cam: ``(4, 4)`` the camera's pose.
        candidates: The first poses with the share of change that each explains, best first.
        margin: How much better the best is than the next, as a share of the best; 0 when two looks
            at the pictures came to two poses that the edges do not tell apart.
        masks: One per view.
        quality: One per view.
        estimate: The pose with covariance, as the solver states it.
        before_edges: The same before the edge stage.
        refinement: What the edge stage did; the camera that the pose goes with is among it.
        reasons: Why the result may be wrong, sentences; empty when it is sure.
        timings_s: Seconds per stage.
    """

    T_mount_cam: F64
    candidates: tuple[Scored, ...]
    margin: float
    masks: tuple[ViewMask, ...]
    quality: tuple[ViewQuality, ...]
    estimate: PoseEstimate
    before_edges: PoseEstimate
    refinement: EdgeRefinement
    reasons: tuple[str, ...]
    timings_s: dict[str, float]

    @property
    def sure(self) -> bool:
        """Whether nothing speaks against the result."""
        return not self.reasons


def calibrate_from_images(
    rig: Rig,
    camera: Camera,
    images: Sequence[U8],
    joints: Sequence[F64],
    *,
    ids: Sequence[str] | None = None,
    config: ClassicalConfig | None = None,
) -> ClassicalResult:
    """Find the camera from images, joints, intrinsics and the URDF alone.

    Args:
        rig: Robot and set-up.
        camera: Intrinsics.
        images: ``(H, W, 3)`` uint8 RGB, one per view.
        joints: ``(n,)`` per view.
        ids: Names of the views.
        config: Settings.

    Raises:
        InputError: Too few views, sizes that do not fit, or a camera that moves with the arm.
        CalibrationError: Nothing moved, or the arm cannot be found.
    """
    config = config or ClassicalConfig()
    timings: dict[str, float] = {}
    clock = time.perf_counter()

    def lap(stage: str) -> None:
        nonlocal clock
        now = time.perf_counter()
        timings[stage], clock = timings.get(stage, 0.0) + now - clock, now

    segmenter = ClassicalSegmenter(rig, camera, images, joints, ids=ids, config=config)
    lap("changes")
    look = looked(segmenter, lap)
    estimate = look.refinement.estimate
    masks = look.segmenter.masks_at(estimate.T_mount_cam)
    lap("last_masks")
    return ClassicalResult(
        T_mount_cam=estimate.T_mount_cam,
        candidates=look.candidates,
        margin=look.margin,
        masks=masks,
        quality=look.quality,
        estimate=replace(estimate, timings_s={**estimate.timings_s, **timings}),
        before_edges=look.before_edges,
        refinement=look.refinement,
        reasons=_doubts(look, config),
        timings_s=timings,
    )


def _doubts(look: Look, config: ClassicalConfig) -> tuple[str, ...]:
    """Reasons why the pose may be wrong."""
    support = look.refinement.support
    reasons = []
    score = look.candidates[0].score
    if score < config.least_explained:
        reasons.append(f"The arm's motion explains only {score:.0%} of what changes in the images.")
    if look.margin < config.least_margin:
        reasons.append("Another camera pose explains the changes in the images nearly as well.")
    if support.share < config.least_edges:
        reasons.append(
            f"Only {support.share:.0%} of the arm's outline lies on an edge of the pictures, "
            f"under {config.least_edges:.0%}."
        )
    if not look.settled:
        reasons.append(
            "The pose does not settle: from where the edges put the camera they put it elsewhere."
        )
    if look.length < config.least_length:
        reasons.append("Only a short piece of the arm's outline is visible.")
    if support.covered < config.least_covered:
        reasons.append(f"The arm covers only {support.covered:.1%} of the images.")
    return tuple(reasons)
