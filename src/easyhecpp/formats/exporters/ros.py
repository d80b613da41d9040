"""ROS 2 and ROS 1 static transforms: commands and a launch file."""

from __future__ import annotations

import shlex

from easyhecpp.formats.exporters._pose import (
    Exporter,
    ExportPose,
    hash_comment,
    identifier,
    number,
    numbers,
    quat_xyzw,
)

_HOLDS = "T_parent_child, as tf2 wants it"


def tf2_arguments(pose: ExportPose) -> list[str]:
    """Arguments of ROS 2's ``static_transform_publisher`` (flags, since Humble)."""
    flags = ("--x", "--y", "--z", "--qx", "--qy", "--qz", "--qw")
    values = (*pose.T_parent_child[:3, 3], *quat_xyzw(pose.T_parent_child))
    arguments = [
        text
        for flag, value in zip(flags, values, strict=True)
        for text in (flag, number(float(value)))
    ]
    return [*arguments, "--frame-id", pose.parent, "--child-frame-id", pose.child]


def _ros2_command(pose: ExportPose) -> dict[str, bytes]:
    facts = pose.facts(
        _HOLDS,
        "xyzw, each named by its flag",
        "Run this, or its last line, and leave it running. Only one node may publish this child.",
    )
    command = f"ros2 run tf2_ros static_transform_publisher {shlex.join(tf2_arguments(pose))}"
    return _text(f"#!/bin/sh\n{hash_comment(facts)}exec {command}\n")


def _ros2_launch(pose: ExportPose) -> dict[str, bytes]:
    facts = pose.facts(_HOLDS, "xyzw, each named by its flag")
    arguments = tf2_arguments(pose)
    pairs = "".join(
        f"                {flag!r}, {value!r},\n"
        for flag, value in zip(arguments[::2], arguments[1::2], strict=True)
    )
    return _text(
        f"""{hash_comment(facts)}
from launch import LaunchDescription
from launch_ros.actions import Node


def generate_launch_description():
    return LaunchDescription([
        Node(
            package='tf2_ros',
            executable='static_transform_publisher',
            name={identifier(f"{pose.child}_calibration")!r},
            arguments=[
{pairs}            ],
        ),
    ])
"""
    )


def _ros1_command(pose: ExportPose) -> dict[str, bytes]:
    T = pose.T_parent_child
    facts = pose.facts(
        _HOLDS,
        "xyzw",
        "Order of the arguments: x y z qx qy qz qw parent child. With six numbers the same program",
        "reads x y z yaw pitch roll. The older package tf wants a period in ms at the end.",
    )
    arguments = [*numbers([*T[:3, 3], *quat_xyzw(T)]).split(), pose.parent, pose.child]
    command = f"rosrun tf2_ros static_transform_publisher {shlex.join(arguments)}"
    return _text(f"#!/bin/sh\n{hash_comment(facts)}exec {command}\n")


def _text(text: str) -> dict[str, bytes]:
    return {"": text.encode()}


EXPORTERS = (
    Exporter(
        "ros2",
        "ROS 2 command that publishes the static transform",
        ".ros2.sh",
        _ros2_command,
        takes_link=True,
    ),
    Exporter(
        "ros2-launch",
        "ROS 2 launch file that publishes the static transform",
        ".launch.py",
        _ros2_launch,
        takes_link=True,
    ),
    Exporter(
        "ros1",
        "ROS 1 command that publishes the static transform",
        ".ros1.sh",
        _ros1_command,
        takes_link=True,
    ),
)
