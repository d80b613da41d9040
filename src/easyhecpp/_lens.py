"""Lens distortion: from the direction of a ray to the point where a distorted image shows it.

All models share one form. With ``p = (x/z, y/z)`` and ``r = |p|``:

    distorted = p * G(r) / r + h(r) * tangential(p)
    tangential(x, y) = (2 p1 x y + p2 (r^2 + 2 x^2), p1 (r^2 + 2 y^2) + 2 p2 x y)

Inside ``valid_radius`` (rv) ``G`` is the model's radial mapping g and ``h = 1``:

    polynomial   g(r) = r (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6)
    equidistant  g(r) = a (1 + k1 a^2 + k2 a^4 + k3 a^6 + k4 a^8),  a = atan(r)

Polynomials are fitted inside the image and turn back far outside of it, which would fold points
from beside the camera into the picture. Beyond ``rv`` both terms therefore go on along their
tangent in the direction of the radius, continuous in value and slope:

    G(r) = g(rv) + g'(rv) (r - rv)
    h(r) = s (2 - s),  s = rv / r
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Distortion counts as monotone while a step along the radius moves the distorted point by at least
# this share of the step (of the angle, for the fisheye). Zero would let all farther points pile up
# on one circle.
_MIN_SLOPE = 0.1

# Radii below this are on the axis; it only keeps divisions finite.
_TINY = 1e-12

_NEWTON_STEPS = 40
# In units of the distorted coordinates; a pixel is about 1e-3.
_NEWTON_TOLERANCE = 1e-13


@dataclass(frozen=True, eq=False)
class Lens:
    """One lens.

    Attributes:
        fisheye: Whether the model is ``equidistant`` rather than polynomial.
        coefficients: ``(8,)``: k1 k2 p1 p2 k3 k4 k5 k6, or k1..k4 of the fisheye.
    """

    fisheye: bool
    coefficients: Array

    @cached_property
    def valid_radius(self) -> float:
        """Largest undistorted radius up to which the distortion is monotone, or infinity."""
        return self._fisheye_radius() if self.fisheye else self._polynomial_radius()

    def distort(self, p: Array) -> Array:
        """Map undistorted ``(..., 2)`` to distorted ``(..., 2)``, both at depth 1."""
        r, s = self._radius_and_share(p)
        ratio, _ = self._radial(r)
        return ratio[..., None] * p + (s * (2.0 - s))[..., None] * self._tangential(p)

    def jacobian(self, p: Array) -> Array:
        """Differentiate `distort` at ``(..., 2)``, giving ``(..., 2, 2)``."""
        r, s = self._radius_and_share(p)
        ratio, slope = self._radial(r)
        u = p / np.maximum(r, _TINY)[..., None]
        h = s * (2.0 - s)
        dh = -2.0 * s * (1.0 - s) / np.maximum(r, _TINY)
        along = (slope - ratio)[..., None] * u + dh[..., None] * self._tangential(p)
        J = along[..., :, None] * u[..., None, :] + h[..., None, None] * self._tangential_slope(p)
        J[..., 0, 0] += ratio
        J[..., 1, 1] += ratio
        return J

    def jacobian_by_k(self, p: Array) -> Array:
        """Differentiate `distort` at ``(..., 2)`` by k1 and k2, giving ``(..., 2, 2)``.

        Where the model goes on along its tangent, the derivative of the bare model is given.
        """
        r = np.linalg.norm(p, axis=-1)
        if self.fisheye:
            angle = np.arctan(r)
            first = angle**3 / np.maximum(r, _TINY)
            second = first * angle**2
        else:
            q = r**2
            first = q / self._fraction[1](q)
            second = first * q
        return p[..., :, None] * np.stack([first, second], axis=-1)[..., None, :]

    def undistort(self, d: Array) -> Array:
        """Invert `distort`: ``(..., 2)`` to ``(..., 2)``, NaN where no point maps there."""
        radius_d = np.linalg.norm(d, axis=-1)
        angles, table = self._inverse_table
        guess = np.tan(np.interp(radius_d, table, angles))
        p = d * (guess / np.maximum(radius_d, _TINY))[..., None]
        tolerance = _NEWTON_TOLERANCE * (1.0 + radius_d)
        # Beyond the rim of a fisheye the iterates run away; they end as NaN below.
        with np.errstate(all="ignore"):
            for _ in range(_NEWTON_STEPS):
                residual = d - self.distort(p)
                reached = np.linalg.norm(residual, axis=-1) <= tolerance
                if np.all(reached):
                    break
                p = p + _solve_2x2(self.jacobian(p), residual)
            residual = d - self.distort(p)
            reached = np.linalg.norm(residual, axis=-1) <= 100.0 * tolerance
        return np.where(reached[..., None], p, np.nan)

    def _radius_and_share(self, p: Array) -> tuple[Array, Array]:
        """Return r, and s = rv / r where r is beyond rv, 1 elsewhere."""
        r = np.linalg.norm(p, axis=-1)
        return r, np.minimum(1.0, self.valid_radius / np.maximum(r, _TINY))

    def _radial(self, r: Array) -> tuple[Array, Array]:
        """Return G(r) / r and G'(r)."""
        inside = np.minimum(r, self.valid_radius)
        g, slope = self._model(inside)
        reached = g + slope * (r - inside)
        return np.where(r < _TINY, 1.0, reached / np.maximum(r, _TINY)), slope

    def _model(self, r: Array) -> tuple[Array, Array]:
        """Return g(r) and g'(r) of the bare model."""
        if self.fisheye:
            angle = np.arctan(r)
            mapping = self._angle_mapping
            return mapping(angle), mapping.deriv()(angle) / (1.0 + r**2)
        q = r**2
        N, D = self._fraction
        n, d = N(q), D(q)
        slope = (n * d + 2.0 * q * (N.deriv()(q) * d - n * D.deriv()(q))) / d**2
        return r * n / d, slope

    @cached_property
    def _angle_mapping(self) -> Polynomial:
        k1, k2, k3, k4 = self.coefficients[:4]
        return Polynomial([0.0, 1.0, 0.0, k1, 0.0, k2, 0.0, k3, 0.0, k4])

    @cached_property
    def _fraction(self) -> tuple[Polynomial, Polynomial]:
        """Numerator and denominator of g(r) / r as polynomials in r^2."""
        k1, k2, _, _, k3, k4, k5, k6 = self.coefficients
        return Polynomial([1.0, k1, k2, k3]), Polynomial([1.0, k4, k5, k6])

    def _tangential(self, p: Array) -> Array:
        if self.fisheye:
            return np.zeros_like(p)
        p1, p2 = self.coefficients[2:4]
        x, y = p[..., 0], p[..., 1]
        q = x**2 + y**2
        return np.stack(
            [
                2.0 * p1 * x * y + p2 * (q + 2.0 * x**2),
                p1 * (q + 2.0 * y**2) + 2.0 * p2 * x * y,
            ],
            axis=-1,
        )

    def _tangential_slope(self, p: Array) -> Array:
        J = np.zeros((*p.shape, 2))
        if not self.fisheye:
            p1, p2 = self.coefficients[2:4]
            x, y = p[..., 0], p[..., 1]
            J[..., 0, 0] = 2.0 * p1 * y + 6.0 * p2 * x
            J[..., 0, 1] = J[..., 1, 0] = 2.0 * p1 * x + 2.0 * p2 * y
            J[..., 1, 1] = 6.0 * p1 * y + 2.0 * p2 * x
        return J

    def _polynomial_radius(self) -> float:
        N, D = self._fraction
        in_r = Polynomial([0.0, 0.0, 1.0])
        numerator = N * D + Polynomial([0.0, 2.0]) * (N.deriv() * D - N * D.deriv())
        # In its worst direction the tangential term takes 6 |(p1, p2)| r off the slope.
        wanted = Polynomial([_MIN_SLOPE, 6.0 * math.hypot(*self.coefficients[2:4])])
        spare = numerator(in_r) - wanted * (D * D)(in_r)
        # Short of the pole of a rational model, where the mapping itself is infinite.
        return min(_first_positive_root(spare), 0.99 * _first_positive_root(D(in_r)))

    def _fisheye_radius(self) -> float:
        angle = _first_positive_root(self._angle_mapping.deriv() - _MIN_SLOPE)
        return math.tan(angle) if angle < math.pi / 2.0 else math.inf

    @cached_property
    def _inverse_table(self) -> tuple[Array, Array]:
        """Angles off axis and the distorted radii that they reach, both rising."""
        angles = np.linspace(0.0, math.pi / 2.0, 2000)[:-1]
        r = np.tan(angles)
        return angles, r * self._radial(r)[0]


def _first_positive_root(polynomial: Polynomial) -> float:
    roots = np.asarray(polynomial.trim().roots(), dtype=np.complex128)
    real = roots[np.abs(roots.imag) <= 1e-9 * (1.0 + np.abs(roots))].real
    return float(np.min(real[real > 0.0], initial=math.inf))


def _solve_2x2(matrix: Array, right: Array) -> Array:
    a, b = matrix[..., 0, 0], matrix[..., 0, 1]
    c, d = matrix[..., 1, 0], matrix[..., 1, 1]
    x, y = right[..., 0], right[..., 1]
    determinant = a * d - b * c
    return np.stack([d * x - b * y, a * y - c * x], axis=-1) / determinant[..., None]
