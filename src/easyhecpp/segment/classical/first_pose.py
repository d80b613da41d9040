"""The first pose from nothing but motion: the arm's own motion explains how the images change."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from easyhecpp._parallel import parallel_map
from easyhecpp.segment.classical.change import ChangeMaps
from easyhecpp.segment.classical.lines import votes
from easyhecpp.segment.classical.region import EvidenceMaker, Round, fit_regions
from easyhecpp.segment.classical.search import (
    SEARCH_TOLERANCE,
    PairScore,
    Scored,
    SeedGrid,
    distinct,
    search,
)
from easyhecpp.segment.scene import Scene

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]

FINAL_TOLERANCE = 0.3
"""What a pixel without change counts against a refined pose, see :class:`.search.PairScore`."""

_FAR = (Round(14, 8.0, 5), Round(8, 4.0, 5), Round(5, 2.0, 4))
_NEAR = (Round(8, 4.0, 4), Round(5, 2.0, 4))


@dataclass(frozen=True)
class FirstPoseConfig:
    """How wide to search.

    Attributes:
        grid: Seeds.
        max_pairs: Pairs of views that every seed is laid over.
        rescored: Seeds that are scored again on all pairs.
        refined: Of these, the ones that are refined at half the size of the change maps.
        finalists: Of these, the ones that are refined at their full size.
    """

    grid: SeedGrid = field(default_factory=SeedGrid)
    max_pairs: int = 12
    rescored: int = 80
    refined: int = 12
    finalists: int = 4


def first_pose(scene: Scene, changes: ChangeMaps, config: FirstPoseConfig) -> list[Scored]:
    """Candidates for the camera's pose, best first, all different.

    Args:
        scene: The arm.
        changes: Change between pairs of views, some 320 pixels wide.
        config: Settings.
    """
    half = changes.reduced(2)
    found = search(
        scene, changes, config.grid.poses(scene), max_pairs=config.max_pairs, keep=config.rescored
    )
    near = {"metres": 0.15 * scene.radius, "radians": np.deg2rad(6.0)}
    tolerant = PairScore(scene, half, SEARCH_TOLERANCE)
    found = distinct(_score(found, tolerant), config.refined, **near)
    make = vote_maker(half)
    moved = [
        fit_regions(scene, s.T_mount_cam, half.reduction, make, _FAR, coarse=True) for s in found
    ]
    near = {"metres": 0.05 * scene.radius, "radians": np.deg2rad(2.0)}
    found = distinct(_score([Scored(T, 0.0) for T in moved], tolerant), config.finalists, **near)
    make = vote_maker(changes)
    moved = [
        fit_regions(scene, s.T_mount_cam, changes.reduction, make, _NEAR, coarse=True)
        for s in found
    ]
    strict = PairScore(scene, changes, FINAL_TOLERANCE)
    return distinct(_score([Scored(T, 0.0) for T in moved], strict), len(moved), **near)


def _score(found: list[Scored], score: PairScore) -> list[Scored]:
    poses = [s.T_mount_cam for s in found]
    return [Scored(T, s) for T, s in zip(poses, parallel_map(score, poses), strict=True)]


def vote_maker(changes: ChangeMaps) -> EvidenceMaker:
    """Evidence per view from its change against the views that do not show the arm there."""
    kernel = np.ones((5, 5), np.uint8)

    def make(covers: F32) -> list[F32]:
        grown = np.stack([cv2.dilate(cover, kernel) for cover in covers]).astype(np.float32)

        def one(view: int) -> F32:
            out = np.empty(covers.shape[1:], np.float32)
            votes(changes.maps, changes.index, grown, view, 0.05, out)
            return out

        return parallel_map(one, range(len(covers)))

    return make
