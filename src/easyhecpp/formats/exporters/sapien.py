"""A pose for SAPIEN and ManiSkill, whose cameras look along +X."""

from __future__ import annotations

from easyhecpp.formats.exporters._pose import (
    BODY_AXES,
    T_CAM_CAMBODY,
    Exporter,
    ExportPose,
    hash_comment,
    number,
    numbers,
    quat_wxyz,
)


def _sapien(pose: ExportPose) -> dict[str, bytes]:
    camera = pose.camera
    T = pose.T_parent_child @ T_CAM_CAMBODY
    facts = pose.facts(
        f"the camera's pose in the parent, in {BODY_AXES}",
        "wxyz",
        "INTRINSIC is measured from the image's edge, as SAPIEN does: OpenCV's cx and cy plus 0.5.",
        "ManiSkill: CameraConfig(uid, pose=POSE, width=WIDTH, height=HEIGHT, near=..., far=...,",
        "    intrinsic=np.array(INTRINSIC), mount=<the parent link, where it is not the world>)",
        *pose.lens_facts(),
    )
    text = f"""{hash_comment(facts)}
import sapien

PARENT_FRAME = {pose.parent!r}
CHILD_FRAME = {pose.child!r}
POSE = sapien.Pose(
    p=[{numbers(T[:3, 3], ", ")}],
    q=[{numbers(quat_wxyz(T), ", ")}],
)
WIDTH, HEIGHT = {camera.width}, {camera.height}
INTRINSIC = [
    [{number(camera.fx)}, 0.0, {number(camera.cx + 0.5)}],
    [0.0, {number(camera.fy)}, {number(camera.cy + 0.5)}],
    [0.0, 0.0, 1.0],
]
"""
    return {"": text.encode()}


EXPORTERS = (
    Exporter(
        "sapien", "Python pose and intrinsics for SAPIEN and ManiSkill", ".sapien.py", _sapien
    ),
)
