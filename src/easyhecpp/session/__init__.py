"""Whole calibrations."""

from easyhecpp.session.calibration import Calibration, CalibrationConfig, calibrate

__all__ = ["Calibration", "CalibrationConfig", "calibrate"]
