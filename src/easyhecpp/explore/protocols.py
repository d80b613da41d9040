"""What the choice of joint poses asks of others."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]


@runtime_checkable
class CollisionChecker(Protocol):
    """Knows which joint poses must not be driven to.

    Attributes:
        description: What it tests, a sentence for the user.
    """

    @property
    def description(self) -> str:
        """What it tests, a sentence."""
        ...

    def collides(self, joints: F64) -> NDArray[np.bool_]:
        """Which of the joint poses ``(N, n)`` collide: ``(N,)``."""
        ...
