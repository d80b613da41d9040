"""The demonstration: pictures like photographs, chosen joint poses, and a pose that is known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from easyhecpp.capture import Capture, View
from easyhecpp.errors import CalibrationError, InputError
from easyhecpp.explore import (
    CollisionChecker,
    ExploreConfig,
    choose_many,
    first_joint_poses,
)
from easyhecpp.session.calibration import Calibration, CalibrationConfig, calibrate
from easyhecpp.session.next_poses import what_is_known
from easyhecpp.sim import Cell, CellOptions
from easyhecpp.sim.possible_poses import PossiblePoses

F64 = NDArray[np.float64]

FIRST_VIEWS, CHOSEN_VIEWS = 4, 2
"""Views before anything is known of the camera, and views chosen with what they told."""


@dataclass(frozen=True)
class Demonstration:
    """A calibration whose truth is known.

    Attributes:
        found: The calibration of all views.
        first: That of the first views alone; None where they were not enough.
        cell: Knows the true pose of the camera.
        choices: Why the later joint poses were chosen, a sentence each.
    """

    found: Calibration
    first: Calibration | None
    cell: Cell
    choices: tuple[str, ...]


def demonstrate(
    rng: np.random.Generator, tell: Callable[[str], None], command: str | None = None
) -> Demonstration:
    """Calibrate a random cell's camera from pictures alone, choosing joint poses on the way.

    Args:
        rng: Draws the cell, the camera and the candidates for joint poses.
        tell: Told what is being done.
        command: The command line, for the record.

    Raises:
        MissingExtraError: The extra ``sim`` is not installed.
        CalibrationError: The arm cannot be found in the pictures.
    """
    tell("building a random cell with an xArm 7")
    cell = Cell.random("xarm7", rng, options=CellOptions(width=960, height=540))
    checker = PossiblePoses.of(cell.poses)
    tell("choosing joint poses for a camera that may be anywhere")
    blind = first_joint_poses(
        cell.robot, cell.camera, FIRST_VIEWS + CHOSEN_VIEWS, rng, checker=checker
    )
    views = _photographed(cell, blind[:FIRST_VIEWS], (), tell)
    config = CalibrationConfig(segmenter="classical")
    try:
        first = calibrate(_capture(cell, views), config, progress=tell)
        tell("choosing the next joint poses with the pose found so far")
        joints, choices = _chosen(first, cell, checker, rng)
    except (CalibrationError, InputError) as error:
        first, joints = None, blind[FIRST_VIEWS:]
        choices = (f"Joint poses for any camera were taken: {error}",)
    views = _photographed(cell, joints, views, tell)
    found = calibrate(_capture(cell, views), config, progress=tell, command=command)
    return Demonstration(found, first, cell, choices)


def _chosen(
    first: Calibration, cell: Cell, checker: CollisionChecker, rng: np.random.Generator
) -> tuple[F64, tuple[str, ...]]:
    known = what_is_known(first)
    proposals = choose_many(
        cell.rig, cell.camera, known, ExploreConfig(), CHOSEN_VIEWS, rng, checker=checker
    )
    return np.array([p.joints for p in proposals]), tuple(p.reason for p in proposals)


def _photographed(
    cell: Cell, joints: F64, before: tuple[View, ...], tell: Callable[[str], None]
) -> tuple[View, ...]:
    views = list(before)
    for q in joints:
        tell(f"photographing view {len(views) + 1} of {FIRST_VIEWS + CHOSEN_VIEWS}")
        picture = cell.capture(q, first_index=len(views))[0]
        views.append(View(f"{len(views):04d}", q, image=picture.image))
    return tuple(views)


def _capture(cell: Cell, views: tuple[View, ...]) -> Capture:
    return Capture("demo", None, "eye-to-hand", cell.robot, cell.camera, views)
