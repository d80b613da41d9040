"""Intrinsics as ROS writes them, in both of its layouts, as YAML or JSON.

Layout one is the dump of a `sensor_msgs/CameraInfo` topic (`width`, `height`, `k`, `d`,
`distortion_model`, also with capital letters as in ROS 1); layout two is the file of
`camera_calibration_parsers` (`image_width`, `camera_matrix: {rows, cols, data}`, ...).
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from easyhecpp.camera import DISTORTION_MODELS, Camera
from easyhecpp.capture._text import closest, listing
from easyhecpp.capture.camera_entries import (
    LAYOUTS,
    as_count,
    as_number,
    as_numbers,
    read_entries,
)
from easyhecpp.errors import InputError

_ALIASES = {"": "none", "fisheye": "equidistant"}

# Outside these the numbers are no pixels: a normalised matrix, millimetres, a lost decimal point.
_MIN_FOCAL_SHARE, _MAX_FOCAL_SHARE = 0.1, 100.0


def read_camera_info(path: str | Path) -> Camera:
    """Read the intrinsics of a camera.

    Args:
        path: YAML or JSON file in either ROS layout.

    Returns:
        The camera whose pictures are what the driver publishes: binning and region of interest
        are worked into size and matrix.

    Raises:
        InputError: The file cannot be read or its numbers cannot be those of a camera.
    """
    return parse_camera_info(path)[0]


def parse_camera_info(path: str | Path) -> tuple[Camera, tuple[str, ...]]:
    """Like `read_camera_info`, together with sentences on what the file left open."""
    path = Path(path)
    entries = read_entries(path)
    width, height = _size(entries, path)
    matrix = _intrinsic_matrix(entries, path)
    notes: list[str] = []
    model, coefficients = _distortion(entries, path, notes)
    frame = _frame(entries, notes)
    fx, fy, cx, cy = _checked_intrinsics(matrix, width, height, path, notes)
    camera = Camera(
        width=width,
        height=height,
        fx=fx,
        fy=fy,
        cx=cx,
        cy=cy,
        distortion_model=model,
        distortion=coefficients,
        **({} if frame is None else {"frame": frame}),
    )
    return _as_published(camera, entries, path, notes), tuple(notes)


def camera_info_entries(camera: Camera) -> dict[str, Any]:
    """The intrinsics in the layout of a topic dump, ready for YAML or JSON."""
    k = [camera.fx, 0.0, camera.cx, 0.0, camera.fy, camera.cy, 0.0, 0.0, 1.0]
    return {
        "frame_id": camera.frame,
        "width": int(camera.width),
        "height": int(camera.height),
        "distortion_model": camera.distortion_model,
        "d": [float(value) for value in camera.distortion],
        "k": [float(value) for value in k],
    }


def _size(entries: Mapping[str, Any], path: Path) -> tuple[int, int]:
    sizes = []
    for key in ("width", "height"):
        value = entries.get(key, entries.get(f"image_{key}"))
        if value is None:
            raise InputError(f"The camera_info has no {key}", where=path, expected=LAYOUTS)
        number = as_number(value, key, path)
        if number <= 0 or number != int(number):
            raise InputError(
                f"The camera_info gives the {key} as {value}",
                where=path,
                expected="a positive whole number of pixels",
                fix=f"Enter the {key} of the images",
            )
        sizes.append(int(number))
    return sizes[0], sizes[1]


def _intrinsic_matrix(entries: Mapping[str, Any], path: Path) -> np.ndarray:
    value = entries.get("k", entries.get("camera_matrix"))
    if value is None:
        raise InputError(
            "The camera_info has no intrinsics (no 'k' and no 'camera_matrix')",
            where=path,
            expected=LAYOUTS,
            fix="Add the row-major 3x3 matrix: k: [fx, 0, cx, 0, fy, cy, 0, 0, 1]",
        )
    numbers = as_numbers(value, "k", path)
    if len(numbers) != 9:
        raise InputError(
            f"The intrinsic matrix 'k' has {len(numbers)} numbers",
            where=path,
            expected="nine, row by row: [fx, 0, cx, 0, fy, cy, 0, 0, 1]",
        )
    if not any(numbers):
        raise InputError(
            "The intrinsic matrix 'k' is all zeros, which is what a driver publishes for a camera "
            "that was never calibrated",
            where=path,
            fix="Calibrate the camera's intrinsics first",
        )
    return np.asarray(numbers).reshape(3, 3)


def _checked_intrinsics(
    matrix: np.ndarray, width: int, height: int, path: Path, notes: list[str]
) -> tuple[float, float, float, float]:
    """Focal lengths and principal point of a matrix that can be a camera's."""
    (fx, skew, cx), (below, fy, cy), last = matrix.tolist()
    if skew != 0.0:
        raise InputError(
            f"The intrinsic matrix has a skew of {skew:g}",
            where=path,
            expected="0 at k[1]; cameras with skew are not supported",
            fix="Calibrate without skew; sensors with square pixels have none",
        )
    if below != 0.0 or last != [0.0, 0.0, 1.0]:
        raise InputError(
            f"The intrinsic matrix is {matrix.ravel().tolist()}",
            where=path,
            expected="row by row [fx, 0, cx, 0, fy, cy, 0, 0, 1]; a transposed matrix looks "
            "like this",
        )
    _check_focal(fx, "fx", width, path)
    _check_focal(fy, "fy", height, path)
    for value, name, size in ((cx, "cx", width), (cy, "cy", height)):
        if not -size < value < 2 * size:
            raise InputError(
                f"The principal point {name} = {value:g} lies far outside the image of "
                f"{width}x{height}",
                where=path,
                expected=f"a value near {size / 2:g}",
                fix="Check that the matrix belongs to this resolution and is in pixels",
            )
        if not 0 <= value < size:
            notes.append(
                f"The principal point {name} = {value:g} lies outside the image of "
                f"{width}x{height}."
            )
    return fx, fy, cx, cy


