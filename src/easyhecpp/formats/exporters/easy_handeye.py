"""Calibration files of easy_handeye (ROS 1) and easy_handeye2 (ROS 2).

Both publish ``transform`` from ``robot_base_frame`` (camera beside the arm) or
``robot_effector_frame`` (camera on the arm) to ``tracking_base_frame``. Their readers refuse keys
that they do not know, so everything else is said in comments.
"""

from __future__ import annotations

from typing import Any

import yaml

from easyhecpp.formats.exporters._pose import Exporter, ExportPose, hash_comment, quat_xyzw

# No marker takes part, but the readers want the key.
_NO_MARKER = ""


def _easy_handeye2(pose: ExportPose) -> dict[str, bytes]:
    x, y, z, w = quat_xyzw(pose.T_parent_child).tolist()
    data = {
        "parameters": {
            "name": pose.camera_name,
            "calibration_type": "eye_on_base" if pose.mount_word == "base" else "eye_in_hand",
            **_frames(pose),
            "freehand_robot_movement": True,
            "move_group_namespace": "/",
            "move_group": "manipulator",
        },
        "transform": {
            "translation": _xyz(pose),
            "rotation": {"x": x, "y": y, "z": z, "w": w},
        },
    }
    return _file(pose, data, f"~/.ros2/easy_handeye2/calibrations/{pose.camera_name}.calib")


def _easy_handeye(pose: ExportPose) -> dict[str, bytes]:
    x, y, z, w = quat_xyzw(pose.T_parent_child).tolist()
    # publish.launch appends this to its argument namespace_prefix, and looks for the file by it.
    ending = "_eye_on_base" if pose.mount_word == "base" else "_eye_on_hand"
    namespace = f"{pose.camera_name.removesuffix(ending)}{ending}"
    data = {
        "parameters": {
            "namespace": f"/{namespace}/",
            "eye_on_hand": pose.mount_word == "ee",
            **_frames(pose),
            "freehand_robot_movement": True,
            "move_group_namespace": "/",
            "move_group": "manipulator",
        },
        "transformation": {**_xyz(pose), "qx": x, "qy": y, "qz": z, "qw": w},
    }
    return _file(
        pose,
        data,
        f"~/.ros/easy_handeye/{namespace}.yaml",
        "Old releases stop at freehand_robot_movement: delete that line for them.",
    )


def _frames(pose: ExportPose) -> dict[str, str]:
    return {
        "robot_base_frame": pose.base_link,
        "robot_effector_frame": pose.ee_link or "",
        "tracking_base_frame": pose.child,
        "tracking_marker_frame": _NO_MARKER,
    }


def _xyz(pose: ExportPose) -> dict[str, float]:
    return dict(zip("xyz", (pose.T_parent_child[:3, 3] + 0.0).tolist(), strict=True))


def _file(pose: ExportPose, data: dict[str, Any], home: str, *more: str) -> dict[str, bytes]:
    facts = pose.facts(
        "T_parent_child",
        "xyzw, each part named",
        f"It is found by its name: put it at {home}",
        *more,
    )
    text = yaml.safe_dump(data, sort_keys=False, allow_unicode=True, default_flow_style=False)
    return {"": (hash_comment(facts) + text).encode()}


EXPORTERS = (
    Exporter(
        "easy-handeye2",
        "calibration file of easy_handeye2 (ROS 2)",
        ".calib",
        _easy_handeye2,
        takes_link=True,
        name_is_stem=True,
    ),
    Exporter(
        "easy-handeye",
        "calibration file of easy_handeye (ROS 1)",
        ".yaml",
        _easy_handeye,
        takes_link=True,
        name_is_stem=True,
    ),
)
