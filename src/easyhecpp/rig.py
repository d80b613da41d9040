"""The two set-ups, camera beside the arm and camera on the arm, as one model.

The unknown is always `T_mount_cam`. For eye-to-hand the mount is the robot's base; for eye-in-hand
it is the link that the camera rides on. Nothing outside this module needs to know which it is:

    T_cam_link(q) = inv(T_mount_cam) @ inv(T_base_mount(q)) @ T_base_link(q)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np

from easyhecpp.errors import InputError
from easyhecpp.geometry import inverse

if TYPE_CHECKING:
    from easyhecpp.robot import Robot

Setup = Literal["eye-to-hand", "eye-in-hand"]

SETUPS: tuple[str, ...] = get_args(Setup)


def check_setup(value: object) -> Setup:
    """Returns `value` when it names a set-up.

    Raises:
        InputError: It names none.
    """
    if value == "eye-to-hand":
        return "eye-to-hand"
    if value == "eye-in-hand":
        return "eye-in-hand"
    raise InputError(
        f"Unknown set-up {value!r}",
        expected=" or ".join(SETUPS),
        fix="Give eye-to-hand for a camera beside the arm, eye-in-hand for one on the arm",
    )


def mount_frame(setup: Setup) -> Literal["base", "ee"]:
    """The word for the frame that the camera is fixed to, for names such as `T_base_cam`."""
    return "base" if setup == "eye-to-hand" else "ee"


def rides_on_arm(setup: Setup) -> bool:
    """Whether the camera moves with the arm."""
    return mount_frame(setup) == "ee"


def mount_link(setup: Setup, base_link: str, ee_link: str | None) -> str | None:
    """The link that the camera is fixed to, None when that is the `ee_link` and there is none."""
    return base_link if mount_frame(setup) == "base" else ee_link


@dataclass(frozen=True)
class Rig:
    """A robot together with the link that the camera is fixed to.

    Args:
        robot: The arm.
        setup: `eye-to-hand` (camera fixed to the base) or `eye-in-hand` (camera fixed to a link).
        ee_link: For eye-in-hand the link that the camera rides on; not used otherwise.

    Raises:
        InputError: Unknown set-up, or an eye-in-hand rig without an `ee_link` that the robot has.
    """

    robot: Robot
    setup: Setup = "eye-to-hand"
    ee_link: str | None = None

    def __post_init__(self) -> None:
        mount = mount_link(check_setup(self.setup), self.robot.base_link, self.ee_link)
        if mount not in self.robot.frame_names:
            raise self._no_mount()

    @property
    def mount(self) -> str:
        """Name of the link that the camera is fixed to: the parent of the sought transform."""
        return mount_link(self.setup, self.robot.base_link, self.ee_link) or self.robot.base_link

    def Ts_mount_link(self, q: np.ndarray) -> np.ndarray:
        """Poses of the links with geometry, seen from the mount.

        Args:
            q: Joint positions (..., n), in the robot's order.

        Returns:
            (..., L, 4, 4), in the order of `robot.link_names`.
        """
        Ts_base_link = self.robot.link_poses(q)
        if self.mount == self.robot.base_link:
            return Ts_base_link
        T_base_mount = self.robot.frame_pose(q, self.mount)
        return inverse(T_base_mount)[..., None, :, :] @ Ts_base_link

    def Ts_cam_link(self, T_mount_cam: np.ndarray, q: np.ndarray) -> np.ndarray:
        """Poses of the links with geometry, seen from the camera.

        Args:
            T_mount_cam: Pose of the camera in the mount (4, 4).
            q: Joint positions (..., n).

        Returns:
            (..., L, 4, 4).
        """
        return inverse(T_mount_cam) @ self.Ts_mount_link(q)

    def _no_mount(self) -> InputError:
        return InputError(
            "An eye-in-hand camera needs the link it rides on"
            if self.ee_link is None
            else f"The robot '{self.robot.name}' has no link '{self.ee_link}'",
            where="ee_link",
            expected=f"one of {', '.join(self.robot.frame_names)}",
            fix="Name the link that the camera is screwed to, usually the flange",
        )
