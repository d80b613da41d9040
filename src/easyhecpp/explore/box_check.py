"""A rough test for links inside each other that needs nothing but the meshes."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from easyhecpp.explore.candidates import draw_candidates
from easyhecpp.explore.surface import SurfacePoints
from easyhecpp.geometry import inverse, transform_points
from easyhecpp.robot import Robot

F64 = NDArray[np.float64]
Bool = NDArray[np.bool_]

_SHRINK = 0.8
_INSIDE = 0.02
_USUAL = 0.2


class BoxCheck:
    """Finds poses in which a part of one link lies well inside another link's bounding box.

    Boxes are those of the link frames, shrunk to 80 %; 2 % of a link's surface inside one count.
    Pairs that do so in the neutral pose or in a fifth of all poses are neighbours and do not count.
    Narrow misses are not told from touches: this is what can be done without a collision library.

    Args:
        robot: The arm.
    """

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._surface = SurfacePoints.of(robot)

    @property
    def description(self) -> str:
        """What it tests."""
        return (
            "Collisions were judged by the links' bounding boxes only; install "
            '"easyhecpp[plan]" to have them judged by the meshes.'
        )

    def collides(self, joints: F64) -> Bool:
        """Which of the poses ``(N, n)`` have links inside each other that usually are not."""
        joints = np.atleast_2d(joints)
        return np.asarray((self._intrusions(joints) & ~self._usual).any(axis=(1, 2)))

    @cached_property
    def _usual(self) -> Bool:
        poses = draw_candidates(self._robot, 60, np.random.default_rng(0))
        often = self._intrusions(poses).mean(axis=0) > _USUAL
        return np.asarray(often | self._intrusions(self._robot.neutral[None])[0])

    def _intrusions(self, joints: F64) -> Bool:
        """``(N, L, L)``: whether link i's surface reaches into link j's box."""
        Ts = self._robot.link_poses(joints)
        points = self._surface.placed(Ts)
        n_links = Ts.shape[1]
        found = np.zeros((len(joints), n_links, n_links), bool)
        for j, mesh in enumerate(self._robot.meshes):
            low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
            local = transform_points(inverse(Ts[:, j]), points) - (low + high) / 2.0
            inside = (np.abs(local) < _SHRINK * (high - low) / 2.0).all(axis=-1)
            found[:, :, j] = self._surface.share_by_link(inside) > _INSIDE
        found[:, np.arange(n_links), np.arange(n_links)] = False
        return found
