"""Captures: views of a robot by a camera, read from and written to folders."""

from __future__ import annotations

from easyhecpp.capture.camera_info import read_camera_info
from easyhecpp.capture.capture import Capture
from easyhecpp.capture.check import check_capture
from easyhecpp.capture.problems import Problem
from easyhecpp.capture.view import View

__all__ = ["Capture", "Problem", "View", "check_capture", "read_camera_info"]
