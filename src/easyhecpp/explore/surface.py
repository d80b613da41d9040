"""Points on the arm's surface: what of it is in view, and where."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from easyhecpp.camera import Camera
from easyhecpp.geometry import transform_points
from easyhecpp.robot import Robot

F64 = NDArray[np.float64]
Bool = NDArray[np.bool_]

_POINTS_PER_LINK = 48


@dataclass(frozen=True, eq=False)
class SurfacePoints:
    """The same number of points on every link, spread evenly by area.

    Attributes:
        points: ``(L, P, 3)`` metres, link frames.
        areas: ``(L,)`` share of the arm's surface that each link has.
    """

    points: F64
    areas: F64

    @classmethod
    @lru_cache(maxsize=16)
    def of(cls, robot: Robot) -> SurfacePoints:
        """Always the same points for the same robot."""
        rng = np.random.default_rng(0)
        drawn = [_on_triangles(m.vertices[m.faces], _POINTS_PER_LINK, rng) for m in robot.meshes]
        areas = np.array([mesh.area for mesh in robot.meshes])
        return cls(np.stack(drawn), areas / areas.sum())

    def placed(self, Ts_x_link: F64) -> F64:
        """The points ``(N, L * P, 3)`` in frame x for link poses ``(N, L, 4, 4)``."""
        placed = transform_points(Ts_x_link, self.points)
        return placed.reshape(len(Ts_x_link), self.points.shape[0] * self.points.shape[1], 3)

    def share_by_link(self, marked: Bool) -> F64:
        """``(N, L)`` share of each link's points that are marked, ``(N, L * P)``."""
        return marked.reshape(len(marked), len(self.points), -1).mean(axis=-1)

    def share_in_view(self, camera: Camera, points_cam: F64) -> F64:
        """``(N,)`` share of the arm's surface, hidden parts included, inside the picture."""
        px = camera.project(points_cam)
        with np.errstate(invalid="ignore"):  # not a number behind the camera
            inside = (px > -0.5) & (px < np.array([camera.width, camera.height]) - 0.5)
        return self.share_by_link(np.asarray(inside.all(axis=-1))) @ self.areas


def _on_triangles(corners: F64, count: int, rng: np.random.Generator) -> F64:
    """``(count, 3)`` points spread evenly by area over triangles ``(F, 3, 3)``."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    chosen = rng.choice(len(corners), count, p=areas / areas.sum())
    u, v = np.sqrt(rng.uniform(size=(count, 1))), rng.uniform(size=(count, 1))
    return (1.0 - u) * a[chosen] + u * ((1.0 - v) * b[chosen] + v * c[chosen])
