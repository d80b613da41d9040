"""The intrinsics that a pose belongs to, as ROS's camera_info YAML."""

from __future__ import annotations

import yaml

from easyhecpp.formats.exporters._pose import Exporter, ExportPose, hash_comment


def _camera_info(pose: ExportPose) -> dict[str, bytes]:
    camera = pose.camera
    # ROS has no name for a lens without distortion.
    model = "plumb_bob" if camera.distortion_model == "none" else camera.distortion_model
    coefficients = list(camera.distortion) or [0.0] * 5
    if model == "plumb_bob" and len(coefficients) == 4:
        coefficients.append(0.0)
    K = camera.K
    P = [[*row, 0.0] for row in K.tolist()]
    data = {
        "image_width": camera.width,
        "image_height": camera.height,
        "camera_name": pose.camera_name,
        "camera_matrix": _matrix(3, 3, K.ravel().tolist()),
        "distortion_model": model,
        "distortion_coefficients": _matrix(1, len(coefficients), coefficients),
        "rectification_matrix": _matrix(3, 3, [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]),
        "projection_matrix": _matrix(3, 4, [value for row in P for value in row]),
    }
    facts = pose.facts(
        "the intrinsics that the pose above belongs to (as camera_calibration_parsers reads them)",
        None,
        "An integer pixel coordinate is the centre of the pixel.",
        "Drivers warn when camera_name is not the name they use.",
    )
    text = yaml.safe_dump(data, sort_keys=False, allow_unicode=True, default_flow_style=None)
    return {"": (hash_comment(facts) + text).encode()}


def _matrix(rows: int, columns: int, data: list[float]) -> dict[str, object]:
    return {"rows": rows, "cols": columns, "data": data}


EXPORTERS = (
    Exporter(
        "camera-info",
        "the intrinsics as ROS camera_info YAML",
        ".camera_info.yaml",
        _camera_info,
    ),
)
