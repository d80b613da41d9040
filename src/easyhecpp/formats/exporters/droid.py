"""An entry for the calibration file of DROID's robot stack."""

from __future__ import annotations

from easyhecpp.formats._json_text import json_text
from easyhecpp.formats.exporters._pose import OPTICAL_AXES, Exporter, ExportPose, euler_xyz


def _droid(pose: ExportPose) -> dict[str, bytes]:
    T = pose.T_parent_child
    # Its reader takes "pose" and "timestamp" out of each entry and leaves other keys alone, but
    # wants every top-level key to be a camera; so the explanation lives inside the entry.
    entry = {
        "pose": [*(T[:3, 3] + 0.0).tolist(), *euler_xyz(T[:3, :3])],
        "timestamp": pose.created.timestamp(),
        "parent_frame": pose.parent,
        "child_frame": pose.child,
        "conventions": {
            "pose": "the camera in the robot's base: x, y, z in metres, then the angles about the "
            "fixed axes x, y, z in radians (scipy's lower-case 'xyz')",
            "camera": f"the left lens, {OPTICAL_AXES}",
        },
        "T_base_cam": (T + 0.0).tolist(),
        "T_cam_base": (pose.T_child_parent + 0.0).tolist(),
        "origin": list(pose.origin),
    }
    return {"": json_text({f"{pose.camera_name}_left": entry}).encode()}


EXPORTERS = (
    Exporter(
        "droid",
        "entry for DROID's calibration_info.json",
        ".droid.json",
        _droid,
        eye_to_hand_only=True,
        needs_name="DROID keys its cameras by the ZED's serial number",
    ),
)
