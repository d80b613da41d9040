"""Joint poses that make sense in a cell: in view, not in the table, not through things."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from easyhecpp.camera import Camera
from easyhecpp.errors import NothingSuitsError
from easyhecpp.geometry import inverse, transform_points
from easyhecpp.render import SilhouetteRenderer
from easyhecpp.rig import Rig, rides_on_arm
from easyhecpp.sim.arm_surface import ArmSurface

F64 = NDArray[np.float64]
Box = tuple[F64, F64]

_BATCH, _BATCHES = 200, 60
_GAP = 0.01
_MOST = 0.7


@dataclass(frozen=True, eq=False)
class PoseSampler:
    """Draws poses of the arm.

    Attributes:
        rig: the arm and where the camera is fixed.
        camera: the intrinsics.
        T_mount_cam: (4, 4).
        floor_z: height of the surface that the base stands on; moving links stay above it.
        obstacles: (low, high) corners of boxes in the base frame that the arm stays out of.
        min_visible: least share of the surface inside the picture, of the links that move as
            seen from the camera's mount.
    """

    rig: Rig
    camera: Camera
    T_mount_cam: F64
    floor_z: float
    obstacles: Sequence[Box]
    min_visible: float

    def draw(self, count: int, rng: np.random.Generator) -> F64:
        """Poses (count, n) with joints drawn evenly within their limits.

        Raises:
            NothingSuitsError: such poses are too rare, for instance because the camera looks
                elsewhere.
        """
        surface = ArmSurface.of(self.rig.robot)
        good: list[F64] = []
        for _ in range(_BATCHES):
            poses = surface.draw_poses(_BATCH, rng)
            poses = poses[self._seen_enough(surface, poses)]
            poses = poses[self.is_free(poses)]
            for pose in poses:
                if not surface.collides(pose) and not self._is_blocked(pose):
                    good.append(pose)
                if len(good) == count:
                    return np.array(good)
        raise NothingSuitsError(
            f"Only {len(good)} of {_BATCH * _BATCHES} random poses of {self.rig.robot.name} are "
            f"seen by the camera and free of collisions; {count} were wanted",
            expected="a camera that looks at the arm",
            fix="Draw another cell, or give the joint poses yourself.",
        )

    def is_free(self, poses: F64) -> NDArray[np.bool_]:
        """Which of the poses (N, n) keep what moves above the floor and out of the obstacles."""
        surface = ArmSurface.of(self.rig.robot)
        points = surface.in_base(poses)[:, surface.moves]
        free = np.asarray((points[..., 2] > self.floor_z + _GAP).all(axis=-1))
        for low, high in self.obstacles:
            inside = ((points > low - _GAP) & (points < high + _GAP)).all(axis=-1)
            free &= ~inside.any(axis=-1)
        return free

    def _seen_enough(self, surface: ArmSurface, poses: F64) -> NDArray[np.bool_]:
        T_base_mount = self.rig.robot.frame_pose(poses, self.rig.mount)
        in_mount = transform_points(inverse(T_base_mount), surface.in_base(poses))
        moves = np.ptp(in_mount, axis=0).max(axis=-1) > 1e-6
        points = transform_points(inverse(self.T_mount_cam), in_mount[:, moves])
        px = self.camera.project(points)
        size = np.array([self.camera.width, self.camera.height])
        with np.errstate(invalid="ignore"):  # behind the camera: not a number
            inside = ((px > -0.5) & (px < size - 0.5)).all(axis=-1)
        share = inside @ surface.weights[moves] / surface.weights[moves].sum()
        # A camera on the wrist is always next to the link before the last.
        least = 0.015 if rides_on_arm(self.rig.setup) else 0.1 * self.rig.robot.reach
        clear = np.linalg.norm(points, axis=-1).min(axis=-1) > least
        return (share >= self.min_visible) & clear

    def _is_blocked(self, pose: F64) -> bool:
        """Whether the arm fills most of the picture, as when the camera is inside of it."""
        Ts_cam_link = self.rig.Ts_cam_link(self.T_mount_cam, pose)
        return bool((self._small.visible_links(Ts_cam_link) >= 0).mean() > _MOST)

    @cached_property
    def _small(self) -> SilhouetteRenderer:
        small = self.camera.scaled(64 / self.camera.width)
        return SilhouetteRenderer(self.rig.robot.meshes, small)


def gap_between(first: F64, second: F64) -> float:
    """Least distance between two clouds of surface points (N, 3), (M, 3), metres."""
    return float(KDTree(first).query(second)[0].min())
