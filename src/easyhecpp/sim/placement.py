"""Where the camera of a simulated cell is: on a tripod beside the arm, or on its wrist."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from easyhecpp.camera import Camera
from easyhecpp.geometry import (
    exp_so3,
    inverse,
    log_so3,
    look_at,
    make_transform,
    transform_points,
)
from easyhecpp.robot import Robot
from easyhecpp.sim.arm_surface import ArmSurface
from easyhecpp.sim.room import REFERENCE_REACH

F64 = NDArray[np.float64]

# A RealSense D435 at 1280 x 720, the camera of the published experiments.
_FOCAL, _OFF_CENTRE = 906.8 / 1280, (10.7, 8.2)


def random_camera(
    rng: np.random.Generator, width: int, height: int, distortion: tuple[float, ...] = ()
) -> Camera:
    """Intrinsics of a common depth camera, its principal point some pixels off the middle."""
    focal = width * _FOCAL * rng.uniform(0.97, 1.03)
    aside = rng.normal(0.0, _OFF_CENTRE, 2) * width / 1280
    return Camera(
        width,
        height,
        float(focal),
        float(focal),
        float((width - 1) / 2 + aside[0]),
        float((height - 1) / 2 + aside[1]),
        "plumb_bob" if distortion else "none",
        distortion,
    )


def front_azimuth(robot: Robot) -> float:
    """Direction in which the arm reaches out in its neutral pose, radians about the base's z."""
    x, y, _ = robot.centre(robot.neutral)
    if np.hypot(x, y) < 0.03 * robot.reach:
        return 0.0
    return float(np.arctan2(y, x))


def tripod_camera(
    rng: np.random.Generator,
    robot: Robot,
    stand_z: float,
    *,
    azimuth_deg: float,
    elevation_deg: tuple[float, float],
    roll_deg: float = 0.0,
    distance: tuple[float, float],
) -> F64:
    """A camera that stands beside the arm and looks at it.

    Args:
        rng: source of randomness.
        robot: the arm.
        stand_z: height that the base stands at; the camera stays above it.
        azimuth_deg: largest angle off the arm's front, either way.
        elevation_deg: lowest and highest, seen from the arm's middle.
        roll_deg: largest turn about the camera's axis, besides a degree or two.
        distance: nearest and farthest for an arm of `REFERENCE_REACH`, metres.

    Returns:
        (4, 4) T_base_cam.
    """
    scale = robot.reach / REFERENCE_REACH
    middle = robot.centre(ArmSurface.of(robot).draw_poses(64, np.random.default_rng(0)))
    target = middle.mean(axis=0) + rng.normal(0.0, 0.05 * scale, 3)
    azimuth = front_azimuth(robot) + np.radians(rng.uniform(-azimuth_deg, azimuth_deg))
    elevation = np.radians(rng.uniform(*elevation_deg))
    flat = np.cos(elevation)
    direction = [flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)]
    eye = target + scale * rng.uniform(*distance) * np.array(direction)
    eye[2] = max(eye[2], stand_z + 0.08)
    roll = np.radians(rng.normal(0.0, 1.5))
    if roll_deg > 0.0:
        roll += np.radians(rng.uniform(-roll_deg, roll_deg))
    return look_at(eye, target) @ make_transform(exp_so3([0.0, 0.0, roll]), np.zeros(3))


def wrist_camera(rng: np.random.Generator, robot: Robot, ee_link: str) -> F64:
    """A camera bracketed to the last link, beside it, looking along it and a little inwards.

    Returns:
        (4, 4) T_ee_cam.
    """
    points, axis = _last_link(robot, ee_link)
    side = np.cross(axis, [1.0, 0.0, 0.0] if abs(axis[0]) < 0.5 else [0.0, 1.0, 0.0])
    side = exp_so3(axis * rng.uniform(0, 2 * np.pi)) @ (side / np.linalg.norm(side))
    middle = points.mean(axis=0)
    width = float(np.percentile(np.abs((points - middle) @ side), 95))
    eye = middle + side * (width + rng.uniform(0.03, 0.07))
    inwards = np.radians(rng.uniform(0.0, 15.0))
    ahead = axis * np.cos(inwards) - side * np.sin(inwards)
    return look_at(eye, eye + ahead, up=side)


def _last_link(robot: Robot, ee_link: str) -> tuple[F64, F64]:
    """Surface points (N, 3) beyond the last joint, and that joint's unit axis (3,), ee frame.

    The axis points away from the rest of the arm: the way a tool would look.
    """
    step = 0.3
    q = robot.neutral
    T_ee_base = inverse(robot.frame_pose(q, ee_link))
    turned = q + step * np.eye(robot.n_joints)
    turns = log_so3(T_ee_base[:3, :3] @ robot.frame_pose(turned, ee_link)[:, :3, :3])
    surface = ArmSurface.of(robot)
    moved = np.abs(surface.in_base(turned) - surface.in_base(q)).max(axis=-1) > 1e-9
    turning = np.linalg.norm(turns, axis=1) > 0.5 * step
    # Of the joints that turn the ee link, the last one moves the least of the arm.
    last = int(np.argmin(np.where(turning, moved.sum(axis=1), np.inf)))
    axis = turns[last] / np.linalg.norm(turns[last])
    points = transform_points(T_ee_base, surface.in_base(q))
    own, rest = points[moved[last]], points[~moved[last]]
    middle = own.mean(axis=0)
    nearest = rest[np.argsort(np.linalg.norm(rest - middle, axis=1))[:40]]
    return own, axis * (np.sign(axis @ (middle - nearest.mean(axis=0))) or 1.0)
