"""Random simulated scenes: an arm in several poses, a camera, and exact masks.

The masks come from the reference renderer, never from the fast kernel that calibration uses, and
from an odd supersampling factor, so that thresholding at one half has no ties to lose.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from easyhecpp._parallel import parallel_map
from easyhecpp.camera import Camera
from easyhecpp.errors import InputError
from easyhecpp.geometry import exp_so3, inverse, look_at, make_transform
from easyhecpp.render.reference import reference_visible_links
from easyhecpp.render.reference_compiled import reference_coverage_compiled
from easyhecpp.robot import Robot
from easyhecpp.sim.arm_surface import ArmSurface

F64 = NDArray[np.float64]

DISTANCE_IN_REACHES = (1.0 / 1.0711, 1.6 / 1.0711)
"""Default range of camera distances over the robot's reach: 1.0 to 1.6 m for the xArm7."""

_CAMERA_TRIES, _POSE_TRIES = 50, 100


@dataclass(frozen=True, eq=False)
class SimScene:
    """One fixed camera and several views of an arm, with the truth.

    Attributes:
        robot: the arm, n joints and L links with geometry.
        camera: the intrinsics.
        T_base_cam: (4, 4) the true pose of the camera.
        joints: (N, n) joint values of the views.
        supersample: samples per pixel and direction of the truth masks; odd.
    """

    robot: Robot
    camera: Camera
    T_base_cam: F64
    joints: F64
    supersample: int = 5
    _coverages: dict[int, NDArray[np.float32]] = field(default_factory=dict, repr=False)

    def __len__(self) -> int:
        return len(self.joints)

    @cached_property
    def Ts_cam_link(self) -> F64:
        """(N, L, 4, 4) poses of the links in the camera's frame."""
        return inverse(self.T_base_cam) @ self.robot.link_poses(self.joints)

    def coverage(self, view: int) -> NDArray[np.float32]:
        """(H, W) share of every pixel that the arm covers; computed at the first call."""
        if view not in self._coverages:
            self._coverages[view] = reference_coverage_compiled(
                self.robot.meshes, self.camera, self.Ts_cam_link[view], self.supersample
            )
        return self._coverages[view]

    @property
    def coverages(self) -> NDArray[np.float32]:
        """(N, H, W) coverage of all views."""
        return np.stack(parallel_map(self.coverage, range(len(self))))

    @property
    def masks(self) -> NDArray[np.bool_]:
        """(N, H, W) pixels of which the arm covers more than half."""
        return self.coverages > 0.5

    def visible_links(self, view: int) -> NDArray[np.int16]:
        """(H, W) index of the nearest link at each pixel's centre, -1 for none."""
        links, _ = reference_visible_links(self.robot.meshes, self.camera, self.Ts_cam_link[view])
        return links

    @cached_property
    def shares_in_view(self) -> F64:
        """(N,) share of the arm's surface, by area, that projects into the picture."""
        surface = ArmSurface.of(self.robot)
        return surface.share_in_view(self.camera, self.T_base_cam, self.joints)


def random_scene(
    robot: Robot,
    rng: np.random.Generator,
    *,
    n_views: int = 5,
    width: int = 1280,
    height: int = 720,
    focal: float = 900.0,
    min_visible: float = 0.7,
    distance: tuple[float, float] | None = None,
    elevation_deg: tuple[float, float] = (-10.0, 70.0),
    roll_deg: float = 15.0,
    supersample: int = 5,
) -> SimScene:
    """Draw a scene.

    The camera lies anywhere on the part of the sphere around the arm's mean middle that
    `elevation_deg` names, evenly by area, and looks at a point near that middle (a tenth of the
    reach off, standard deviation per axis). Joints are drawn evenly within their limits (turning
    joints within one turn). A pose is drawn again when too little of the arm is in view, when it
    comes nearer to the camera than a tenth of its reach, or when links are inside each other: more
    than 2 % of one's surface within the other's bounding box shrunk to 80 %, unless that is so in
    the neutral pose or in a fifth of all poses, as for neighbours.

    Args:
        robot: any arm.
        rng: all randomness comes from here.
        n_views: number of poses of the arm.
        width: of the picture, pixels.
        height: of the picture, pixels.
        focal: focal length, pixels.
        min_visible: least share of the arm's surface (hidden parts count too) inside the picture.
        distance: nearest and farthest camera, metres; by default in proportion to the reach.
        elevation_deg: lowest and highest camera; negative is below the arm's middle, looking up.
        roll_deg: the camera is rolled evenly between plus and minus this.
        supersample: of the truth masks; odd.

    Raises:
        InputError: no camera of that kind sees enough of the arm.
    """
    near, far = distance or tuple(np.array(DISTANCE_IN_REACHES) * robot.reach)
    camera = Camera(width, height, focal, focal, (width - 1) / 2.0, (height - 1) / 2.0)
    surface = ArmSurface.of(robot)
    middle = robot.centre(surface.draw_poses(64, rng)).mean(axis=0)
    for _ in range(_CAMERA_TRIES):
        T_base_cam = _draw_camera(
            rng, middle, 0.1 * robot.reach, (near, far), elevation_deg, roll_deg
        )
        joints = _draw_views(surface, camera, T_base_cam, rng, n_views, min_visible)
        if joints is not None:
            return SimScene(robot, camera, T_base_cam, joints, supersample)
    raise InputError(
        f"no camera {near:.2f} to {far:.2f} m from {robot.name} was found that sees "
        f"{min_visible:.0%} of it in {n_views} poses",
        expected="a camera far enough and a focal length short enough for most of the arm",
        fix="allow larger distances, a shorter focal length or a smaller share in view",
    )


def _draw_camera(
    rng: np.random.Generator,
    middle: F64,
    noise: float,
    distance: tuple[float, float],
    elevation_deg: tuple[float, float],
    roll_deg: float,
) -> F64:
    low, high = np.sin(np.deg2rad(elevation_deg))
    elevation = np.arcsin(rng.uniform(low, high))
    azimuth = rng.uniform(-np.pi, np.pi)
    direction = np.array(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ]
    )
    eye = middle + rng.uniform(*distance) * direction
    target = middle + rng.normal(0.0, noise, 3)
    roll = np.deg2rad(rng.uniform(-roll_deg, roll_deg))
    T_cam_rolled = make_transform(exp_so3(np.array([0.0, 0.0, roll])), np.zeros(3))
    return look_at(eye, target) @ T_cam_rolled


def _draw_views(
    surface: ArmSurface,
    camera: Camera,
    T_base_cam: F64,
    rng: np.random.Generator,
    n_views: int,
    min_visible: float,
) -> F64 | None:
    """Poses (n_views, n) that this camera sees well enough, or None when they are too rare."""
    poses = surface.draw_poses(_POSE_TRIES, rng)
    poses = poses[surface.share_in_view(camera, T_base_cam, poses) >= min_visible]
    poses = poses[surface.nearest(T_base_cam, poses) > 0.1 * surface.robot.reach]
    good = [pose for pose in poses if not surface.collides(pose)]
    return np.array(good[:n_views]) if len(good) >= n_views else None
