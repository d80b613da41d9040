"""The next joint pose: the one after which the camera is known best.

For every candidate the covariance of the camera with that view added is predicted,

    P = J (sum_k I_k + I_new + prior)^-1 J',

and the candidate with the smallest expected squared error of the camera wins: that of its position,
plus that of its orientation times the distance to the arm (A-optimality; ``J`` maps from the arm's
middle to the camera). The expectation is over poses drawn from the present covariance: a view that
tells much only if the estimate happens to be exact is no good. The best are then improved by small
changes of their joints.

The paper's way, `consistency`, takes the joint pose at which masks under different camera poses
differ most; it asks neither what is known already nor which direction of the error counts.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from easyhecpp.camera import Camera
from easyhecpp.errors import InputError
from easyhecpp.explore.box_check import BoxCheck
from easyhecpp.explore.consistency import ConsistencyConfig, consistency_scores
from easyhecpp.explore.feasible import Feasible, Limits
from easyhecpp.explore.forecast import Forecast
from easyhecpp.explore.knowledge import METHODS, Knowledge, Method, Proposal
from easyhecpp.explore.protocols import CollisionChecker
from easyhecpp.rig import Rig

F64 = NDArray[np.float64]

_SHORTLIST, _KEPT = 60, 6
_POLISH, _SPREADS = 36, (0.08, 0.04, 0.02)


@dataclass(frozen=True)
class ExploreConfig:
    """Settings of the choice.

    Attributes:
        method: ``information``, the paper's ``consistency``, or ``random``.
        candidates: Joint poses that ``information`` scores.
        hypotheses: Poses that the camera may have, the estimate and others drawn from its
            covariance, under which the best of them are scored.
        consistency: Counts of the paper's way.
        target_position_mm: Stop when the camera's position is known as well as this.
        min_gain: Stop when the best view takes away less than this share of the position's
            standard deviation.
        limits: What a joint pose must satisfy.
    """

    method: Method = "information"
    candidates: int = 300
    hypotheses: int = 3
    consistency: ConsistencyConfig = field(default_factory=ConsistencyConfig)
    target_position_mm: float | None = None
    min_gain: float = 0.03
    limits: Limits = field(default_factory=Limits)

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise InputError(
                f"There is no method {self.method!r} of choosing joint poses",
                expected=f"one of {', '.join(METHODS)}",
            )
        if self.candidates < 1 or self.hypotheses < 1:
            raise InputError(
                f"{self.candidates} candidates under {self.hypotheses} hypotheses cannot be scored",
                expected="at least one of each",
            )


def choose_next(
    rig: Rig,
    camera: Camera,
    known: Knowledge,
    config: ExploreConfig,
    rng: np.random.Generator,
    *,
    checker: CollisionChecker | None = None,
) -> Proposal:
    """Choose the joint pose for the next view.

    Args:
        rig: Robot and set-up.
        camera: Intrinsics.
        known: The camera as far as it is known.
        config: Settings.
        rng: Draws candidates and hypotheses.
        checker: Knows collisions; by default a rough test by the links' bounding boxes.

    Raises:
        InputError: Joint limits that mean nothing, or no joint pose that suits; the text says what
            was wrong with those drawn.
    """
    return choose_many(rig, camera, known, config, 1, rng, checker=checker)[0]


def choose_many(
    rig: Rig,
    camera: Camera,
    known: Knowledge,
    config: ExploreConfig,
    count: int,
    rng: np.random.Generator,
    *,
    checker: CollisionChecker | None = None,
) -> list[Proposal]:
    """Choose several joint poses at once, each as if the ones before had been taken.

    Args and errors as of `choose_next`.
    """
    checker = checker or BoxCheck(rig.robot)
    forecast = Forecast.of(rig, camera, known, config.hypotheses, rng)
    earlier = known.joints
    proposals: list[Proposal] = []
    for _ in range(count):
        feasible = Feasible(rig, camera, known.T_mount_cam, checker, config.limits, earlier)
        if config.method == "information":
            choice = _by_information(forecast, feasible, config, rng)
        elif config.method == "consistency":
            choice = _by_consistency(known, feasible, config.consistency, rng)
        else:
            choice = _Choice(feasible.draw(1, rng)[0], 0.0, 1)
        proposals.append(_proposal(choice, forecast, feasible, config))
        earlier = np.concatenate([earlier, choice.joints[None]])
        forecast = forecast.with_view(choice.joints)
    return proposals


@dataclass(frozen=True)
class _Choice:
    joints: F64
    score: float
    considered: int


def _by_information(
    forecast: Forecast, feasible: Feasible, config: ExploreConfig, rng: np.random.Generator
) -> _Choice:
    drawn = feasible.draw(config.candidates, rng)
    # One hypothesis tells which are worth a second look.
    first = np.argsort(forecast.mean_squares(drawn, 1), kind="stable")[:_SHORTLIST]
    best, considered = drawn[first], len(drawn)
    squares = forecast.mean_squares(best)
    for spread in _SPREADS:
        order = np.argsort(squares, kind="stable")[:_KEPT]
        best, squares = best[order], squares[order]
        near = feasible.draw_near(best, spread, _POLISH, rng)
        if len(near):
            best = np.concatenate([best, near])
            squares = np.concatenate([squares, forecast.mean_squares(near)])
            considered += len(near)
    winner = int(np.argmin(squares))
    return _Choice(best[winner], -1e3 * float(np.sqrt(squares[winner])), considered)


def _by_consistency(
    known: Knowledge, feasible: Feasible, config: ConsistencyConfig, rng: np.random.Generator
) -> _Choice:
    drawn = feasible.draw(config.joint_poses, rng)
    Ts = known.hypotheses(config.hypotheses, rng)
    scores = consistency_scores(feasible.rig, feasible.camera, Ts, drawn, config)
    winner = int(np.argmax(scores))
    return _Choice(drawn[winner], float(scores[winner]), len(drawn))


def _proposal(
    choice: _Choice, forecast: Forecast, feasible: Feasible, config: ExploreConfig
) -> Proposal:
    position, rotation = forecast.present()
    predicted_position, predicted_rotation = forecast.expected(choice.joints)
    gain = 1.0 - predicted_position / position
    stop_reason = ""
    if config.target_position_mm is not None and position <= config.target_position_mm:
        stop_reason = (
            f"The camera's position is known to {position:.2f} mm, the target was "
            f"{config.target_position_mm:g} mm."
        )
    elif config.method != "random" and gain < config.min_gain:
        stop_reason = (
            f"Another view would lower the position's standard deviation of {position:.2f} mm by "
            f"{100 * max(0.0, gain):.0f} % only."
        )
    return Proposal(
        joints=choice.joints,
        method=config.method,
        score=choice.score,
        predicted_position_mm=predicted_position,
        predicted_rotation_deg=predicted_rotation,
        position_mm=position,
        rotation_deg=rotation,
        gain=gain,
        considered=choice.considered,
        rejected=dict(feasible.rejected),
        reason=_reason(choice, config.method, position, predicted_position),
        stop=bool(stop_reason),
        stop_reason=stop_reason,
        notes=(feasible.checker.description,),
    )


def _reason(choice: _Choice, method: Method, position: float, predicted: float) -> str:
    change = (
        f"the standard deviation of the camera's position should go from {position:.2f} to "
        f"{predicted:.2f} mm"
    )
    if method == "information":
        return f"Of {choice.considered} joint poses this one tells most: {change}."
    if method == "consistency":
        return (
            f"Of {choice.considered} joint poses the masks differ most here between the poses that "
            f"the camera may have, by {choice.score:.0f} px of summed variance; {change}."
        )
    return f"Drawn at random; {change}."
