"""The paper's way: masks, first pose, optimisation, and masks again at the better pose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from easyhecpp.capture import Capture
from easyhecpp.geometry import inverse, log_se3
from easyhecpp.initialise import SamplingConfig, sample_initial_pose
from easyhecpp.segment.protocols import CaptureMasks, PoseBelief
from easyhecpp.session.masks import ChosenSource
from easyhecpp.session.outcome import Outcome, observations_of
from easyhecpp.session.stages import Stages
from easyhecpp.solve import PoseEstimate, SolveConfig
from easyhecpp.solve.consistency import Findings, solve_consistent

F64 = NDArray[np.float64]

_MAX_ROUNDS = 3
"""Masks are made anew at the latest pose at most so often."""

_STILL = 0.3
"""Poses that differ by less than this share of their standard deviations count as the same."""


def calibrate_from_masks(
    capture: Capture,
    chosen: ChosenSource,
    stages: Stages,
    *,
    first_pose: Literal["sphere", "paper"],
    config: SolveConfig,
) -> Outcome:
    """Run the loop until neither pose nor masks change.

    Args:
        capture: The views.
        chosen: Makes the masks.
        stages: Keeps the times.
        first_pose: Grid of the first pose, unless the source finds one itself.
        config: Settings of the optimiser.
    """
    loop = _Loop(capture, chosen, stages, config)
    first = masks = loop.masks(None)
    margin, start = loop.first_pose(first, first_pose)
    estimate, findings = loop.solve(masks, [start])
    for _ in range(_MAX_ROUNDS if chosen.refines else 0):
        before = estimate
        masks = loop.masks(estimate)
        estimate, findings = loop.solve(masks, [estimate.T_mount_cam])
        if _same(before, estimate):
            break
    # Later masks are made at the first ones' pose: they cannot clear up which arm that was.
    return Outcome(
        estimate,
        findings,
        masks,
        margin,
        doubts=tuple(dict.fromkeys((*first.doubts, *masks.doubts))),
        notes=tuple(dict.fromkeys((*first.notes, *masks.notes))),
    )


@dataclass(frozen=True)
class _Loop:
    capture: Capture
    chosen: ChosenSource
    stages: Stages
    config: SolveConfig

    def masks(self, at: PoseEstimate | None) -> CaptureMasks:
        message = f"masks: {self.chosen.why}" if at is None else "masks at the latest pose"
        belief = None if at is None else PoseBelief(at.T_mount_cam, at.covariance)
        assert self.chosen.source is not None  # else the classical way runs
        with self.stages.stage("masks", message):
            return self.chosen.source.masks(self.capture, belief)

    def first_pose(
        self, masks: CaptureMasks, grid: Literal["sphere", "paper"]
    ) -> tuple[float, F64]:
        """Margin of the best basin, and the pose to start from."""
        if masks.belief is not None:
            return masks.margin, masks.belief.T_mount_cam
        seen = observations_of(self.capture, masks)
        with self.stages.stage("first pose", f"first pose from {len(seen)} views"):
            first = sample_initial_pose(
                self.capture.rig, self.capture.camera, seen, SamplingConfig(grid)
            )
        return first.margin, first.T_mount_cam

    def solve(self, masks: CaptureMasks, starts: Sequence[F64]) -> tuple[PoseEstimate, Findings]:
        seen = observations_of(self.capture, masks)
        with self.stages.stage("solve", "optimising the pose"):
            return solve_consistent(
                self.capture.rig, self.capture.camera, seen, starts, self.config
            )


def _same(a: PoseEstimate, b: PoseEstimate) -> bool:
    """Whether two estimates differ by much less than they are sure of."""
    step = log_se3(inverse(a.T_mount_cam) @ b.T_mount_cam)
    return bool(step @ np.linalg.solve(b.covariance, step) < 6.0 * _STILL**2)
