"""Joint poses to begin with, before anything is known of the camera.

A joint pose is scored by the error that is to be expected with it (and the ones chosen before it)
for cameras all around the arm, at distances that cameras are put at, by the same prediction that
`choose` makes. The mean over cameras is what a user can expect who has not told where the camera
is. Poses in which links hide each other tell little, and so do not come out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from easyhecpp.camera import Camera
from easyhecpp.errors import InputError
from easyhecpp.explore.box_check import BoxCheck
from easyhecpp.explore.candidates import draw_candidates
from easyhecpp.explore.floor import Floor, floor_height, lowest_points
from easyhecpp.explore.information import ViewPredictor
from easyhecpp.explore.protocols import CollisionChecker
from easyhecpp.geometry import adjoint, inverse, look_at, transform_points, translation_matrix
from easyhecpp.rig import Rig
from easyhecpp.robot import Robot

F64 = NDArray[np.float64]

ELEVATIONS_DEG = (-10.0, 70.0)
DISTANCES_IN_REACHES = (0.93, 1.5)
"""Where the camera may be: seen from the arm's middle; 1.0 to 1.6 m for the xArm 7."""

_CAMERAS, _FEW = 24, 6
_BATCHES = 10
_CANDIDATES, _SHORTLIST, _KEPT = 240, 24, 4
_POLISH, _SPREADS = 16, (0.08, 0.03)
_WORST_M = 0.05
"""An error this large is as good as none at all; keeps cameras that see nothing from deciding."""


def first_joint_poses(
    robot: Robot,
    camera: Camera,
    count: int,
    rng: np.random.Generator,
    *,
    checker: CollisionChecker | None = None,
    floor: Floor = "foot",
) -> F64:
    """Joint poses that tell much, wherever the camera stands.

    Args:
        robot: Any arm.
        camera: Intrinsics.
        count: How many; each is chosen as if the ones before had been taken.
        rng: Draws candidates.
        checker: Knows collisions; by default a rough test by the links' bounding boxes.
        floor: What the arm stays above, see `Limits.floor`.

    Returns:
        ``(count, n)``, the best first.

    Raises:
        InputError: Joint limits that mean nothing, or every joint pose drawn is forbidden.
    """
    free = _Free(robot, checker or BoxCheck(robot), floor_height(robot, floor))
    drawn = free.draw(_CANDIDATES, rng)
    everywhere = _Everywhere.of(robot, camera)
    chosen: list[F64] = []
    for _ in range(count):
        best = _best(free, everywhere, drawn, rng)
        chosen.append(best)
        everywhere = everywhere.with_view(best)
    return np.stack(chosen)


@dataclass(frozen=True)
class _Free:
    """Joint poses that may be driven to."""

    robot: Robot
    checker: CollisionChecker
    floor_z: float

    def keep(self, joints: F64) -> F64:
        """Those of ``(N, n)`` that neither collide nor reach below the floor."""
        joints = joints[lowest_points(self.robot, joints) >= self.floor_z]
        return joints[~self.checker.collides(joints)] if len(joints) else joints

    def draw(self, count: int, rng: np.random.Generator) -> F64:
        """Up to ``count`` joint poses."""
        found = np.zeros((0, self.robot.n_joints))
        for _ in range(_BATCHES):
            found = np.concatenate([found, self.keep(draw_candidates(self.robot, count, rng))])
            if len(found) >= count:
                return found[:count]
        if len(found) == 0:
            raise InputError(
                f"All of {_BATCHES * count} joint poses drawn within the limits collide, or reach "
                f"below {self.floor_z:.3f} m",
                where=f"robot {self.robot.name}",
                expected="an arm with room to move above its foot",
                fix="Check the meshes and limits of the URDF, or name a lower floor",
            )
        return found


def _best(free: _Free, everywhere: _Everywhere, drawn: F64, rng: np.random.Generator) -> F64:
    # A few cameras tell which are worth a second look.
    few = everywhere.errors(drawn, _FEW)
    best = drawn[np.argsort(few, kind="stable")[:_SHORTLIST]]
    errors = everywhere.errors(best)
    for spread in _SPREADS:
        order = np.argsort(errors, kind="stable")[:_KEPT]
        best, errors = best[order], errors[order]
        near = free.keep(draw_candidates(free.robot, _POLISH, rng, around=best, spread=spread))
        if len(near):
            best = np.concatenate([best, near])
            errors = np.concatenate([errors, everywhere.errors(near)])
    return best[int(np.argmin(errors))]


@dataclass(frozen=True, eq=False)
class _Everywhere:
    """Cameras all around the arm, and what is known for each of them.

    Attributes:
        predictor: Of the information of views.
        Ts_base_cam: ``(K, 4, 4)``; any first few of them are all around, too.
        centre: ``(3,)`` middle of the arm over its poses, base frame.
        known: ``(K, 7, 7)`` information so far.
    """

    predictor: ViewPredictor
    Ts_base_cam: F64
    centre: F64
    known: F64

    @classmethod
    def of(cls, robot: Robot, camera: Camera) -> _Everywhere:
        """Cameras that look at the middle of the arm."""
        predictor = ViewPredictor(Rig(robot), camera)
        poses = draw_candidates(robot, 64, np.random.default_rng(0))
        centre = robot.centre(poses).mean(axis=0)
        i = np.arange(_CAMERAS)
        # Steps of the golden section: evenly spread however many are taken.
        azimuth = 2.0 * np.pi * ((i * 0.6180339887) % 1.0)
        low, high = np.sin(np.deg2rad(ELEVATIONS_DEG))
        z = low + (high - low) * ((0.5 + i * 0.7548776662) % 1.0)
        near, far = np.array(DISTANCES_IN_REACHES) * robot.reach
        distance = near + (far - near) * ((0.5 + i * 0.5698402910) % 1.0)
        r = np.sqrt(1.0 - z**2)
        direction = np.stack([r * np.cos(azimuth), r * np.sin(azimuth), z], axis=-1)
        prior = np.diag([1.0] * 6 + [1.0 / predictor.noise.dilation_prior_px**2])
        return cls(
            predictor,
            look_at(centre + distance[:, None] * direction, centre),
            centre,
            np.repeat(prior[None], _CAMERAS, axis=0),
        )

    def errors(self, joints: F64, n_cameras: int | None = None) -> F64:
        """Expected error ``(N,)`` of the camera's position with each view, metres."""
        Ts = self.Ts_base_cam[:n_cameras]
        added = self.predictor.information(Ts, joints, self.centre)
        J = -adjoint(translation_matrix(transform_points(inverse(Ts), self.centre)))
        P = J @ np.linalg.inv(self.known[:n_cameras] + added)[..., :6, :6] @ np.swapaxes(J, -1, -2)
        sigma = np.sqrt(np.trace(P[..., :3, :3], axis1=-2, axis2=-1))
        return np.minimum(sigma, _WORST_M).mean(axis=1)

    def with_view(self, joints: F64) -> _Everywhere:
        """As if the view ``(n,)`` had been taken."""
        added = self.predictor.information(self.Ts_base_cam, joints[None], self.centre)[0]
        return _Everywhere(self.predictor, self.Ts_base_cam, self.centre, self.known + added)
