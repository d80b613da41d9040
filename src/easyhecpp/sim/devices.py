"""The simulated cell as a robot arm and a camera, for whatever drives real ones.

Both keep the shape that a live calibration expects of real devices. Time is simulated: moving
takes as long as the path and the speed say, on a clock of its own that the picture's stamps read.
"""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from easyhecpp.camera import Camera
from easyhecpp.errors import InputError
from easyhecpp.sim.cell import Cell
from easyhecpp.sim.studio import PREVIEW, Quality

F64 = NDArray[np.float64]

_TICK = 0.02


class SimulatedArm:
    """The arm of a cell as a device.

    Args:
        cell: the cell.
        joints: (n,) where it starts; by default its neutral pose.
        pace: seconds of real time that a simulated second takes; 0 does not wait.
    """

    def __init__(self, cell: Cell, joints: ArrayLike | None = None, *, pace: float = 0.0) -> None:
        self._robot = cell.robot
        self._pace = pace
        self._lock = threading.Lock()
        self._stop = threading.Event()
        start = self._robot.neutral if joints is None else joints
        self._joints = self._checked(np.asarray(start, float)[None])[0]
        self._clock = 0.0

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The n joints, in the order of every vector here."""
        return self._robot.joint_names

    @property
    def limits(self) -> tuple[F64, F64]:
        """Lower and upper limits (n,), radians and metres."""
        return self._robot.lower, self._robot.upper

    @property
    def clock(self) -> float:
        """Simulated seconds since the start."""
        return self.read_state()[1]

    def read_joints(self) -> F64:
        """Where the joints are now, (n,)."""
        return self.read_state()[0]

    def read_state(self) -> tuple[F64, float]:
        """Where the joints are, (n,), and the simulated seconds at which they are there."""
        with self._lock:
            return self._joints.copy(), self._clock

    def move_along(self, path: ArrayLike, speed: float) -> bool:
        """Move through waypoints, straight in joint space, and wait until there.

        Args:
            path: (N, n) waypoints; the first may be where the arm is.
            speed: of the fastest joint, rad/s (m/s for a sliding one).

        Returns:
            Whether the end was reached; False when `stop` was called on the way.

        Raises:
            InputError: a waypoint is outside the limits or not a number, or the speed is not
                positive; the arm has not moved then.
        """
        waypoints = self._checked(np.atleast_2d(np.asarray(path, float)))
        if not (np.isfinite(speed) and speed > 0):
            raise InputError(
                f"The speed is {speed}", where="move_along", expected="a number above 0, rad/s"
            )
        self._stop.clear()
        return all(self._move_to(target, speed) for target in waypoints)

    def stop(self) -> None:
        """Stop where the arm is; may be called from another thread."""
        self._stop.set()

    def _move_to(self, target: F64, speed: float) -> bool:
        start = self.read_joints()
        duration = float(np.abs(target - start).max()) / speed
        steps = max(1, int(np.ceil(duration / _TICK)))
        for step in range(1, steps + 1):
            if self._stop.is_set():
                return False
            if self._pace > 0:
                time.sleep(self._pace * duration / steps)
            with self._lock:
                self._joints = start + (target - start) * (step / steps)
                self._clock += duration / steps
        return True

    def _checked(self, path: F64) -> F64:
        n = self._robot.n_joints
        if path.ndim != 2 or path.shape[1] != n:
            raise InputError(
                f"A path has the shape {path.shape}",
                where="move_along",
                expected=f"(N, {n}): one column for each of {', '.join(self.joint_names)}",
            )
        if not np.isfinite(path).all():
            raise InputError("A waypoint is not a number", where="move_along")
        outside = (path < self._robot.lower - 1e-6) | (path > self._robot.upper + 1e-6)
        if outside.any():
            row, joint = (int(i) for i in np.argwhere(outside)[0])
            raise InputError(
                f"Waypoint {row} puts {self.joint_names[joint]} at {path[row, joint]:.4f}",
                where="move_along",
                expected=f"{self._robot.lower[joint]:.4f} to {self._robot.upper[joint]:.4f}",
            )
        return path


@dataclass(frozen=True, eq=False)
class Frame:
    """A picture from a camera.

    Attributes:
        image: (H, W, 3) uint8 RGB.
        stamp: seconds, on the clock of the device that took it.
    """

    image: NDArray[np.uint8]
    stamp: float


class SimulatedCamera:
    """The camera of a cell as a device; it sees the arm where the arm is.

    Args:
        cell: the cell.
        arm: the arm in it.
        quality: ``preview``, ``full`` or a `Quality`.
    """

    def __init__(self, cell: Cell, arm: SimulatedArm, *, quality: Quality | str = PREVIEW) -> None:
        self.cell = cell
        self._arm = arm
        self._quality = quality
        self._count = 0

    @property
    def intrinsics(self) -> Camera:
        """The camera's intrinsics."""
        return self.cell.camera

    def capture(self) -> Frame:
        """Take a picture now; its stamp is that of the pose in it, however long rendering takes."""
        joints, stamp = self._arm.read_state()
        view = self.cell.capture(joints, quality=self._quality, first_index=self._count)[0]
        self._count += 1
        return Frame(view.image, stamp)

    def knock(self, T_mount_cam: ArrayLike) -> None:
        """Move the camera, as when somebody bumps into the tripod."""
        self.cell = self.cell.with_camera(T_mount_cam)
