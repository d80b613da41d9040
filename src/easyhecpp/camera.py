"""A pinhole camera with lens distortion, OpenCV's conventions throughout.

An integer pixel coordinate is the pixel's centre: the top left pixel covers -0.5 to 0.5. Renderers
that measure from the image edge differ by half a pixel, 0.55 mm at a metre for a common camera.

How lenses bend rays, and what happens to points far outside the picture, is in `easyhecpp._lens`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from easyhecpp._lens import Lens
from easyhecpp.errors import InputError

Array = NDArray[np.float64]

# How many coefficients each model may have.
DISTORTION_MODELS = {
    "none": (0,),
    "plumb_bob": (4, 5),
    "rational_polynomial": (8,),
    "equidistant": (4,),
}


@dataclass(frozen=True)
class Camera:
    """Intrinsics of one camera.

    Attributes:
        width: Image width in pixels.
        height: Image height in pixels.
        fx: Focal length along x in pixels.
        fy: Focal length along y in pixels.
        cx: Principal point, where 0 is the centre of the leftmost pixel.
        cy: Principal point, where 0 is the centre of the topmost pixel.
        distortion_model: ``none``, ``plumb_bob``, ``rational_polynomial`` or ``equidistant``, the
            names that ROS uses.
        distortion: Coefficients in OpenCV's order: k1 k2 p1 p2 (k3 (k4 k5 k6)), or k1..k4 of
            ``equidistant`` (OpenCV's fisheye).
        frame: Name of the optical frame (+Z forward, +X right, +Y down).

    Raises:
        InputError: A value is out of range, or the coefficients do not fit the model.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion_model: str = "none"
    distortion: tuple[float, ...] = ()
    frame: str = "camera_color_optical_frame"

    def __post_init__(self) -> None:
        for name in ("width", "height"):
            object.__setattr__(self, name, _pixel_count(name, getattr(self, name)))
        for name in ("fx", "fy", "cx", "cy"):
            object.__setattr__(self, name, _finite(name, getattr(self, name)))
        for name in ("fx", "fy"):
            if getattr(self, name) <= 0.0:
                raise InputError(
                    f"The camera's {name} is {getattr(self, name)}",
                    expected="a focal length in pixels above 0",
                )
        object.__setattr__(
            self, "distortion", _coefficients(self.distortion_model, self.distortion)
        )

    @property
    def K(self) -> Array:
        """The ``(3, 3)`` intrinsic matrix."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @property
    def is_distorted(self) -> bool:
        """Whether straight lines bend. A fisheye does so even with coefficients of zero."""
        return self.distortion_model == "equidistant" or any(self.distortion)

    @property
    def valid_radius(self) -> float:
        """Largest undistorted radius (tan of the angle off axis) with monotone distortion."""
        return self._lens.valid_radius if self.is_distorted else math.inf

    def scaled(self, factor: float) -> Camera:
        """Return the camera of the same picture resized by ``factor``.

        The image edges, not the pixel centres, are what a resize keeps in place, hence the half
        pixels in the principal point.

        Args:
            factor: New size over old size, above 0.
        """
        if not (math.isfinite(factor) and factor > 0.0):
            raise InputError(f"Cannot scale a camera by {factor}", expected="a factor above 0")
        return replace(
            self,
            width=max(1, round(self.width * factor)),
            height=max(1, round(self.height * factor)),
            fx=self.fx * factor,
            fy=self.fy * factor,
            cx=(self.cx + 0.5) * factor - 0.5,
            cy=(self.cy + 0.5) * factor - 0.5,
        )

    def project(self, points_cam: ArrayLike) -> Array:
        """Project points.

        Args:
            points_cam: ``(..., 3)`` metres, camera frame.

        Returns:
            ``(..., 2)`` pixel coordinates x, y; NaN for points not in front of the camera.
        """
        points = np.asarray(points_cam, dtype=np.float64)
        p = points[..., :2] / _positive(points[..., 2:])
        return self._to_pixels(self._lens.distort(p) if self.is_distorted else p)

    def project_with_jacobian(self, points_cam: ArrayLike) -> tuple[Array, Array]:
        """Project points and differentiate.

        Args:
            points_cam: ``(..., 3)`` metres, camera frame.

        Returns:
            ``(..., 2)`` pixel coordinates as in `project`, and their derivative ``(..., 2, 3)`` by
            the point, pixels per metre.
        """
        points = np.asarray(points_cam, dtype=np.float64)
        z = _positive(points[..., 2:])
        p = points[..., :2] / z
        J = np.zeros((*p.shape[:-1], 2, 3))
        J[..., 0, 0] = J[..., 1, 1] = 1.0 / z[..., 0]
        J[..., 2] = -p / z
        if self.is_distorted:
            J = self._lens.jacobian(p) @ J
            p = self._lens.distort(p)
        return self._to_pixels(p), np.array([[self.fx], [self.fy]]) * J

    def unproject(self, px: ArrayLike) -> Array:
        """Turn pixels into rays.

        Args:
            px: ``(..., 2)`` pixel coordinates x, y.

        Returns:
            ``(..., 3)`` points of depth 1 on the rays, camera frame. NaN where no ray in front of
            the camera ends in that pixel, which happens in the corners of a fisheye.
        """
        px = np.asarray(px, dtype=np.float64)
        d = (px - (self.cx, self.cy)) / (self.fx, self.fy)
        p = self._lens.undistort(d) if self.is_distorted else d
        return np.concatenate([p, np.where(np.isnan(p[..., :1]), np.nan, 1.0)], axis=-1)

    def jacobian_by_k(self, px: ArrayLike) -> Array:
        """How the pictures of points move when the distortion's k1 and k2 change.

        Args:
            px: ``(..., 2)`` pixel coordinates x, y.

        Returns:
            ``(..., 2, 2)`` pixels per unit of k1 and k2, NaN where no ray ends in that pixel.
        """
        J = self._lens.jacobian_by_k(self.unproject(px)[..., :2])
        return np.array([[self.fx], [self.fy]]) * J

    def numba_params(self) -> tuple[Array, int, Array, float]:
        """Return the camera as plain numbers for compiled kernels.

        Returns:
            ``[fx, fy, cx, cy]``; the model, 0 for none, 1 for polynomial, 2 for equidistant; eight
            coefficients, k1 k2 p1 p2 k3 k4 k5 k6 of the polynomial or k1..k4 of the fisheye,
            filled up with zeros; `valid_radius`.
        """
        code = 0
        if self.is_distorted:
            code = 2 if self.distortion_model == "equidistant" else 1
        coefficients = self._lens.coefficients.copy()
        return np.array([self.fx, self.fy, self.cx, self.cy]), code, coefficients, self.valid_radius

    @cached_property
    def _lens(self) -> Lens:
        coefficients = np.zeros(8)
        coefficients[: len(self.distortion)] = self.distortion
        return Lens(self.distortion_model == "equidistant", coefficients)

    def _to_pixels(self, d: Array) -> Array:
        return d * (self.fx, self.fy) + (self.cx, self.cy)


def _positive(z: Array) -> Array:
    return np.where(z > 0.0, z, np.nan)


def _pixel_count(name: str, value: object) -> int:
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value <= 0:
        raise InputError(
            f"The camera's {name} is {value!r}", expected="a whole number of pixels above 0"
        )
    return int(value)


def _finite(name: str, value: object) -> float:
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        number = math.nan
    if not math.isfinite(number):
        raise InputError(f"The camera's {name} is {value!r}", expected="a finite number")
    return number


def _coefficients(model: str, values: object) -> tuple[float, ...]:
    if model not in DISTORTION_MODELS:
        raise InputError(
            f"Unknown distortion model {model!r}",
            expected=f"one of {', '.join(DISTORTION_MODELS)}",
        )
    try:
        coefficients = tuple(_finite("distortion coefficient", value) for value in values)  # type: ignore[attr-defined]
    except TypeError:
        raise InputError(
            f"The camera's distortion is {values!r}", expected="a list of numbers"
        ) from None
    counts = DISTORTION_MODELS[model]
    if len(coefficients) not in counts:
        raise InputError(
            f"The distortion model {model!r} was given {len(coefficients)} coefficients",
            expected=" or ".join(str(count) for count in counts),
        )
    return coefficients
