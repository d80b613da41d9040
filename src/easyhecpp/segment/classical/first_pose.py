"""The first pose from nothing but motion: the arm's own motion explains how the images change."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from easyhecpp._parallel import parallel_map
from easyhecpp.segment.classical.change import ChangeMaps
from easyhecpp.segment.classical.climb import climb
from easyhecpp.segment.classical.grid import TURNED, UPRIGHT, SeedGrid
from easyhecpp.segment.classical.search import (
    SEARCH_TOLERANCE,
    PairScore,
    Scored,
    distinct,
    search,
)
from easyhecpp.segment.scene import Scene

F64 = NDArray[np.float64]

FINAL_TOLERANCE = 0.3
"""What a pixel without change counts against a refined pose, see :class:`.search.PairScore`."""

_FAR_STEP, _NEAR_STEP = 1.0, 0.2
_FAR_EVALUATIONS, _NEAR_EVALUATIONS = 120, 90

_CLIMBING_VIEWS = 6
"""Most views that the climb looks at; the last ranking looks at all."""


@dataclass(frozen=True)
class FirstPoseConfig:
    """How wide to search.

    Attributes:
        grids: Seeds, and how many of each are refined at half the size of the change maps: most
            cameras stand upright, so these are not crowded out by the many that do not.
        rescored: Seeds that are scored again on all pairs.
        finalists: Of the refined, the ones that are refined at their full size.
    """

    grids: tuple[tuple[SeedGrid, int], ...] = ((UPRIGHT, 12), (TURNED, 8))
    rescored: int = 80
    finalists: int = 4


def first_pose(scene: Scene, changes: ChangeMaps, config: FirstPoseConfig) -> list[Scored]:
    """Candidates for the camera's pose, best first, all different.

    Args:
        scene: The arm.
        changes: Change between pairs of views, some 320 pixels wide.
        config: Settings.
    """
    far, near = _apart(scene, 0.15, 6.0), _apart(scene, 0.05, 2.0)
    tolerant = PairScore(scene, changes.reduced(2), SEARCH_TOLERANCE, _CLIMBING_VIEWS)
    starts = []
    for grid, refined in config.grids:
        seeds = search(
            scene,
            changes,
            grid.poses(scene),
            grid.turns,
            size_px=grid.size_px,
            max_pairs=grid.max_pairs,
            keep=config.rescored,
        )
        starts += distinct(rescored(seeds, tolerant), refined, **far)
    found = _climbed(scene, starts, tolerant, _FAR_STEP, _FAR_EVALUATIONS)
    found = distinct(found, config.finalists, **far)
    some = PairScore(scene, changes, FINAL_TOLERANCE, _CLIMBING_VIEWS)
    found = _climbed(scene, found, some, _NEAR_STEP, _NEAR_EVALUATIONS)
    strict = PairScore(scene, changes, FINAL_TOLERANCE)
    return distinct(rescored(found, strict), len(found), **near)


def _apart(scene: Scene, share: float, degrees: float) -> dict[str, float]:
    """How far apart poses are two, see :func:`.search.distinct`."""
    return {"metres": share * scene.radius, "radians": float(np.deg2rad(degrees))}


def rescored(found: Sequence[Scored], score: Callable[[F64], float]) -> list[Scored]:
    """The same poses by another score."""
    poses = [s.T_mount_cam for s in found]
    return [Scored(T, s) for T, s in zip(poses, parallel_map(score, poses), strict=True)]


def _climbed(
    scene: Scene,
    found: Sequence[Scored],
    score: Callable[[F64], float],
    step: float,
    evaluations: int,
) -> list[Scored]:
    return parallel_map(
        lambda s: climb(score, scene, s.T_mount_cam, step=step, evaluations=evaluations), found
    )
