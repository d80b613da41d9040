"""What every exporter is handed: one pose with its frames, and sentences that state them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from datetime import datetime

import numpy as np
from numpy.typing import ArrayLike, NDArray

from easyhecpp.camera import Camera
from easyhecpp.geometry import inverse, quat_wxyz_from_matrix
from easyhecpp.rig import Setup, mount_frame

Array = NDArray[np.float64]

OPTICAL_AXES = "optical axes (OpenCV, ROS): +X right, +Y down, +Z forward"
GL_AXES = "OpenGL axes (USD, MuJoCo): +X right, +Y up, -Z forward"
BODY_AXES = "body axes (ROS, SAPIEN): +X forward, +Y left, +Z up"

# The same camera centre, other axes: the columns are the new axes in the optical frame.
T_CAM_CAMGL: Array = np.diag([1.0, -1.0, -1.0, 1.0])
T_CAM_CAMBODY: Array = np.array(
    [[0.0, -1.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
)


@dataclass(frozen=True)
class ExportPose:
    """One pose to be written in some consumer's spelling.

    Attributes:
        T_parent_child: ``(4, 4)`` pose of the child in the parent.
        parent: The mount's link name.
        child: The camera's optical frame, or the driver's camera link.
        child_axes: Sentence on the child's axes.
        setup: ``eye-to-hand`` or ``eye-in-hand``.
        camera: Intrinsics; of the optical frame, whatever the child is.
        camera_name: What to call the camera where a consumer wants a name.
        base_link: The robot's base.
        ee_link: The robot's tool link, or None when it is not known.
        origin: Sentences on the result that the pose comes from: writer, verdict, uncertainty.
        created: When the result was made.
    """

    T_parent_child: Array
    parent: str
    child: str
    child_axes: str
    setup: Setup
    camera: Camera
    camera_name: str
    base_link: str
    ee_link: str | None
    origin: tuple[str, ...]
    created: datetime

    @property
    def T_child_parent(self) -> Array:
        """The other direction, ``(4, 4)``."""
        return inverse(self.T_parent_child)

    @property
    def mount_word(self) -> str:
        """``base`` or ``ee``: what the parent is, for names such as ``T_base_cam``."""
        return mount_frame(self.setup)

    def facts(self, holds: str, quaternion: str | None, *more: str) -> list[str]:
        """Lines for the head of a file: origin, frames, both directions, what the file holds.

        Args:
            holds: Which direction and axes the file's numbers have.
            quaternion: Order of the quaternions in the file, or None when it has none.
            more: Further lines, each to end up as it is.
        """
        lines = [
            *self.origin,
            f"parent frame: {self.parent}",
            f"child frame: {self.child}; {self.child_axes}",
            "T_parent_child, the pose of the child in the parent: p_parent = T @ p_child, metres",
            *_spelled(self.T_parent_child),
            "T_child_parent, the other direction: p_child = T @ p_parent",
            *_spelled(self.T_child_parent),
            f"This file holds {holds}.",
        ]
        if quaternion is not None:
            lines.append(f"Quaternions below are {quaternion}.")
        return [*lines, *more]

    def lens_facts(self) -> list[str]:
        """A warning for consumers that know pinholes only; empty when the lens is one."""
        if not self.camera.is_distorted:
            return []
        return [
            f"The lens distortion ({self.camera.distortion_model}) cannot be stated here: before",
            "laying renderings over real images, undistort these, keeping the camera's K.",
        ]


@dataclass(frozen=True)
class Exporter:
    """One consumer's format.

    Attributes:
        name: What the user asks for.
        summary: One line for listings.
        suffix: Of the file name.
        render: Turns a pose into files: what to append to the file's name, and the content.
        takes_link: Whether the pose of a driver's camera link makes sense to the consumer.
        eye_to_hand_only: Whether the consumer knows fixed cameras only.
        name_is_stem: Whether the consumer finds the file by the camera's name.
        needs_name: Why a camera name must be given, or None when it need not.
    """

    name: str
    summary: str
    suffix: str
    render: Callable[[ExportPose], Mapping[str, bytes]]
    takes_link: bool = False
    eye_to_hand_only: bool = False
    name_is_stem: bool = False
    needs_name: str | None = None


def number(value: float) -> str:
    """Spell a float with the fewest digits that read back to the same double, no exponent.

    Exponents are left out since some YAML readers take ``1e-05`` for a string.
    """
    return np.format_float_positional(float(value) + 0.0, trim="0")


def numbers(values: ArrayLike, separator: str = " ") -> str:
    """Spell several floats; see `number`."""
    return separator.join(number(value) for value in np.ravel(values))


def quat_wxyz(T: Array) -> Array:
    """Unit quaternion ``(4,)`` of a pose, real part first."""
    return quat_wxyz_from_matrix(T[:3, :3]) + 0.0


def quat_xyzw(T: Array) -> Array:
    """Unit quaternion ``(4,)`` of a pose, real part last."""
    return np.roll(quat_wxyz(T), -1)


def euler_xyz(R: ArrayLike) -> tuple[float, float, float]:
    """Angles about the fixed axes x, y, z in that order: ``R = Rz(yaw) Ry(pitch) Rx(roll)``.

    These are URDF's ``rpy`` and scipy's ``as_euler("xyz")``, in radians. Exact near a pitch of 90
    degrees too: roll is taken from what is left once yaw is undone, so that whatever error yaw has
    is made good, and no arcsine is taken.
    """
    R = np.asarray(R, dtype=np.float64)
    yaw = np.arctan2(R[1, 0], R[0, 0])
    s, c = np.sin(yaw), np.cos(yaw)
    pitch = np.arctan2(-R[2, 0], c * R[0, 0] + s * R[1, 0])
    roll = np.arctan2(s * R[0, 2] - c * R[1, 2], c * R[1, 1] - s * R[0, 1])
    return float(roll), float(pitch), float(yaw)


def identifier(name: str) -> str:
    """Turn a frame name into letters, digits and underscores, beginning with a letter."""
    safe = "".join(c if c.isascii() and c.isalnum() else "_" for c in name)
    return safe if safe[:1].isalpha() else f"f_{safe}"


def hash_comment(lines: Iterable[str]) -> str:
    """Comment lines for Python, shell, YAML and USD."""
    return "".join(f"# {_one_line(line)}".rstrip() + "\n" for line in lines)


def xml_comment(lines: Iterable[str], indent: str = "") -> str:
    """A comment for XML, where two hyphens in a row are forbidden."""
    body = "".join(f"{indent}  {_one_line(line)}\n" for line in lines).replace("--", "- -")
    return f"{indent}<!--\n{body}{indent}-->\n"


def _one_line(text: str) -> str:
    # Versions and reasons come from a file; a line break in one would end the comment.
    return " ".join(text.splitlines())


def _spelled(T: Array) -> list[str]:
    return [
        f"  xyz {numbers(T[:3, 3])}",
        f"  quaternion wxyz {numbers(quat_wxyz(T))}",
        f"  quaternion xyzw {numbers(quat_xyzw(T))}",
    ]
