"""Whole calibrations."""

from easyhecpp.session.calibration import Calibration, CalibrationConfig, calibrate
from easyhecpp.session.masks import PretrainedConfig

__all__ = ["Calibration", "CalibrationConfig", "PretrainedConfig", "calibrate"]
