"""The real captures, and what counts as the same pose on them."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from easyhecpp.camera import Camera
from easyhecpp.capture import Capture, View

CAPTURES = ("xarm7_realsense", "lbr_med7_realsense")
SAME_METRES, SAME_DEGREES = 0.020, 2.0


def turned(capture: Capture, quarters: int) -> tuple[Capture, NDArray[np.float64]]:
    """As a camera records that is turned about its axis, by quarters of a turn clockwise.

    Returns:
        The capture, and ``(4, 4)`` T_cam_turned of the turned camera in the one that recorded.
    """
    c, turn = capture.camera, np.eye(4)
    for _ in range(quarters):
        # What it sees turns the other way: (x, y) goes to (y, width - 1 - x).
        c = Camera(c.height, c.width, c.fy, c.fx, c.cy, c.width - 1 - c.cx, frame=c.frame)
        turn[:3, :3] = turn[:3, :3] @ np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    views = [
        View(v.id, v.joints, _turned(v.image, quarters), _turned(v.mask, quarters))
        for v in capture.views
    ]
    return replace(capture, root=None, camera=c, views=tuple(views)), turn


def _turned(pixels: NDArray[np.generic] | None, quarters: int) -> NDArray[np.generic] | None:
    return None if pixels is None else np.ascontiguousarray(np.rot90(pixels, quarters))
