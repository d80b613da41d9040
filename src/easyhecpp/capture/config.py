"""`capture.yaml`: the optional settings of a capture folder."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import MISSING, dataclass, field, fields
from pathlib import Path
from typing import Any, Literal

import yaml

from easyhecpp._paths import expanded, reason
from easyhecpp.capture._text import did_you_mean, listing
from easyhecpp.errors import InputError
from easyhecpp.rig import SETUPS, Setup, check_setup
from easyhecpp.robot.urdf import GEOMETRIES, Geometry

CONFIG_NAME = "capture.yaml"

JointUnits = Literal["rad", "deg"]


@dataclass(frozen=True)
class CaptureConfig:
    """The settings of a capture folder, each with its default.

    Paths are relative to the capture folder, or absolute.

    Attributes:
        setup: Where the camera is: beside the arm (`eye-to-hand`) or on it (`eye-in-hand`).
        robot: URDF or xacro file, as a path or a `package://` address.
        base_link: First link of the robot; None takes the first one with geometry.
        ee_link: Link that an eye-in-hand camera rides on.
        ignore_links: Links whose geometry is not drawn.
        geometry: Which geometry of the links is drawn: `visual`, or `collision` where the visual
            meshes are not at hand.
        package_dirs: Folders that hold the packages of `package://` addresses.
        camera_info: File with the intrinsics.
        joints: Table of joint positions.
        joint_units: Unit of every revolute joint, in `joints` and in `default_joints`; prismatic
            joints are in metres whatever this says.
        default_joints: Positions of joints that have no column in the table.
        images: Folder of the pictures.
        masks: Folder of the masks.
        depth: Folder of the depth images.
    """

    setup: Setup = "eye-to-hand"
    robot: str = "robot/robot.urdf"
    base_link: str | None = None
    ee_link: str | None = None
    ignore_links: tuple[str, ...] = ()
    geometry: Geometry = "visual"
    package_dirs: tuple[str, ...] = ()
    camera_info: str = "camera_info.yaml"
    joints: str = "joints.csv"
    joint_units: JointUnits = "rad"
    default_joints: Mapping[str, float] = field(default_factory=dict)
    images: str = "images"
    masks: str = "masks"
    depth: str = "depth"

    def package_paths(self, root: Path) -> tuple[Path, ...]:
        """The package folders as paths."""
        where = f"{root / CONFIG_NAME}, package_dirs"
        return tuple(root / expanded(folder, where) for folder in self.package_dirs)


def read_config(root: Path) -> CaptureConfig:
    """Reads `capture.yaml` of a capture folder; without the file every default holds.

    Raises:
        InputError: The file cannot be read, has an unknown key, or a value of the wrong kind.
    """
    path = root / CONFIG_NAME
    content = _load_yaml(path)
    if content is None:
        return CaptureConfig()
    if not isinstance(content, dict):
        raise InputError(
            "capture.yaml does not hold settings",
            where=str(path),
            expected="lines of the form 'key: value'",
            fix=f"write settings such as 'setup: eye-to-hand', valid keys are {_valid_keys()}",
        )
    values = {str(key): value for key, value in content.items()}
    _refuse_unknown_keys(values, path)
    given = {
        key: _CHECKS[key](value, key, path) for key, value in values.items() if value is not None
    }
    return CaptureConfig(**given)


def config_values(config: CaptureConfig) -> dict[str, Any]:
    """The settings that differ from their defaults, ready for YAML."""
    values: dict[str, Any] = {}
    for item in fields(config):
        value = getattr(config, item.name)
        default = item.default if item.default is not MISSING else {}
        if value == default:
            continue
        if isinstance(value, tuple):
            value = list(value)
        values[item.name] = dict(value) if isinstance(value, Mapping) else value
    return values


def _valid_keys() -> str:
    return listing((item.name for item in fields(CaptureConfig)), limit=20)


def _load_yaml(path: Path) -> Any:
    try:
        return yaml.safe_load(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(
            f"capture.yaml cannot be read: {reason(error)}",
            where=str(path),
            fix="Make it a text file that you may read, or delete it to use the defaults",
        ) from error
    except (yaml.YAMLError, ValueError) as error:  # ValueError: a date that is none, among others
        raise InputError(
            f"capture.yaml is not valid YAML: {' '.join(str(error).split())}",
            where=str(path),
            expected="lines of the form 'key: value'",
            fix="correct the line, or delete the file to use the defaults",
        ) from error


def _refuse_unknown_keys(values: Mapping[str, Any], path: Path) -> None:
    known = [item.name for item in fields(CaptureConfig)]
    unknown = [key for key in values if key not in known]
    if not unknown:
        return
    hints = [f"'{key}': {hint}" for key in unknown if (hint := did_you_mean(key, known))]
    raise InputError(
        f"unknown {'keys' if len(unknown) > 1 else 'key'} in capture.yaml: {listing(unknown)}",
        where=str(path),
        expected=f"keys out of {_valid_keys()}",
        fix="; ".join(hints) or "remove it",
    )


def _wrong(value: object, key: str, path: Path, expected: str) -> InputError:
    return InputError(
        f"'{key}' in capture.yaml is {value!r}",
        where=str(path),
        expected=expected,
        fix=f"correct or remove '{key}'",
    )


def _text(value: object, key: str, path: Path) -> str:
    if not _is_text(value):
        raise _wrong(value, key, path, "a text")
    return str(value)


def _is_text(value: object) -> bool:
    return isinstance(value, str) and bool(value.strip()) and "\0" not in value


def _texts(value: object, key: str, path: Path) -> tuple[str, ...]:
    if not isinstance(value, list) or not all(_is_text(item) for item in value):
        raise _wrong(value, key, path, "a list of texts such as [a, b]")
    return tuple(value)


def _setup(value: object, key: str, path: Path) -> Setup:
    try:
        return check_setup(value)
    except InputError as error:
        raise _wrong(value, key, path, f"one of {listing(SETUPS)}") from error


def _one_of(*known: str) -> Callable[[object, str, Path], str]:
    def check(value: object, key: str, path: Path) -> str:
        if value not in known:
            raise _wrong(value, key, path, " or ".join(known))
        return str(value)

    return check


def _numbers(value: object, key: str, path: Path) -> dict[str, float]:
    if not isinstance(value, dict):
        raise _wrong(value, key, path, "joint names with a number each, such as {finger: 0.02}")
    numbers: dict[str, float] = {}
    for name, entry in value.items():
        try:
            number = math.nan if isinstance(entry, bool) else float(entry)
        except (TypeError, ValueError):
            number = math.nan
        if not math.isfinite(number):
            raise _wrong(entry, f"{key}: {name}", path, "a finite number")
        numbers[str(name)] = number
    return numbers


_CHECKS: dict[str, Callable[[object, str, Path], Any]] = {
    "setup": _setup,
    "robot": _text,
    "base_link": _text,
    "ee_link": _text,
    "ignore_links": _texts,
    "geometry": _one_of(*GEOMETRIES),
    "package_dirs": _texts,
    "camera_info": _text,
    "joints": _text,
    "joint_units": _one_of("rad", "deg"),
    "default_joints": _numbers,
    "images": _text,
    "masks": _text,
    "depth": _text,
}
