"""The transform from a driver's camera link to the optical frame, as the user gives it.

A camera driver publishes ``camera_link -> camera_color_optical_frame`` itself. A frame has one
parent in tf, so the calibration must then be published for the link:
``T_mount_link = T_mount_optical @ inv(T_link_optical)``. The transform is never guessed: its
rotation is conventional, but its translation is the distance of the lens from the housing's origin,
millimetres to centimetres.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import ArrayLike, NDArray

from easyhecpp.errors import InputError
from easyhecpp.formats._checks import quaternion_problems, rigid_problems
from easyhecpp.formats.exporters._pose import T_CAM_CAMBODY
from easyhecpp.geometry import inverse, make_transform, matrix_from_quat_wxyz

Array = NDArray[np.float64]

_FORMS = (
    "a 4x4 matrix, seven numbers (x y z and the quaternion w x y z), xyz with quat_wxyz, xyz with "
    "rotation: optical, or translation and rotation {x, y, z, w} as ROS prints them"
)


@dataclass(frozen=True)
class CameraLink:
    """Where the optical frame is on the camera's housing.

    Attributes:
        T_link_optical: ``(4, 4)`` pose of the optical frame in the link.
        frame: The link's name.
        optical_frame: The optical frame's name, or None when it was not given.

    Raises:
        InputError: The matrix is no rigid transform, or the name no name.
    """

    T_link_optical: Array
    frame: str = "camera_link"
    optical_frame: str | None = None

    def __post_init__(self) -> None:
        if not (self.frame and self.frame.isprintable()):
            raise InputError(f"The camera link's name {self.frame!r} is empty or cannot be printed")
        if problems := rigid_problems(self.T_link_optical):
            raise InputError(
                f"The link-to-optical transform is not rigid: {'; '.join(problems)}",
                expected="a rotation and a translation in metres",
            )

    @classmethod
    def parse(cls, value: Any, *, where: object = None) -> CameraLink:
        """Understand a transform in any of the accepted spellings.

        Args:
            value: A 4x4 matrix; seven numbers, x y z and the quaternion w x y z; or a mapping with
                ``matrix``, with ``xyz`` and ``quat_wxyz``, with ``xyz`` and ``rotation: optical``
                (the axes that REP 103 gives a link and its optical frame), or with ROS's
                ``translation`` and ``rotation``. A mapping may name its frames: ``parent`` and
                ``child``, or ROS's ``header.frame_id`` and ``child_frame_id``.
            where: File that it came from, for errors.

        Raises:
            InputError: It is none of these, or no rotation.
        """
        names: dict[str, str] = {}
        if isinstance(value, Mapping):
            names = _names(value)
            T = _from_mapping(value.get("transform", value), where)
        else:
            T = _from_numbers(value, where)
        try:
            return cls(T, **names)
        except InputError as error:
            raise InputError(error.what, where=where, expected=error.expected) from error

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> CameraLink:
        """Load one from a YAML or JSON file; see `parse` for its content.

        Raises:
            InputError: The file cannot be read, or see `parse`.
        """
        try:
            value = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
        except OSError as error:
            raise InputError(
                f"Cannot read the link-to-optical transform: {error.strerror}", where=path
            ) from error
        except (yaml.YAMLError, UnicodeDecodeError) as error:
            raise InputError(
                "The link-to-optical transform is not YAML or JSON", where=path, expected=_FORMS
            ) from error
        return cls.parse(value, where=path)

    def pose_of(self, T_mount_optical: ArrayLike, optical_frame: str) -> Array:
        """Return the link's pose in the mount, ``(4, 4)``.

        Args:
            T_mount_optical: ``(4, 4)`` calibrated pose.
            optical_frame: The frame that it is the pose of.

        Raises:
            InputError: The transform was given for another optical frame, or the other way round.
        """
        if self.frame == optical_frame:
            raise InputError(
                f"The transform starts at the optical frame {optical_frame!r}",
                expected="the pose of the optical frame in the camera link",
                fix="Give the other direction, parent the link and child the optical frame",
            )
        if self.optical_frame not in (None, optical_frame):
            raise InputError(
                f"The link-to-optical transform ends at {self.optical_frame!r}, but the calibrated "
                f"frame is {optical_frame!r}"
            )
        return np.asarray(T_mount_optical, dtype=np.float64) @ inverse(self.T_link_optical)


def _names(value: Mapping[str, Any]) -> dict[str, str]:
    header = value.get("header")
    parent = value.get("parent", header.get("frame_id") if isinstance(header, Mapping) else None)
    child = value.get("child", value.get("child_frame_id"))
    return {
        key: str(name)
        for key, name in (("frame", parent), ("optical_frame", child))
        if name is not None
    }


def _from_mapping(value: Any, where: object) -> Array:
    if not isinstance(value, Mapping):
        raise _not_understood(where)
    if "matrix" in value:
        return _from_numbers(value["matrix"], where)
    if "translation" in value:
        xyz = _components(value["translation"], "xyz", where)
        x, y, z, w = _components(value.get("rotation"), "xyzw", where)
        return _from_numbers([*xyz, w, x, y, z], where)
    xyz = value.get("xyz", value.get("xyz_m"))
    if not isinstance(xyz, Sequence) or isinstance(xyz, str):
        raise InputError(
            "The link-to-optical transform has no translation",
            where=where,
            expected=_FORMS,
            fix="Measure it, or print it with: ros2 run tf2_ros tf2_echo LINK OPTICAL_FRAME",
        )
    if "quat_wxyz" in value:
        return _from_numbers([*xyz, *value["quat_wxyz"]], where)
    if value.get("rotation") == "optical":
        T = inverse(T_CAM_CAMBODY)
        return make_transform(T[:3, :3], _floats(xyz, (3,), where))
    raise InputError(
        "The link-to-optical transform has no rotation that is understood",
        where=where,
        expected=_FORMS,
        fix="Write rotation: optical for a link with x forward, y left and z up",
    )


def _from_numbers(value: Any, where: object) -> Array:
    try:
        size = np.size(np.asarray(value, dtype=np.float64))
    except (TypeError, ValueError) as error:
        raise _not_understood(where) from error
    if size != 7:
        return _floats(value, (4, 4), where)
    numbers = _floats(value, (7,), where)
    if problems := quaternion_problems(numbers[3:]):
        raise InputError(
            f"The link-to-optical transform is no rotation: {problems[0]}",
            where=where,
            expected="a unit quaternion, real part first",
        )
    return make_transform(matrix_from_quat_wxyz(numbers[3:]), numbers[:3])


def _floats(value: Any, shape: tuple[int, ...], where: object) -> Array:
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise _not_understood(where) from error
    if array.shape != shape or not np.isfinite(array).all():
        raise _not_understood(where)
    return array


def _components(value: Any, keys: str, where: object) -> list[float]:
    if not isinstance(value, Mapping) or not all(key in value for key in keys):
        raise _not_understood(where)
    return [value[key] for key in keys]


def _not_understood(where: object) -> InputError:
    return InputError(
        "The link-to-optical transform is not understood", where=where, expected=_FORMS
    )
