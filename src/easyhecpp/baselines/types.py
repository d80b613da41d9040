"""What every baseline returns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class BaselineResult:
    """A camera pose by some other method.

    Attributes:
        T_mount_cam: ``(4, 4)`` pose of the camera in the mount; None when there is none.
        method: Name of the method.
        seconds: What the method itself took: no pictures, no detection.
        views_used: Views that took part.
        status: ``done`` or ``failed``.
        message: The status in a sentence.
    """

    T_mount_cam: NDArray[np.float64] | None
    method: str
    seconds: float
    views_used: int
    status: str
    message: str
