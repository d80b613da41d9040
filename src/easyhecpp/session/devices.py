"""What a live calibration asks of a robot arm and of a camera.

Drivers and the simulated cell have this shape; nothing needs to inherit from here.
"""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from easyhecpp.camera import Camera as Intrinsics

F64 = NDArray[np.float64]


@runtime_checkable
class RobotArm(Protocol):
    """An arm that can be asked where it is and told where to go."""

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The n joints, in the order of every vector here."""
        ...

    @property
    def limits(self) -> tuple[F64, F64]:
        """Lower and upper limits (n,), radians and metres."""
        ...

    def read_joints(self) -> F64:
        """Where the joints are now, (n,)."""
        ...

    def move_along(self, path: F64, speed: float) -> bool:
        """Move through waypoints, straight in joint space, and wait until there.

        Args:
            path: (N, n) waypoints; the first may be where the arm is.
            speed: Of the fastest joint, rad/s (m/s for a sliding one).

        Returns:
            Whether the end was reached; False when `stop` was called on the way.

        Raises:
            InputError: A waypoint or the speed makes no sense; the arm has not moved then.
        """
        ...

    def stop(self) -> None:
        """Stop where the arm is; may be called from another thread."""
        ...


class Frame(Protocol):
    """A picture from a camera."""

    @property
    def image(self) -> NDArray[np.uint8]:
        """(H, W, 3) RGB."""
        ...

    @property
    def stamp(self) -> float:
        """When it was taken: seconds on the clock of the device."""
        ...


@runtime_checkable
class Camera(Protocol):
    """A camera that takes a picture when asked."""

    @property
    def intrinsics(self) -> Intrinsics:
        """Of the pictures that it takes."""
        ...

    def capture(self) -> Frame:
        """Take a picture now."""
        ...
