"""Intrinsics and joint zeros refined together with the pose, when the user asks for it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from easyhecpp.capture import Capture
from easyhecpp.errors import CalibrationError
from easyhecpp.session.outcome import Outcome, observations_of
from easyhecpp.session.stages import Stages
from easyhecpp.solve import SolveConfig
from easyhecpp.solve.consistency import solve_consistent
from easyhecpp.solve.nuisance import Strain, read_priors, refine_nuisances

F64 = NDArray[np.float64]


@dataclass(frozen=True)
class Refined:
    """A calibration's state after the refinement, or after it was refused.

    Attributes:
        capture: With the refined intrinsics and joints.
        outcome: The pose that goes with them.
        corrections: What was refined, by how much.
        pose_covariance: ``(6, 6)`` that the doubt about the parameters adds to the pose's.
    """

    capture: Capture
    outcome: Outcome
    corrections: tuple[Strain, ...] = ()
    pose_covariance: F64 | None = None

    def with_doubt(self, outcome: Outcome) -> Outcome:
        """A later stage's outcome, which takes the parameters as known, with the doubt added."""
        if self.pose_covariance is None:
            return outcome
        estimate = outcome.estimate
        covariance = estimate.covariance + self.pose_covariance
        return replace(outcome, estimate=replace(estimate, covariance=covariance))


def refine(
    capture: Capture, outcome: Outcome, words: tuple[str, ...], stages: Stages, config: SolveConfig
) -> Refined:
    """Refine what the words name, and the pose with it.

    Args:
        capture: The views.
        outcome: The pose with everything as stated.
        words: See `read_priors`; nothing is done when there are none.
        stages: Keeps the times.
        config: Settings of the optimiser.

    Returns:
        The refined state. Where the data cannot tell a parameter from the pose, nothing is refined
        and the reason is among the outcome's doubts.

    Raises:
        InputError: A word that names nothing.
    """
    priors = read_priors(words, capture.robot.joint_names)
    if not priors:
        return Refined(capture, outcome)
    out = set(outcome.findings.inconsistent)
    seen = [o for o in observations_of(capture, outcome.masks) if o.id not in out]
    with stages.stage("refine", f"refining {', '.join(priors)} with the pose"):
        try:
            found = refine_nuisances(
                capture.rig, capture.camera, seen, outcome.estimate.T_mount_cam, priors
            )
        except CalibrationError as error:
            return Refined(capture, replace(outcome, doubts=(*outcome.doubts, str(error))))
        views = tuple(v.with_joints(v.joints + found.joint_zeros) for v in capture.views)
        capture = replace(capture, camera=found.camera, views=views)
        estimate, findings = solve_consistent(
            capture.rig,
            capture.camera,
            observations_of(capture, outcome.masks),
            [found.T_mount_cam],
            replace(config, start_error_px=min(config.start_error_px, 8.0)),
        )
    outcome = replace(outcome, estimate=estimate, findings=findings)
    return Refined(capture, outcome, found.corrections, found.pose_covariance)
