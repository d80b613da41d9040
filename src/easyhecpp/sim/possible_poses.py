"""Which joint poses a simulated cell leaves room for, as the choice of the next one asks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from easyhecpp.explore import CollisionChecker
from easyhecpp.explore.box_check import BoxCheck
from easyhecpp.sim.poses import PoseSampler

F64 = NDArray[np.float64]


@dataclass(frozen=True)
class PossiblePoses:
    """A collision test that knows the table and what stands on it.

    Attributes:
        arm: Knows collisions of links with each other.
        poses: Knows the surroundings.
    """

    arm: CollisionChecker
    poses: PoseSampler

    @classmethod
    def of(cls, poses: PoseSampler) -> PossiblePoses:
        """By the boxes of the links, and the surroundings that the sampler knows."""
        return cls(BoxCheck(poses.rig.robot), poses)

    @property
    def description(self) -> str:
        """What is tested."""
        return f"{self.arm.description} The table and what stands on it are known."

    def collides(self, joints: F64) -> NDArray[np.bool_]:
        """Which of (N, n) collide: (N,)."""
        return np.asarray(self.arm.collides(joints)) | ~self.poses.is_free(joints)
