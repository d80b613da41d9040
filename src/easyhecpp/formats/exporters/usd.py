"""A USD stage with the camera, and the pose for Isaac Lab's configuration."""

from __future__ import annotations

import json

from easyhecpp.formats.exporters._pose import (
    BODY_AXES,
    GL_AXES,
    OPTICAL_AXES,
    T_CAM_CAMBODY,
    T_CAM_CAMGL,
    Exporter,
    ExportPose,
    hash_comment,
    identifier,
    number,
    numbers,
    quat_wxyz,
    quat_xyzw,
)

# Width of the film in tenths of a scene unit. Only its ratio to the focal length matters.
_FILM = 36.0


def _usd(pose: ExportPose) -> dict[str, bytes]:
    camera = pose.camera
    T = pose.T_parent_child @ T_CAM_CAMGL
    pixel_x = _FILM / camera.width
    focal = camera.fx * pixel_x
    pixel_y = focal / camera.fy
    # USD moves the film window right and up by the offsets. The image's middle lies half a pixel
    # before OpenCV's width / 2, since integer coordinates are pixel centres there.
    offset_x = (0.5 * (camera.width - 1) - camera.cx) * pixel_x
    offset_y = (camera.cy - 0.5 * (camera.height - 1)) * pixel_y
    facts = pose.facts(
        f"the camera's pose in the parent, in {GL_AXES}",
        "wxyz",
        f"Resolution: {camera.width} x {camera.height}, which USD keeps in the render settings.",
        "Omniverse renders square pixels only and, in some versions, ignores the aperture offsets.",
        *pose.lens_facts(),
    )
    text = f"""#usda 1.0
{hash_comment(facts)}(
    defaultPrim = "{identifier(pose.parent)}"
    metersPerUnit = 1
    upAxis = "Z"
)

def Xform "{identifier(pose.parent)}" (
    customData = {{
        string frame = {json.dumps(pose.parent, ensure_ascii=False)}
    }}
)
{{
    def Camera "{identifier(pose.camera_name)}" (
        customData = {{
            string frame = {json.dumps(pose.child, ensure_ascii=False)}
        }}
    )
    {{
        float2 clippingRange = (0.01, 1000)
        float focalLength = {number(focal)}
        float horizontalAperture = {number(_FILM)}
        float horizontalApertureOffset = {number(offset_x)}
        token projection = "perspective"
        float verticalAperture = {number(camera.height * pixel_y)}
        float verticalApertureOffset = {number(offset_y)}
        quatd xformOp:orient = ({numbers(quat_wxyz(T), ", ")})
        double3 xformOp:translate = ({numbers(T[:3, 3], ", ")})
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:orient"]
    }}
}}
"""
    return {"": text.encode()}


def _isaaclab(pose: ExportPose) -> dict[str, bytes]:
    facts = pose.facts(
        "the camera's pose in the parent, once for each of Isaac Lab's conventions",
        "given in both orders: Isaac Lab 1 and 2 want wxyz, Isaac Lab 3 and later xyzw",
        "Use: CameraCfg(prim_path='.../<parent>/<camera>',",
        "    offset=CameraCfg.OffsetCfg(pos=POS, rot=ROT_WXYZ['ros'], convention='ros'), ...)",
        *pose.lens_facts(),
    )
    T = pose.T_parent_child
    turned = (
        ("ros", OPTICAL_AXES, T),
        ("opengl", GL_AXES, T @ T_CAM_CAMGL),
        ("world", BODY_AXES, T @ T_CAM_CAMBODY),
    )
    wxyz = "".join(f"    {k!r}: ({numbers(quat_wxyz(A), ', ')}),  # {a}\n" for k, a, A in turned)
    xyzw = "".join(f"    {k!r}: ({numbers(quat_xyzw(A), ', ')}),  # {a}\n" for k, a, A in turned)
    text = f"""{hash_comment(facts)}
PARENT_FRAME = {pose.parent!r}
CHILD_FRAME = {pose.child!r}
POS = ({numbers(T[:3, 3], ", ")})
ROT_WXYZ = {{
{wxyz}}}
ROT_XYZW = {{
{xyzw}}}
"""
    return {"": text.encode()}


EXPORTERS = (
    Exporter("usd", "USD stage with the camera (Isaac Sim, Blender, Omniverse)", ".usda", _usd),
    Exporter("isaaclab", "Python constants for Isaac Lab's CameraCfg", ".isaaclab.py", _isaaclab),
)