def _check_focal(value: float, name: str, size: int, path: Path) -> None:
    if value <= 0:
        raise InputError(
            f"The focal length {name} is {value:g}",
            where=path,
            expected="a positive number of pixels",
            fix="Take the matrix from the driver or from a calibration",
        )
    if not _MIN_FOCAL_SHARE * size <= value <= _MAX_FOCAL_SHARE * size:
        raise InputError(
            f"The focal length {name} = {value:g} cannot belong to an image of {size} pixels",
            where=path,
            expected=f"pixels, between {_MIN_FOCAL_SHARE * size:g} and {_MAX_FOCAL_SHARE * size:g}",
            fix="Check the unit: neither millimetres nor a matrix normalised to an image size of 1",
        )


def _distortion(
    entries: Mapping[str, Any], path: Path, notes: list[str]
) -> tuple[str, tuple[float, ...]]:
    """Model and coefficients as `Camera` wants them."""
    value = entries.get("d", entries.get("distortion_coefficients"))
    given = [] if value is None else as_numbers(value, "d", path)
    name = entries.get("distortion_model")
    if name is None:
        if any(given):
            raise InputError(
                f"The camera_info has {len(given)} distortion coefficients but no distortion_model",
                where=path,
                expected=f"one of {listing(DISTORTION_MODELS)}",
                fix="Add a line such as 'distortion_model: plumb_bob'",
            )
        notes.append("The camera_info gives no distortion; the lens is taken as free of it.")
        return "none", ()
    model = _model_name(str(name), path)
    if model in ("plumb_bob", "rational_polynomial") and not given:
        notes.append(
            f"The camera_info names the distortion model {name} without coefficients; the lens is "
            "taken as free of distortion."
        )
        return "none", ()
    counts = DISTORTION_MODELS[model]
    # Drivers fill up with zeros (five of them for 'none', fourteen for a rational model).
    while len(given) > counts[-1] and given[-1] == 0.0:
        given.pop()
    if len(given) not in counts:
        raise InputError(
            f"The distortion model {name} comes with {len(given)} coefficients",
            where=path,
            expected=f"{' or '.join(str(count) for count in counts)}",
            fix="Correct 'd' or 'distortion_model'",
        )
    return model, tuple(given)


def _model_name(name: str, path: Path) -> str:
    folded = _ALIASES.get(name.strip().lower(), name.strip().lower())
    if folded in DISTORTION_MODELS:
        return folded
    near = closest(folded, [*DISTORTION_MODELS, *filter(None, _ALIASES)])
    raise InputError(
        f"Unknown distortion model '{name}'",
        where=path,
        expected=f"one of {listing(DISTORTION_MODELS)}",
        fix=f"Did you mean '{near}'?" if near else "Calibrate with one of these models",
    )


def _frame(entries: Mapping[str, Any], notes: list[str]) -> str | None:
    frame = entries.get("frame_id")
    if isinstance(frame, str) and frame.strip():
        return frame.strip().lstrip("/")
    notes.append("The camera_info gives no frame_id; the camera's frame gets the default name.")
    return None


def _as_published(
    camera: Camera, entries: Mapping[str, Any], path: Path, notes: list[str]
) -> Camera:
    """The camera of the published pictures: its region of interest cut out, then binned.

    The matrix of a CameraInfo belongs to the full, unbinned picture. A binned pixel's centre is
    the middle of the pixels that it joins, hence the halves.
    """
    x, y, width, height = _region(entries, camera, path)
    bins = [as_count(entries.get(f"binning_{axis}"), f"binning_{axis}", path) or 1 for axis in "xy"]
    if (x, y, width, height) == (0, 0, camera.width, camera.height) and bins == [1, 1]:
        return camera
    notes.append(
        f"The camera_info cuts out {width}x{height} pixels at ({x}, {y}) and bins them "
        f"{bins[0]}x{bins[1]}; size and matrix follow."
    )
    return Camera(
        width=width // bins[0],
        height=height // bins[1],
        fx=camera.fx / bins[0],
        fy=camera.fy / bins[1],
        cx=(camera.cx - x + 0.5) / bins[0] - 0.5,
        cy=(camera.cy - y + 0.5) / bins[1] - 0.5,
        distortion_model=camera.distortion_model,
        distortion=camera.distortion,
        frame=camera.frame,
    )


def _region(entries: Mapping[str, Any], camera: Camera, path: Path) -> tuple[int, int, int, int]:
    roi = entries.get("roi")
    if not isinstance(roi, Mapping):
        return 0, 0, camera.width, camera.height
    values = {
        key: as_count(roi.get(key), f"roi: {key}", path)
        for key in ("x_offset", "y_offset", "width", "height")
    }
    x, y = values["x_offset"], values["y_offset"]
    # All zero means the whole picture.
    width, height = values["width"] or camera.width - x, values["height"] or camera.height - y
    if width <= 0 or height <= 0 or x + width > camera.width or y + height > camera.height:
        raise InputError(
            f"The region of interest, {width}x{height} at ({x}, {y}), is not inside the image of "
            f"{camera.width}x{camera.height}",
            where=path,
            fix="Correct 'roi', or remove it when the images show the whole picture",
        )
    return x, y, width, height
