"""How low an arm reaches, and what it stands on."""

from __future__ import annotations

from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from easyhecpp.explore.candidates import draw_candidates
from easyhecpp.geometry import transform_points
from easyhecpp.robot import Robot

F64 = NDArray[np.float64]
Bool = NDArray[np.bool_]

Floor = float | Literal["foot"] | None
"""Height in the base frame, metres; ``foot`` for the lowest point of the links that stand still;
None for no floor."""

_DIRECTIONS = 64
_FLUSH_M = 0.002


def floor_height(robot: Robot, floor: Floor) -> float:
    """The lowest height that moving links may reach, metres in the base frame."""
    if floor is None:
        return -np.inf
    if floor != "foot":
        return float(floor)
    still = np.flatnonzero(~moving_links(robot))
    Ts = robot.link_poses(robot.neutral)
    heights = [transform_points(Ts[i], robot.meshes[i].vertices)[:, 2].min() for i in still]
    # Modelled to touch the table is not to run into it.
    return float(min(heights, default=-np.inf)) - _FLUSH_M


def lowest_points(robot: Robot, joints: F64) -> F64:
    """Height ``(N,)`` of the lowest point of the links that move, metres in the base frame."""
    moves = moving_links(robot)
    if not moves.any():
        return np.full(len(joints), np.inf)
    points = transform_points(robot.link_poses(joints)[:, moves], _extremes(robot)[moves])
    return points[..., 2].min(axis=(-2, -1))


@lru_cache(maxsize=16)
def moving_links(robot: Robot) -> Bool:
    """Which links with geometry move in the base frame: ``(L,)``."""
    Ts = robot.link_poses(draw_candidates(robot, 8, np.random.default_rng(0)))
    return np.ptp(Ts, axis=0).max(axis=(-1, -2)) > 1e-6


@lru_cache(maxsize=16)
def _extremes(robot: Robot) -> F64:
    """``(L, D, 3)`` vertices that lie farthest along some directions, link frames."""
    directions = np.random.default_rng(0).normal(size=(_DIRECTIONS, 3))
    return np.stack(
        [mesh.vertices[np.argmax(mesh.vertices @ directions.T, axis=0)] for mesh in robot.meshes]
    )
