"""How far a pose is from the truth, and what many such distances amount to."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from easyhecpp.geometry import inverse, log_se3, pose_error

F64 = NDArray[np.float64]

RIGHT_MM, RIGHT_DEG = 20.0, 2.0
"""A pose is right when the camera's centre and orientation are no farther off than this."""


@dataclass(frozen=True)
class PoseError:
    """Distance of an estimated camera pose from the true one.

    Attributes:
        position_mm: between the two camera centres.
        rotation_deg: angle of the rotation that takes one orientation to the other.
    """

    position_mm: float
    rotation_deg: float

    @classmethod
    def between(cls, T_a_cam_est: F64, T_a_cam_true: F64) -> PoseError:
        """The error of an estimate of a camera's pose in any frame a."""
        metres, radians = pose_error(T_a_cam_est, T_a_cam_true)
        return cls(1000.0 * metres, math.degrees(radians))

    @classmethod
    def of(cls, position_mm: float | None, rotation_deg: float | None) -> PoseError | None:
        """From numbers that are None where no pose was found."""
        if position_mm is None or rotation_deg is None:
            return None
        return cls(position_mm, rotation_deg)

    @property
    def is_right(self) -> bool:
        """Whether it is in the right basin: within 20 mm and 2 deg."""
        return self.position_mm <= RIGHT_MM and self.rotation_deg <= RIGHT_DEG


@dataclass(frozen=True)
class Spread:
    """One kind of error over many poses; not a number where there is nothing to say.

    Attributes:
        mean: over the right poses.
        median: over all poses, where a pose that was not found at all counts as infinite.
        p95: 95th percentile, over all poses likewise.
    """

    mean: float
    median: float
    p95: float

    @classmethod
    def of(cls, values: Sequence[float | None], right: Sequence[bool]) -> Spread:
        """Sum up values of one kind.

        Args:
            values: One for each pose; None for a pose that was not found.
            right: Whether each pose is right.
        """
        known = [math.inf if value is None else value for value in values]
        good = [value for value, fine in zip(known, right, strict=True) if fine]
        return cls(
            mean=float(np.mean(good)) if good else math.nan,
            median=_percentile(known, 50.0),
            p95=_percentile(known, 95.0),
        )


@dataclass(frozen=True)
class ErrorSummary:
    """Errors of many poses.

    Attributes:
        count: number of poses.
        failures: number that are not right, or were not found.
        position_mm: distances between camera centres.
        rotation_deg: angles.
    """

    count: int
    failures: int
    position_mm: Spread
    rotation_deg: Spread

    @property
    def failure_interval(self) -> tuple[float, float]:
        """95 % interval of the share of failures."""
        return wilson_interval(self.failures, self.count)


def summarise(errors: Sequence[PoseError | None]) -> ErrorSummary:
    """Sum up errors; None stands for a pose that was not found."""
    right = [error is not None and error.is_right for error in errors]
    return ErrorSummary(
        count=len(errors),
        failures=len(errors) - sum(right),
        position_mm=Spread.of([e and e.position_mm for e in errors], right),
        rotation_deg=Spread.of([e and e.rotation_deg for e in errors], right),
    )


def wilson_interval(successes: int, count: int, confidence: float = 0.95) -> tuple[float, float]:
    """Wilson's score interval of a rate; (0, 1) when nothing was counted.

    Args:
        successes: how often it happened.
        count: how often it could have happened.
        confidence: probability that such an interval holds the true rate.
    """
    if count == 0:
        return 0.0, 1.0
    z = float(stats.norm.ppf(0.5 + confidence / 2.0))
    rate = successes / count
    centre = (rate + z**2 / (2 * count)) / (1 + z**2 / count)
    half = z / (1 + z**2 / count) * math.sqrt(rate * (1 - rate) / count + (z / (2 * count)) ** 2)
    return max(0.0, centre - half), min(1.0, centre + half)


def chi_square(T_a_cam_est: F64, covariance: F64, T_a_cam_true: F64) -> float:
    """Squared true error in units of the reported uncertainty.

    Args:
        T_a_cam_est: (4, 4) the estimate.
        covariance: (6, 6) of the tangent [v, w] in `T_a_cam_est @ exp([v, w])`, m and rad.
        T_a_cam_true: (4, 4) the truth.

    Returns:
        A number that has the chi-square distribution with 6 degrees of freedom when the
        uncertainty is honest; infinite for a covariance that excludes the error outright.
    """
    tangent = log_se3(inverse(T_a_cam_est) @ T_a_cam_true)
    # Metres and radians differ in size by orders of magnitude: scale before inverting.
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-30))
    unit = tangent / scale
    return float(unit @ np.linalg.pinv(covariance / np.outer(scale, scale), hermitian=True) @ unit)


def ellipsoid_share(values: Sequence[float], probability: float = 0.95) -> float:
    """Share of errors within the ellipsoid that should hold `probability` of them."""
    if not len(values):
        return math.nan
    return float(np.mean(np.asarray(values) <= stats.chi2.ppf(probability, 6)))


def _percentile(values: Sequence[float], percent: float) -> float:
    """Linear between order statistics, as numpy's, but infinite values stay infinite."""
    if not values:
        return math.nan
    ordered = sorted(values)
    at = percent / 100.0 * (len(ordered) - 1)
    low, high = ordered[math.floor(at)], ordered[math.ceil(at)]
    return low if low == high else low + (at - math.floor(at)) * (high - low)
