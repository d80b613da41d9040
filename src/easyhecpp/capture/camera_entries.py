"""The entries of a camera_info file, YAML or JSON, as numbers, before any of them has a meaning."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from easyhecpp._paths import reason
from easyhecpp.errors import InputError

LAYOUTS = (
    "the output of 'ros2 topic echo --once .../camera_info' (width, height, k, d, "
    "distortion_model) or a camera_calibration_parsers file (image_width, image_height, "
    "camera_matrix, distortion_coefficients)"
)


def read_entries(path: Path) -> dict[str, Any]:
    """The file's entries by lower-case key, those of a `header` included."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except FileNotFoundError as error:
        raise InputError(
            "There is no camera_info file",
            where=path,
            expected=LAYOUTS,
            fix="Record it beside the images, or name it in capture.yaml: 'camera_info: FILE'",
        ) from error
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(
            f"The camera_info file cannot be read: {reason(error)}",
            where=path,
            fix="Make it a text file that you may read",
        ) from error
    content = _first_document(text, path)
    if not isinstance(content, dict) or not content:
        raise InputError("The camera_info file holds no entries", where=path, expected=LAYOUTS)
    entries = {str(key).lower(): value for key, value in content.items()}
    header = entries.get("header")
    if isinstance(header, Mapping) and header.get("frame_id"):
        entries.setdefault("frame_id", header["frame_id"])
    return entries


def _first_document(text: str, path: Path) -> Any:
    try:
        if path.suffix.lower() == ".json":
            return json.loads(text)
        # `ros2 topic echo` ends every message with '---'; the messages of a fixed camera agree.
        return next((part for part in yaml.safe_load_all(text) if part is not None), None)
    except (yaml.YAMLError, ValueError) as error:  # ValueError: JSON, and dates that are none
        kind = "JSON" if path.suffix.lower() == ".json" else "YAML"
        raise InputError(
            f"The camera_info file is not valid {kind}: {' '.join(str(error).split())}",
            where=path,
            expected=LAYOUTS,
        ) from error


def as_numbers(value: Any, key: str, path: Path) -> list[float]:
    """A list, a nested list or a `{rows, cols, data}` matrix as a flat list of finite numbers."""
    if isinstance(value, Mapping):
        value = value.get("data")
    if not isinstance(value, list):
        raise InputError(f"'{key}' is {value!r}", where=path, expected="a list of numbers")
    flat = [item for row in value for item in (row if isinstance(row, list) else [row])]
    return [as_number(item, key, path) for item in flat]


def as_number(value: Any, key: str, path: Path) -> float:
    """A finite number."""
    # PyYAML reads '1e-05' as a text, so texts that are numbers are taken as such.
    try:
        number = math.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not math.isfinite(number):
        raise InputError(
            f"'{key}' holds {value!r}, which is not a finite number",
            where=path,
            fix="Take the numbers from the driver or from a calibration",
        )
    return number


def as_count(value: Any, key: str, path: Path) -> int:
    """A whole number, 0 when there is none."""
    if value is None:
        return 0
    number = as_number(value, key, path)
    if number < 0 or number != int(number):
        raise InputError(f"'{key}' is {value}", where=path, expected="a whole number, 0 or more")
    return int(number)
