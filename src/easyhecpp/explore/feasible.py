"""Which joint poses can be taken a useful picture of."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from easyhecpp._parallel import parallel_map
from easyhecpp.camera import Camera
from easyhecpp.errors import InputError, NothingSuitsError
from easyhecpp.explore.candidates import draw_candidates
from easyhecpp.explore.floor import Floor, floor_height, lowest_points
from easyhecpp.explore.protocols import CollisionChecker
from easyhecpp.explore.surface import SurfacePoints
from easyhecpp.render import SilhouetteRenderer
from easyhecpp.rig import Rig, rides_on_arm

F64 = NDArray[np.float64]
Bool = NDArray[np.bool_]

_BATCH, _BATCHES = 300, 20
_SIMPLIFIED, _SEEN_WIDTH_PX = 0.012, 80

COLLISION = "links would collide"
LOW = "the arm would reach below its foot or the floor"
OUT_OF_VIEW = "too little of the arm in the picture"
NEAR = "the arm would come too close to the camera"
SMALL = "the arm would be too small in the picture"
HIDDEN = "its links would hide each other"
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
            the reach. Near arms tell most by the numbers, but make bad masks.
        min_seen: Least area of the arm's silhouette as a share of the sum of its links' own, for a
            camera beside it.
        min_change: Least movement of the arm's surface, root mean square, against earlier views,
            as a share of the reach.
        floor: Lowest height that links which move may reach, metres in the base frame; ``foot``
            for that of the links which do not move, None for no floor.
    """

    min_in_view: float | None = None
    min_size_px: float = 0.12
    min_distance: float = 0.4
    min_seen: float = 0.6
    min_change: float = 0.08
    floor: Floor = "foot"

    def __post_init__(self) -> None:
        if isinstance(self.floor, float) and not np.isfinite(self.floor):
            raise InputError(
                f"The floor is {self.floor}",
                where="floor",
                expected="a height in metres, 'foot', or none",
            )


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
            NothingSuitsError: None was found.
        """
        found: list[F64] = []
        for _ in range(_BATCHES):
            drawn = draw_candidates(self.rig.robot, _BATCH, rng, hold=self._hold)
            found.extend(self.keep(drawn))
            if len(found) >= count:
                break
        if not found:
            raise self._none_found()
        return np.stack(found[:count])

    def draw_near(self, around: F64, spread: float, count: int, rng: np.random.Generator) -> F64:
        """Up to ``count`` joint poses near those of ``around`` ``(k, n)``; may be none."""
        robot, hold = self.rig.robot, self._hold
        return self.keep(
            draw_candidates(robot, count, rng, around=around, spread=spread, hold=hold)
        )

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
        lowest = lowest_points(self.rig.robot, joints)
        keep &= self._count(keep, lowest < floor_height(self.rig.robot, self.limits.floor), LOW)
        keep &= self._count(keep, self._change(joints) < self.limits.min_change, REPEATED)
        joints = joints[keep]
        if len(joints) == 0:
            return joints
        keep = self._count(np.ones(len(joints), bool), self.checker.collides(joints), COLLISION)
        joints = joints[keep]
        if beside and len(joints):
            hidden = self._seen(joints) < self.limits.min_seen
            joints = joints[self._count(np.ones(len(joints), bool), hidden, HIDDEN)]
        return joints

    @property
    def _hold(self) -> F64 | None:
        return self.earlier[-1] if len(self.earlier) else None

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

    def _seen(self, joints: F64) -> F64:
        """``(N,)`` area of the silhouette as a share of the sum of the links' own."""
        robot = self.rig.robot.simplified(_SIMPLIFIED * self.rig.robot.reach)
        reduction = max(1.0, max(self.camera.width, self.camera.height) / _SEEN_WIDTH_PX)
        renderer = SilhouetteRenderer(robot.meshes, self.camera.scaled(1.0 / reduction))

        def seen(Ts_cam_link: F64) -> float:
            alone = renderer.link_coverage(Ts_cam_link)
            return float(alone.max(axis=0).sum() / max(float(alone.sum()), 1e-9))

        return np.array(parallel_map(seen, self.rig.Ts_cam_link(self.T_mount_cam, joints)))

    def _change(self, joints: F64) -> F64:
        """``(N,)`` root mean square movement against the nearest earlier view, by the reach."""
        if len(self.earlier) == 0:
            return np.full(len(joints), np.inf)
        surface, robot = SurfacePoints.of(self.rig.robot), self.rig.robot
        now = surface.placed(self.rig.Ts_mount_link(joints))
        before = surface.placed(self.rig.Ts_mount_link(self.earlier))
        square = np.stack([np.sum((now - b) ** 2, axis=-1).mean(axis=-1) for b in before])
        return np.sqrt(square.min(axis=0)) / robot.reach

    def _none_found(self) -> NothingSuitsError:
        why = ", ".join(f"{n} times {reason}" for reason, n in self.rejected.most_common())
        return NothingSuitsError(
            f"No joint pose suits: of {_BATCH * _BATCHES} drawn within the joint limits, {why}",
            where=f"robot {self.rig.robot.name}",
            expected="a camera that sees most of the arm",
            fix="Check the camera's pose and intrinsics, or lower the share that must be in view",
        )
