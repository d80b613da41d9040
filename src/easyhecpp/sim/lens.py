"""Any camera from a path tracer that only knows square pixels and straight lines.

A camera with distortion, or whose focal lengths differ, gets an oversize pinhole picture that
holds all its rays, resampled at the places where the rays of each pixel go.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from easyhecpp.camera import Camera
from easyhecpp.errors import InputError
from easyhecpp.render._jit import jit

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]

# Finer pixels than the camera's keep the second sampling from blurring much.
OVERSIZE = 1.5
_MARGIN_PX = 3
_WIDEST = np.tan(np.radians(70.0))


@dataclass(frozen=True, eq=False)
class PinholePlan:
    """What to trace for a camera, and how to turn it into the camera's picture.

    Attributes:
        pinhole: undistorted camera with square pixels.
        lookup: (H, W, 2) pixel of the pinhole picture for every pixel, or None where the
            pinhole picture is the camera's.
    """

    pinhole: Camera
    lookup: F64 | None

    def finish(self, picture: F32) -> F32:
        """Resample a (h, w, 3) pinhole picture to the camera's (H, W, 3)."""
        if self.lookup is None:
            return picture
        right = np.asarray(np.gradient(self.lookup, axis=1))
        down = np.asarray(np.gradient(self.lookup, axis=0))
        return _resampled(np.ascontiguousarray(picture), self.lookup, right, down)

    def samples(self, wanted: int) -> int:
        """Samples per traced pixel that make ``wanted`` per pixel of the camera."""
        return wanted if self.lookup is None else max(1, round(wanted / OVERSIZE**2))


@jit
def _resampled(picture: F32, lookup: F64, right: F64, down: F64) -> F32:
    """Average a picture over the 3 x 3 parts of every pixel of another.

    One look-up per pixel would leave edges up to a fiftieth of a pixel off, depending on where
    they fall between the two grids.

    Args:
        picture: (h, w, 3).
        lookup: (H, W, 2) place of every pixel's centre in it.
        right: (H, W, 2) how the place changes from a pixel to its right neighbour.
        down: (H, W, 2) likewise to the neighbour below.
    """
    rows, columns = lookup.shape[:2]
    out = np.zeros((rows, columns, 3), np.float32)
    for y in range(rows):
        for x in range(columns):
            for j in range(-1, 2):
                for i in range(-1, 2):
                    u = lookup[y, x, 0] + (i * right[y, x, 0] + j * down[y, x, 0]) / 3.0
                    v = lookup[y, x, 1] + (i * right[y, x, 1] + j * down[y, x, 1]) / 3.0
                    u = min(max(u, 0.0), picture.shape[1] - 1.001)
                    v = min(max(v, 0.0), picture.shape[0] - 1.001)
                    u0, v0 = int(u), int(v)
                    a, b = u - u0, v - v0
                    for c in range(3):
                        top = (1 - a) * picture[v0, u0, c] + a * picture[v0, u0 + 1, c]
                        low = (1 - a) * picture[v0 + 1, u0, c] + a * picture[v0 + 1, u0 + 1, c]
                        out[y, x, c] += ((1 - b) * top + b * low) / 9.0
    return out


def plan_pinhole(camera: Camera) -> PinholePlan:
    """Find the pinhole picture that holds everything a camera sees.

    Raises:
        InputError: the camera sees farther than 70 degrees off its axis.
    """
    if not camera.is_distorted and abs(camera.fx / camera.fy - 1.0) < 1e-9:
        return PinholePlan(camera, None)
    columns, rows = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    rays = camera.unproject(np.stack([columns, rows], axis=-1).astype(float))[..., :2]
    if not (np.abs(rays) < _WIDEST).all():
        raise InputError(
            "The simulated cell cannot draw so wide a view",
            where="camera",
            expected="every pixel within 70 degrees of the optical axis",
            fix="Use a camera with a longer focal length or a smaller picture.",
        )
    low, high = rays.reshape(-1, 2).min(axis=0), rays.reshape(-1, 2).max(axis=0)
    focal = OVERSIZE * max(camera.fx, camera.fy)
    origin = _MARGIN_PX - focal * low
    width, height = np.ceil(focal * (high - low)).astype(int) + 2 * _MARGIN_PX + 1
    pinhole = Camera(int(width), int(height), focal, focal, float(origin[0]), float(origin[1]))
    return PinholePlan(pinhole, focal * rays + origin)
