"""Joint poses to choose from."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from easyhecpp.errors import InputError
from easyhecpp.robot import Robot

F64 = NDArray[np.float64]

_LONGEST_SLIDE_M = 20.0


def joint_ranges(robot: Robot) -> tuple[F64, F64]:
    """Limits ``(n,)`` to draw from: turning joints within one turn about their range's middle.

    Raises:
        InputError: Joints without limits, or with limits that mean nothing; all are named.
    """
    turns = np.array([kind != "prismatic" for kind in robot.joint_types], bool)
    span = robot.upper - robot.lower
    useless = ~np.isfinite(robot.lower) | ~np.isfinite(robot.upper) | ~(span > 0.0)
    useless |= ~turns & (span > _LONGEST_SLIDE_M)
    if robot.n_joints == 0 or useless.any():
        named = [
            f"{name} [{low:g}, {high:g}]"
            for name, low, high, bad in zip(
                robot.joint_names, robot.lower, robot.upper, useless, strict=True
            )
            if bad
        ]
        raise InputError(
            f"The limits of {', '.join(named)} are missing or mean nothing"
            if named
            else "The robot has no joints that move",
            where=f"robot {robot.name}",
            expected="for every joint that moves a lower limit below its upper limit, radians or "
            "metres",
            fix='Complete <limit lower="..." upper="..."/> in the URDF; make joints that never '
            "move 'fixed'",
        )
    middle, half = (robot.lower + robot.upper) / 2.0, span / 2.0
    half = np.where(turns, np.minimum(half, np.pi), half)
    return middle - half, middle + half


def draw_candidates(
    robot: Robot,
    count: int,
    rng: np.random.Generator,
    *,
    around: F64 | None = None,
    spread: float = 0.1,
) -> F64:
    """Joint poses ``(count, n)``, even within the limits, or near given ones.

    Args:
        robot: Any arm.
        count: How many.
        rng: All randomness comes from here.
        around: ``(k, n)`` poses to stay near, each used equally often; None for anywhere.
        spread: Standard deviation about them as a share of each joint's range.

    Raises:
        InputError: A joint has no usable limits.
    """
    lower, upper = joint_ranges(robot)
    if around is None:
        return rng.uniform(lower, upper, (count, robot.n_joints))
    centres = np.atleast_2d(np.asarray(around, np.float64))
    centres = centres[np.arange(count) % len(centres)]
    moved = centres + rng.normal(0.0, spread, centres.shape) * (upper - lower)
    return np.clip(moved, robot.lower, robot.upper)
