"""URDF to an immutable robot: joints, batched forward kinematics, link meshes."""

from __future__ import annotations

from easyhecpp.robot.describe import RobotSummary, describe
from easyhecpp.robot.link_mesh import LinkMesh
from easyhecpp.robot.robot import Robot

__all__ = ["LinkMesh", "Robot", "RobotSummary", "describe"]
