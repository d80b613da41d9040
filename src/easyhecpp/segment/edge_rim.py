"""What the light does across the arm's rim, so that the rim is found where it is, not beside it.

A curved surface often darkens towards its rim, or mirrors there what is behind it. Its light then
fades into the background's, and the steepest place lies inside of the rim, by a pixel or two. A
surface that begins with a step and goes on with a ramp, seen through the camera's blur, describes
both: of the places where it may begin, the one that leaves least of the light unexplained is the
rim. Step and ramp are free at each place, in each colour; where there is no ramp, this is the
middle of the step.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from easyhecpp.segment._rim_kernel import BEYOND, STEP, WITHIN

F64 = NDArray[np.float64]

USUAL_BLUR_PX = 0.6
"""Of a camera in focus: half a pixel of lens, and the pixel itself."""

BLURS_PX = (0.5, 0.6, 0.7, 0.8, 1.0, 1.25)
"""Those that are tried to measure a camera's."""

_INSIDE_PX, _OUTSIDE_PX, _SPACING_PX = 1.0, 3.0, 0.125
_RAMP_RIDGE = 0.03
"""Keeps a ramp from standing in for a step; per pixel squared, small against a few samples."""


@dataclass(frozen=True)
class RimModel:
    """Step and ramp behind one blur, at each place where they may begin.

    Attributes:
        blur_px: Standard deviation of the camera's blur.
        shifts: ``(G,)`` places, pixels outwards of the steepest rise.
        explains: ``(G, 2, T)`` rows whose products with the light, squared and summed, are what
            step and ramp explain of it; on the samples from `WITHIN` inside to `BEYOND` outside.
        step_width_px: Height over steepness of a mere step.
    """

    blur_px: float
    shifts: F64
    explains: F64
    step_width_px: float

    @classmethod
    @lru_cache(maxsize=2 * len(BLURS_PX))
    def behind(cls, blur_px: float) -> RimModel:
        """The model for a blur's standard deviation in pixels."""
        shifts = np.arange(-_INSIDE_PX, _OUTSIDE_PX + 0.5 * _SPACING_PX, _SPACING_PX)
        place = np.arange(-WITHIN, BEYOND + 1) * STEP
        z = (shifts[:, None] - place) / blur_px
        step = ndtr(z)
        ramp = blur_px * (z * step + np.exp(-0.5 * z * z) / np.sqrt(2.0 * np.pi))
        both = np.stack([step, ramp], axis=-1)
        normal = both.transpose(0, 2, 1) @ both + np.diag([1e-9, _RAMP_RIDGE])
        root = np.linalg.cholesky(np.linalg.inv(normal))
        return cls(
            blur_px,
            shifts,
            np.ascontiguousarray(root.transpose(0, 2, 1) @ both.transpose(0, 2, 1)),
            # The kernel measures the steepness over a pixel to either side.
            1.0 / (2.0 * float(ndtr(1.0 / blur_px)) - 1.0),
        )
