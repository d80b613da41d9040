"""Seeds of the first pose: camera positions all round the arm."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from easyhecpp.initialise.seeds import sphere_seeds
from easyhecpp.segment.scene import Scene

F64 = NDArray[np.float64]

_STEP_DEG = 15.0
"""Between seeds, and between turns about the camera's axis."""


@dataclass(frozen=True)
class SeedGrid:
    """Camera positions round the middle of the arm.

    Attributes:
        elevations_deg: Above the horizontal; negative ones look up from below.
        turned: Whether the camera may be turned about its own axis by any angle; otherwise it
            stands upright, the mount's z axis up in the image.
        distances: In units of the distance from which the arm just fills the image.
        size_px: Longer side of the images that seeds are compared in.
        max_pairs: Pairs of views that every seed is laid over.
    """

    elevations_deg: tuple[float, ...]
    turned: bool = False
    distances: tuple[float, ...] = (0.55, 0.75, 1.0, 1.35, 1.8, 2.5)
    size_px: int = 80
    max_pairs: int = 12

    @property
    def turns(self) -> F64:
        """Angles about the camera's axis that every seed is tried at, radians."""
        count = round(360.0 / _STEP_DEG) if self.turned else 1
        return np.arange(count) * np.deg2rad(_STEP_DEG)

    def poses(self, scene: Scene) -> F64:
        """All seeds upright, ``(S, 4, 4)`` T_mount_cam."""
        camera = scene.camera
        half = min(0.5 * camera.width / camera.fx, 0.5 * camera.height / camera.fy)
        fill = scene.radius * np.sqrt(1.0 + half**2) / half
        seeds = []
        for elevation in self.elevations_deg:
            azimuths = self._azimuths(elevation)
            for distance in self.distances:
                seeds.append(
                    sphere_seeds(scene.centre_mount, distance * fill, (elevation,), azimuths)
                )
        return np.concatenate(seeds)

    def _azimuths(self, elevation_deg: float) -> list[float]:
        """Degrees. Seen from above, an azimuth turns the picture: only turns make up for it."""
        nearer = np.cos(np.deg2rad(elevation_deg)) if self.turned else 1.0
        count = max(1, round(360.0 / _STEP_DEG * nearer))
        return (np.arange(count) * (360.0 / count)).tolist()


UPRIGHT = SeedGrid((-30.0, -15.0, 0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0))
TURNED = SeedGrid(
    (-90.0, -75.0, -60.0, -45.0, -30.0, -15.0, 0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0),
    turned=True,
    size_px=64,
    max_pairs=6,
)
"""Cameras on their side or upside down, and upright ones before an arm on a wall or a ceiling. The
comparison is coarser, there being ten thousands of them."""

TURNED_FINE = replace(TURNED, size_px=80, max_pairs=12)
"""The same compared as closely as upright ones, which takes four times as long: a thin arm before a
background of its colour is lost in the coarser one."""
