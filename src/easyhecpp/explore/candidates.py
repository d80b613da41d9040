"""Joint poses to choose from."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from easyhecpp.capture.joints import moved_frames
from easyhecpp.errors import InputError
from easyhecpp.robot import Robot

F64 = NDArray[np.float64]

_LONGEST_SLIDE_M = 20.0
_LEAST_MOVED = 0.02
_MARGIN = 0.02


def joint_ranges(robot: Robot, hold: F64 | None = None) -> tuple[F64, F64]:
    """Limits ``(n,)`` to draw from: turning joints within one turn about their range's middle.

    One percent of its range is left between a joint and each of its ends: arms stop there. Joints
    that hardly move anything, such as a gripper's fingers, are held: both their limits are the
    value in ``hold`` ``(n,)``, or that of the neutral pose.

    Raises:
        InputError: Joints without limits, or with limits that mean nothing; all are named.
    """
    turns = np.array([kind != "prismatic" for kind in robot.joint_types], bool)
    held = _hardly_move(robot)
    span = robot.upper - robot.lower
    useless = ~np.isfinite(robot.lower) | ~np.isfinite(robot.upper) | ~(span > 0.0)
    useless |= ~turns & (span > _LONGEST_SLIDE_M)
    useless &= ~held
    if useless.any() or held.all():
        raise _bad_limits(robot, useless)
    middle, half = (robot.lower + robot.upper) / 2.0, span / 2.0
    endless = np.array([kind == "continuous" for kind in robot.joint_types], bool)
    half = np.where(endless, half, (1.0 - _MARGIN) * half)
    half = np.where(turns, np.minimum(half, np.pi), half)
    still = robot.neutral if hold is None else hold
    return np.where(held, still, middle - half), np.where(held, still, middle + half)


def draw_candidates(
    robot: Robot,
    count: int,
    rng: np.random.Generator,
    *,
    around: F64 | None = None,
    spread: float = 0.1,
    hold: F64 | None = None,
) -> F64:
    """Joint poses ``(count, n)``, even within the limits, or near given ones.

    Args:
        robot: Any arm.
        count: How many.
        rng: All randomness comes from here.
        around: ``(k, n)`` poses to stay near, each used equally often; None for anywhere.
        spread: Standard deviation about them as a share of each joint's range.
        hold: ``(n,)`` whose values joints keep that hardly move anything (a gripper's fingers);
            None for the neutral pose.

    Raises:
        InputError: A joint has no usable limits.
    """
    lower, upper = joint_ranges(robot, hold)
    if around is None:
        return rng.uniform(lower, upper, (count, robot.n_joints))
    centres = np.atleast_2d(np.asarray(around, np.float64))
    centres = centres[np.arange(count) % len(centres)]
    moved = centres + rng.normal(0.0, spread, centres.shape) * (upper - lower)
    return np.clip(moved, lower, upper)


@lru_cache(maxsize=16)
def _hardly_move(robot: Robot) -> NDArray[np.bool_]:
    """``(n,)``: joints that move less than 2 % of the arm's surface."""
    areas = np.array([mesh.area for mesh in robot.meshes])
    return moved_frames(robot) @ areas < _LEAST_MOVED * areas.sum()


def _bad_limits(robot: Robot, useless: NDArray[np.bool_]) -> InputError:
    named = [
        f"{name} [{low:g}, {high:g}]"
        for name, low, high, bad in zip(
            robot.joint_names, robot.lower, robot.upper, useless, strict=True
        )
        if bad
    ]
    if not named:
        return InputError(
            "No joint moves the arm",
            where=f"robot {robot.name}",
            expected="joints that are revolute, continuous or prismatic in the URDF",
        )
    return InputError(
        f"The limits of {', '.join(named)} are missing or mean nothing",
        where=f"robot {robot.name}",
        expected="a lower limit below the upper limit, radians or metres",
        fix='Complete <limit lower="..." upper="..."/> in the URDF; make joints that never move '
        "'fixed'",
    )
