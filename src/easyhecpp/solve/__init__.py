"""Pose optimisation on silhouettes, with covariance."""

from easyhecpp.solve.optimise import solve_pose
from easyhecpp.solve.types import ContourFit, Observation, PoseEstimate, SolveConfig, ViewFit

__all__ = ["ContourFit", "Observation", "PoseEstimate", "SolveConfig", "ViewFit", "solve_pose"]
