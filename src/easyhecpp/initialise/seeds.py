"""Camera poses to try when nothing is known."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from easyhecpp.geometry import exp_so3, look_at, make_transform

F64 = NDArray[np.float64]

PAPER_ELEVATIONS_DEG = tuple(range(0, 71, 10))
PAPER_AZIMUTHS_DEG = tuple(range(0, 360, 30))
PAPER_DISTANCE = 1.0
"""The grid of the paper, section "Implementation Details": 96 poses at one metre."""

ELEVATIONS_DEG = (-60.0, -35.0, -10.0, 15.0, 40.0, 65.0, 85.0)
ROLLS_DEG = (-30.0, 0.0, 30.0)
OTHER_ROLLS_DEG = tuple(range(60, 301, 30))


def sphere_seeds(
    centre: ArrayLike,
    distance: float,
    elevations_deg: Sequence[float],
    azimuths_deg: Sequence[float],
    rolls_deg: Sequence[float] = (0.0,),
) -> F64:
    """Cameras on a sphere that look at its centre.

    Args:
        centre: ``(3,)`` metres, mount frame.
        distance: Radius of the sphere, metres.
        elevations_deg: Angle above the mount's xy plane.
        azimuths_deg: Angle about the mount's z axis.
        rolls_deg: Rotation about the optical axis; 0 keeps the mount's z axis up in the image.

    Returns:
        ``(S, 4, 4)`` poses ``T_mount_cam``.
    """
    centre = np.asarray(centre, np.float64)
    seeds = []
    for elevation in np.deg2rad(elevations_deg):
        for azimuth in np.deg2rad(azimuths_deg):
            direction = np.array(
                [
                    np.cos(elevation) * np.cos(azimuth),
                    np.cos(elevation) * np.sin(azimuth),
                    np.sin(elevation),
                ]
            )
            T = look_at(centre + distance * direction, centre)
            for roll in np.deg2rad(rolls_deg):
                seeds.append(T @ make_transform(exp_so3([0.0, 0.0, roll]), [0.0, 0.0, 0.0]))
    return np.stack(seeds)


def default_seeds(centre: ArrayLike, distance: float) -> F64:
    """Seeds all around the arm, from below too, with rolls; coarser in azimuth near the poles."""
    return _all_around(centre, distance, ELEVATIONS_DEG, 0.0, ROLLS_DEG)


def seeds_between(centre: ArrayLike, distance: float) -> F64:
    """Seeds that lie in the gaps of `default_seeds`, in elevation and in azimuth."""
    return _all_around(centre, distance, _between(ELEVATIONS_DEG), 0.5, ROLLS_DEG)


def turned_seeds(centre: ArrayLike, distance: float) -> F64:
    """Both, for a camera on its side or upside down, or before an arm on a wall or a ceiling."""
    at = _all_around(centre, distance, ELEVATIONS_DEG, 0.0, OTHER_ROLLS_DEG)
    gaps = _all_around(centre, distance, _between(ELEVATIONS_DEG), 0.5, OTHER_ROLLS_DEG)
    return np.concatenate([at, gaps])


def _between(values: Sequence[float]) -> list[float]:
    return [0.5 * (a + b) for a, b in pairwise(values)]


def _all_around(
    centre: ArrayLike,
    distance: float,
    elevations_deg: Sequence[float],
    shift: float,
    rolls_deg: Sequence[float],
) -> F64:
    """Rings of seeds; ``shift`` turns each by a share of its step."""
    parts = []
    for elevation in elevations_deg:
        n = max(4, round(14 * np.cos(np.deg2rad(elevation))))
        azimuths = (np.arange(n) + shift) * 360.0 / n
        parts.append(sphere_seeds(centre, distance, (elevation,), azimuths.tolist(), rolls_deg))
    return np.concatenate(parts)


def paper_seeds(centre: ArrayLike) -> F64:
    """The paper's hemisphere: 8 elevations x 12 azimuths at a distance of one metre."""
    return sphere_seeds(centre, PAPER_DISTANCE, PAPER_ELEVATIONS_DEG, PAPER_AZIMUTHS_DEG)
