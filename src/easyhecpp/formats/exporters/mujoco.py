"""A camera for MuJoCo's XML.

MuJoCo's pixel coordinates begin at the image's edge, and ``principalpixel`` is the offset of the
image's middle from the principal point. Checked against MuJoCo's own frustum (see the tests).
"""

from __future__ import annotations

from xml.sax.saxutils import quoteattr

from easyhecpp.formats.exporters._pose import (
    GL_AXES,
    T_CAM_CAMGL,
    Exporter,
    ExportPose,
    number,
    numbers,
    quat_wxyz,
    xml_comment,
)

# The sensor's size only fixes a scale that cancels out: one pixel is one micrometre.
_PIXELS_PER_M = 1e6


def _mujoco(pose: ExportPose) -> dict[str, bytes]:
    camera = pose.camera
    T = pose.T_parent_child @ T_CAM_CAMGL
    principal = (0.5 * (camera.width - 1) - camera.cx, 0.5 * (camera.height - 1) - camera.cy)
    facts = pose.facts(
        f"the camera's pose in the parent, in {GL_AXES}",
        "wxyz",
        "Use: <include file=.../> inside the body of the parent frame, or copy the camera there.",
        "principalpixel is for MuJoCo 3.6 and later; before, its second number had the other sign.",
        "The sensor camprojection ignores it. The interactive viewer ignores all intrinsics.",
        *pose.lens_facts(),
    )
    size = numbers([camera.width / _PIXELS_PER_M, camera.height / _PIXELS_PER_M])
    text = f"""<mujocoinclude>
{xml_comment(facts, "  ")}  <camera name={quoteattr(pose.camera_name)}
          pos="{numbers(T[:3, 3])}"
          quat="{numbers(quat_wxyz(T))}"
          resolution="{camera.width} {camera.height}"
          sensorsize="{size}"
          focalpixel="{number(camera.fx)} {number(camera.fy)}"
          principalpixel="{numbers(principal)}"/>
</mujocoinclude>
"""
    return {"": text.encode()}


EXPORTERS = (Exporter("mujoco", "camera element for MuJoCo's XML", ".mujoco.xml", _mujoco),)
