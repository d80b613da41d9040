"""Captures: views of a robot by a camera, read from and written to folders."""

from __future__ import annotations

from easyhecpp.capture.camera_info import read_camera_info
from easyhecpp.capture.capture import Capture
from easyhecpp.capture.check import check_capture
from easyhecpp.capture.problems import Problem
from easyhecpp.capture.view import View
from easyhecpp.capture.write import RobotSource, write_capture

__all__ = [
    "Capture",
    "Problem",
    "RobotSource",
    "View",
    "check_capture",
    "read_camera_info",
    "write_capture",
]
