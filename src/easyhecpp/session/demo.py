"""The demonstration: pictures like photographs, and a camera whose pose is known."""

from __future__ import annotations

import numpy as np

from easyhecpp.capture import Capture, View
from easyhecpp.session.stages import Progress
from easyhecpp.sim import Cell, CellOptions

VIEWS = 6


def photographed_capture(rng: np.random.Generator, tell: Progress) -> tuple[Capture, Cell]:
    """A capture of an xArm 7 in a random cell: pictures and joints, no masks.

    Args:
        rng: Draws the cell, the camera and the arm's poses.
        tell: Told about every picture.

    Returns:
        The capture, and the cell that knows the true pose of the camera.

    Raises:
        MissingExtraError: The extra ``sim`` is not installed.
    """
    tell("building a random cell with an xArm 7")
    cell = Cell.random("xarm7", rng, options=CellOptions(width=960, height=540))
    views = []
    for i, joints in enumerate(cell.random_joints(VIEWS, rng)):
        tell(f"photographing view {i + 1} of {VIEWS}")
        picture = cell.capture(joints, first_index=i)[0]
        views.append(View(f"{i:04d}", joints, image=picture.image))
    capture = Capture("demo", None, "eye-to-hand", cell.robot, cell.camera, tuple(views))
    return capture, cell
