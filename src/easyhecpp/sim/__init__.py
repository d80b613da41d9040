"""Simulated arms: exact scenes without pictures, and photo-real cells with exact truth."""

from __future__ import annotations

from easyhecpp.sim.cell import Cell, SimView
from easyhecpp.sim.dataset import generate_scenes
from easyhecpp.sim.devices import SimulatedArm, SimulatedCamera
from easyhecpp.sim.options import CellOptions
from easyhecpp.sim.robots import load_robot, robot_names

__all__ = [
    "Cell",
    "CellOptions",
    "SimView",
    "SimulatedArm",
    "SimulatedCamera",
    "generate_scenes",
    "load_robot",
    "robot_names",
]
