"""From a seed to the top of its hill: the pose score climbed without derivatives.

Seeds are off by degrees and tens of pixels. So far off, displacements along the contour's normals
are mostly read off the wrong thing (a shadow, another link), but the score of a pose, a sum over
all pixels, still rises towards the truth.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from easyhecpp.geometry import inverse, perturb_about
from easyhecpp.segment.classical.search import Scored
from easyhecpp.segment.scene import Scene

F64 = NDArray[np.float64]

_STEP = np.array([0.08, 0.08, 0.2, 0.12, 0.12, 0.12])
"""First steps sideways and in depth, as shares of the distance, and turns in radians: about what
lies between neighbouring seeds."""

_SETTLED_STEP, _SETTLED_SCORE = 1e-2, 1e-4


def climb(
    score: Callable[[F64], float],
    scene: Scene,
    T_mount_cam: F64,
    *,
    step: float,
    evaluations: int,
) -> Scored:
    """Nelder and Mead's method on the six parameters of the pose.

    Args:
        score: Of a pose ``(4, 4)``; larger is better.
        scene: The arm; turns are about its middle.
        T_mount_cam: ``(4, 4)`` start.
        step: Size of the first steps, 1 for a seed.
        evaluations: Most scores asked for.

    Returns:
        The best pose that was scored.
    """
    start = inverse(T_mount_cam)
    centre = scene.centre_cam(start)
    distance = float(np.linalg.norm(centre))
    unit = step * _STEP * np.array([distance, distance, distance, 1.0, 1.0, 1.0])

    def pose(x: F64) -> F64:
        return inverse(perturb_about(start, centre, x * unit))

    found = minimize(
        lambda x: -score(pose(x)),
        np.zeros(6),
        method="Nelder-Mead",
        options={
            "initial_simplex": np.vstack([np.zeros(6), np.eye(6)]),
            "maxfev": evaluations,
            "xatol": _SETTLED_STEP,
            "fatol": _SETTLED_SCORE,
        },
    )
    return Scored(pose(np.asarray(found.x, np.float64)), -float(found.fun))
