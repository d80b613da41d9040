"""A second arm in the cell that has nothing to do with the calibration."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from easyhecpp.geometry import transform_points
from easyhecpp.robot import Robot
from easyhecpp.sim.arm_surface import ArmSurface
from easyhecpp.sim.clutter import Prop, upright
from easyhecpp.sim.finishes import ArmLook, random_look
from easyhecpp.sim.materials import plastic
from easyhecpp.sim.poses import gap_between
from easyhecpp.sim.shapes import box, moved

F64 = NDArray[np.float64]

_TRIES = 40


@dataclass(frozen=True, eq=False)
class Distractor:
    """A second arm.

    Attributes:
        robot: its model.
        look: its finishes.
        T_base_other: (4, 4) its base in the base frame of the arm that matters.
        moves: it takes another pose in every view.
        seed: of its poses.
        foot: the pedestal under it.
    """

    robot: Robot
    look: ArmLook
    T_base_other: F64
    moves: bool
    seed: int
    foot: Prop

    def joints(self, view: int, arm_points: F64) -> F64:
        """Its pose (m,) in a view.

        Args:
            view: index of the view; the same index and arm give the same pose.
            arm_points: (N, 3) surface points of the arm that matters; it keeps away from them.
        """
        rng = np.random.default_rng([self.seed, view if self.moves else 0])
        surface = ArmSurface.of(self.robot)
        floor = float(surface.in_base(self.robot.neutral)[:, 2].min()) - 1e-3
        best, widest = self.robot.neutral, -1.0
        for pose in surface.draw_poses(_TRIES, rng):
            points = surface.in_base(pose)
            if points[:, 2].min() < floor or surface.collides(pose):
                continue
            gap = gap_between(transform_points(self.T_base_other, points), arm_points)
            if gap > 0.04:
                return pose
            if gap > widest:
                best, widest = pose, gap
        return best

    def link_poses(self, joints: F64) -> F64:
        """(L, 4, 4) poses of its links in the base frame of the arm that matters."""
        return self.T_base_other @ self.robot.link_poses(joints)


def random_distractor(
    rng: np.random.Generator,
    robot: Robot,
    other: Robot,
    *,
    stand_z: float,
    floor_z: float,
    camera_azimuth: float,
    moves: bool,
) -> Distractor:
    """Put another arm beyond the first, seen from the camera, on a pedestal of its own.

    Args:
        rng: source of randomness.
        robot: the arm that matters.
        other: the second one.
        stand_z: height that the first stands at.
        floor_z: height of the floor.
        camera_azimuth: direction from the base towards the camera, radians.
        moves: whether it takes another pose in every view.
    """
    azimuth = camera_azimuth + np.pi + rng.uniform(-0.8, 0.8)
    distance = rng.uniform(0.5, 0.75) * (robot.reach + other.reach)
    lowest = float(ArmSurface.of(other).in_base(other.neutral)[:, 2].min())
    x, y = distance * np.cos(azimuth), distance * np.sin(azimuth)
    stand = max(stand_z, floor_z + 0.3)
    T = upright(x, y, stand - lowest, rng.uniform(0, 2 * np.pi))
    tall = stand - floor_z
    side = 0.25 + 0.2 * other.reach
    surface = moved(box((side, side, tall)), upright(x, y, floor_z + tall / 2, azimuth))
    foot = Prop("pedestal", surface, plastic((0.35, 0.36, 0.38), 0.5))
    look = random_look(rng, other.reach)
    return Distractor(other, look, T, moves, int(rng.integers(2**31)), foot)


def alike(distractor: Distractor, look: ArmLook) -> Distractor:
    """The same second arm with the finishes of the first: the hard case."""
    return replace(distractor, look=look)
