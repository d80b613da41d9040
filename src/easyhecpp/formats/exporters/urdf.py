"""A fixed joint for URDF and xacro."""

from __future__ import annotations

from xml.sax.saxutils import quoteattr

from easyhecpp.formats.exporters._pose import (
    Exporter,
    ExportPose,
    euler_xyz,
    numbers,
    xml_comment,
)


def _urdf(pose: ExportPose) -> dict[str, bytes]:
    T = pose.T_parent_child
    facts = pose.facts(
        "T_parent_child",
        None,
        "rpy are the angles about the fixed axes x, y, z in turn: R = Rz(yaw) Ry(pitch) Rx(roll).",
        "Use: xacro:include this file in the robot's xacro, or copy link and joint into its URDF.",
        "Where the description already defines the child, delete the link and keep the joint.",
    )
    text = f"""<?xml version="1.0"?>
{xml_comment(facts)}<robot name={quoteattr(f"{pose.child}_mount")}>
  <link name={quoteattr(pose.child)}/>
  <joint name={quoteattr(f"{pose.child}_joint")} type="fixed">
    <parent link={quoteattr(pose.parent)}/>
    <child link={quoteattr(pose.child)}/>
    <origin xyz="{numbers(T[:3, 3])}" rpy="{numbers(euler_xyz(T[:3, :3]))}"/>
  </joint>
</robot>
"""
    return {"": text.encode()}


EXPORTERS = (
    Exporter(
        "urdf",
        "fixed joint for URDF or xacro",
        ".urdf.xacro",
        _urdf,
        takes_link=True,
    ),
)
