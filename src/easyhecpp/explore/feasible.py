"""Which joint poses can be taken a useful picture of."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from easyhecpp.camera import Camera
from easyhecpp.errors import InputError
from easyhecpp.explore.candidates import draw_candidates
from easyhecpp.explore.protocols import CollisionChecker
from easyhecpp.explore.surface import SurfacePoints
from easyhecpp.rig import Rig, rides_on_arm

F64 = NDArray[np.float64]
Bool = NDArray[np.bool_]

_BATCH, _BATCHES = 300, 20

COLLISION = "links would collide"
LOW = "the arm would reach below the floor"
OUT_OF_VIEW = "too little of the arm in the picture"
NEAR = "the arm would come too close to the camera"
SMALL = "the arm would be too small in the picture"
REPEATED = "the arm would stand as in an earlier view"


@dataclass(frozen=True)
class Limits:
    """What a joint pose must satisfy besides the joint limits.

    Attributes:
        min_in_view: Least share of the arm's surface inside the picture; None for 0.7, or for 0.15
            when the camera rides on the arm and sees the foot of it.
        min_size_px: Least root of the area of the box round the arm, as a share of the root of
            the picture's area.
        min_distance: Least distance of the arm from a camera that stands beside it, as a share of
            the reach.
        min_change: Least movement of the arm's surface, root mean square, against earlier views,
            as a share of the reach.
        floor: Lowest height that links which move may reach, metres in the base frame; None for
            no floor.
    """

    min_in_view: float | None = None
    min_size_px: float = 0.12
    min_distance: float = 0.15
    min_change: float = 0.08
    floor: float | None = None


@dataclass
class Feasible:
    """Tests joint poses and counts what it drops.

    Args:
        rig: Robot and set-up.
        camera: Intrinsics.
        T_mount_cam: ``(4, 4)`` present estimate.
        checker: Knows collisions.
        limits: What is demanded.
        earlier: ``(k, n)`` joint poses of earlier views.
    """

    rig: Rig
    camera: Camera
    T_mount_cam: F64
    checker: CollisionChecker
    limits: Limits
    earlier: F64
    rejected: Counter[str] = field(default_factory=Counter)

    def draw(self, count: int, rng: np.random.Generator) -> F64:
        """Joint poses ``(count, n)``, or fewer where good ones are rare.

        Raises:
            InputError: None was found.
        """
        found: list[F64] = []
        for _ in range(_BATCHES):
            found.extend(self.keep(draw_candidates(self.rig.robot, _BATCH, rng)))
            if len(found) >= count:
                break
        if not found:
            raise self._none_found()
        return np.stack(found[:count])

    def keep(self, joints: F64) -> F64:
        """Those of the poses ``(N, n)`` that pass; the others are counted."""
        surface = SurfacePoints.of(self.rig.robot)
        points = surface.placed(self.rig.Ts_cam_link(self.T_mount_cam, joints))
        beside = not rides_on_arm(self.rig.setup)
        least = self.limits.min_in_view
        least = (0.7 if beside else 0.15) if least is None else least
        keep = np.ones(len(joints), bool)
        keep &= self._count(keep, surface.share_in_view(self.camera, points) < least, OUT_OF_VIEW)
        if beside:
            nearest = np.linalg.norm(points, axis=-1).min(axis=-1)
            near = self.limits.min_distance * self.rig.robot.reach
            keep &= self._count(keep, nearest < near, NEAR)
        keep &= self._count(keep, self._size(points) < self.limits.min_size_px, SMALL)
        joints = joints[keep]
        keep = np.ones(len(joints), bool)
        if self.limits.floor is not None:
            keep &= self._count(keep, self._lowest(joints) < self.limits.floor, LOW)
        keep &= self._count(keep, self._change(joints) < self.limits.min_change, REPEATED)
        joints = joints[keep]
        if len(joints) == 0:
            return joints
        hits = self.checker.collides(joints)
        self._count(np.ones(len(joints), bool), hits, COLLISION)
        return joints[~hits]

    def _count(self, among: Bool, bad: Bool, reason: str) -> Bool:
        """Count the bad ones among those that passed so far; returns who passes."""
        dropped = int((among & bad).sum())
        if dropped:
            self.rejected[reason] += dropped
        return ~bad

    def _size(self, points_cam: F64) -> F64:
        """``(N,)`` root of the area of the box round the arm, as a share of the picture's."""
        px = self.camera.project(points_cam)
        corner = np.array([self.camera.width, self.camera.height], np.float64)
        px = np.clip(np.nan_to_num(px, nan=0.0), 0.0, corner)
        sides = px.max(axis=1) - px.min(axis=1)
        return np.sqrt(sides.prod(axis=-1) / corner.prod())

    def _lowest(self, joints: F64) -> F64:
        """``(N,)`` lowest point of the links that move, metres in the base."""
        surface, robot = SurfacePoints.of(self.rig.robot), self.rig.robot
        moves = _moving_links(robot.link_poses(draw_candidates(robot, 8, np.random.default_rng(0))))
        z = surface.placed(robot.link_poses(joints))[..., 2]
        z = z.reshape(len(joints), len(moves), -1)[:, moves]
        return z.reshape(len(joints), -1).min(axis=-1)

    def _change(self, joints: F64) -> F64:
        """``(N,)`` root mean square movement against the nearest earlier view, by the reach."""
        if len(self.earlier) == 0:
            return np.full(len(joints), np.inf)
        surface, robot = SurfacePoints.of(self.rig.robot), self.rig.robot
        now = surface.placed(self.rig.Ts_mount_link(joints))
        before = surface.placed(self.rig.Ts_mount_link(self.earlier))
        square = np.stack([np.sum((now - b) ** 2, axis=-1).mean(axis=-1) for b in before])
        return np.sqrt(square.min(axis=0)) / robot.reach

    def _none_found(self) -> InputError:
        why = ", ".join(f"{n} times {reason}" for reason, n in self.rejected.most_common())
        return InputError(
            f"No joint pose suits: of {_BATCH * _BATCHES} drawn within the joint limits, {why}",
            where=f"robot {self.rig.robot.name}",
            expected="a camera that sees most of the arm",
            fix="Check the camera's pose and intrinsics, or lower the share that must be in view",
        )


def _moving_links(Ts_base_link: F64) -> Bool:
    return np.ptp(Ts_base_link, axis=0).max(axis=(-1, -2)) > 1e-6
