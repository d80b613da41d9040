"""Everything wrong with a capture folder at once, down to what its pictures show."""

from __future__ import annotations

from pathlib import Path

from easyhecpp.capture.folder import read_folder
from easyhecpp.capture.health import FrameStatistics, health_findings
from easyhecpp.capture.problems import Problem
from easyhecpp.capture.still_camera import Backdrop, camera_moves
from easyhecpp.errors import InputError
from easyhecpp.rig import rides_on_arm


def check_capture(folder: str | Path) -> list[Problem]:
    """Check a capture folder without stopping at the first problem.

    Unlike `Capture.load` this decodes every picture, so it also finds damage inside of files,
    black or frozen frames, jumps of the exposure, and a still camera that moved all the same.

    Args:
        folder: The capture folder.

    Returns:
        Errors first, then warnings, then notes on what was assumed; no errors means that
        `Capture.load` accepts the folder.
    """
    try:
        contents = read_folder(folder)
    except InputError as error:
        return [Problem.from_error(error)]
    findings = contents.findings
    statistics: list[FrameStatistics] = []
    backdrops: list[Backdrop] = []
    still = not rides_on_arm(contents.config.setup)
    for view in contents.views:
        with findings.catching(views=(view.id,), drops="view"):
            image = view.image
            if image is not None:
                statistics.append(FrameStatistics.of(view.id, view.joints, image))
                if still:
                    backdrops.append(Backdrop.of(view.id, image))
    for finding in health_findings(statistics):
        findings.warn(finding.text, fix=finding.fix, views=finding.views)
    moves = camera_moves(backdrops)
    if moves.moved:
        findings.warn(
            moves.text, fix="Fix the camera and take these views again", views=tuple(moves.moved)
        )
    return findings.sorted()
