"""Points on the surface of an arm: what of it is in view, and whether links are in each other."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from easyhecpp.camera import Camera
from easyhecpp.geometry import inverse, transform_points
from easyhecpp.robot import Robot

F64 = NDArray[np.float64]

_SAMPLES = 600


@dataclass(frozen=True, eq=False)
class ArmSurface:
    """Points spread evenly over the surface of an arm.

    Attributes:
        robot: the arm.
        points: (S, 3) in their link's frame.
        links: (S,) index of each point's link.
    """

    robot: Robot
    points: F64
    links: NDArray[np.int64]

    @classmethod
    @lru_cache(maxsize=8)
    def of(cls, robot: Robot) -> ArmSurface:
        """Always the same points for the same robot."""
        rng = np.random.default_rng(0)
        areas = np.array([mesh.area for mesh in robot.meshes])
        counts = np.maximum(20, np.round(_SAMPLES * areas / areas.sum()).astype(int))
        points = [
            sample_surface(mesh.vertices, mesh.faces, count, rng)
            for mesh, count in zip(robot.meshes, counts, strict=True)
        ]
        return cls(robot, np.concatenate(points), np.repeat(np.arange(len(counts)), counts))

    @cached_property
    def weights(self) -> F64:
        """(S,) area that each point stands for, summing to one."""
        areas = np.array([mesh.area for mesh in self.robot.meshes])
        return (areas / np.bincount(self.links) / areas.sum())[self.links]

    @cached_property
    def moves(self) -> NDArray[np.bool_]:
        """(S,) whether a point is on a link that moves in the base frame."""
        points = self.in_base(self.draw_poses(8, np.random.default_rng(0)))
        return np.ptp(points, axis=0).max(axis=-1) > 1e-6

    def draw_poses(self, count: int, rng: np.random.Generator) -> F64:
        """(count, n) joint values within the limits; turning joints within one turn."""
        turns = np.array([kind != "prismatic" for kind in self.robot.joint_types])
        middle = (self.robot.lower + self.robot.upper) / 2.0
        half = (self.robot.upper - self.robot.lower) / 2.0
        half = np.where(turns, np.minimum(half, np.pi), half)
        return rng.uniform(middle - half, middle + half, (count, self.robot.n_joints))

    def share_in_view(self, camera: Camera, T_base_cam: F64, joints: F64) -> F64:
        """(N,) share of the surface, by area, that projects into the picture."""
        points = self._in_camera(T_base_cam, joints)
        px = camera.project(points)
        with np.errstate(invalid="ignore"):  # behind the camera: not a number
            inside = (px > -0.5) & (px < np.array([camera.width, camera.height]) - 0.5)
        return inside.all(axis=-1) @ self.weights

    def nearest(self, T_base_cam: F64, joints: F64) -> F64:
        """(N,) distance from the camera to the nearest point, metres."""
        return np.linalg.norm(self._in_camera(T_base_cam, joints), axis=-1).min(axis=-1)

    def collides(self, joints: F64) -> bool:
        """Whether links are inside each other that usually are not; (n,) joints."""
        return bool((self._intrusions(joints) & ~self._usual_intrusions).any())

    @cached_property
    def _usual_intrusions(self) -> NDArray[np.bool_]:
        poses = self.draw_poses(50, np.random.default_rng(0))
        often = np.mean([self._intrusions(pose) for pose in poses], axis=0) > 0.2
        return often | self._intrusions(self.robot.neutral)

    def _intrusions(self, joints: F64) -> NDArray[np.bool_]:
        """(L, L) whether more than 2 % of link i's surface is inside link j's shrunken box."""
        poses = self.robot.link_poses(joints)
        points = transform_points(poses[self.links], self.points[:, None])[:, 0]
        inside = np.empty((len(poses), len(self.points)), dtype=bool)
        for j, mesh in enumerate(self.robot.meshes):
            low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
            offset = transform_points(inverse(poses[j]), points) - (low + high) / 2.0
            inside[j] = (np.abs(offset) < 0.8 * (high - low) / 2.0).all(axis=-1)
        counts = np.bincount(self.links)
        starts = np.cumsum(counts) - counts
        shares = np.add.reduceat(inside.astype(float), starts, axis=1) / counts
        np.fill_diagonal(shares, 0.0)
        return shares.T > 0.02

    def in_base(self, joints: F64) -> F64:
        """(..., S, 3) the points in the base frame."""
        Ts_base_link = self.robot.link_poses(joints)
        return transform_points(Ts_base_link[..., self.links, :, :], self.points[:, None])[
            ..., 0, :
        ]

    def _in_camera(self, T_base_cam: F64, joints: F64) -> F64:
        Ts_cam_link = inverse(T_base_cam) @ self.robot.link_poses(joints)
        return transform_points(Ts_cam_link[:, self.links], self.points[:, None])[..., 0, :]


def sample_surface(
    vertices: F64, faces: NDArray[np.integer], count: int, rng: np.random.Generator
) -> F64:
    """(count, 3) points spread evenly by area over a triangle mesh."""
    corners = vertices[faces]
    areas = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    chosen = corners[rng.choice(len(faces), count, p=areas / areas.sum())]
    u, v = rng.uniform(size=(2, count, 1))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    return chosen[:, 0] + u * (chosen[:, 1] - chosen[:, 0]) + v * (chosen[:, 2] - chosen[:, 0])
