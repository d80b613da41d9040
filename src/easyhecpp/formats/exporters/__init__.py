"""Writing a result in the spelling of other systems.

    export(ResultFile.read("result.json"), "urdf", "camera.urdf.xacro")

docs/exporting.md lists the targets with direction, axes and quaternion order of each.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from easyhecpp._atomic import write_bytes
from easyhecpp.errors import InputError
from easyhecpp.formats.exporters import (
    arrays,
    camera_info,
    droid,
    easy_handeye,
    mujoco,
    ros,
    sapien,
    urdf,
    usd,
)
from easyhecpp.formats.exporters._pose import OPTICAL_AXES, Exporter, ExportPose
from easyhecpp.formats.exporters.camera_link import CameraLink
from easyhecpp.formats.result_file import ResultFile

__all__ = ["TARGETS", "CameraLink", "Exporter", "default_filename", "export", "render"]

_MODULES = (ros, easy_handeye, urdf, arrays, mujoco, usd, sapien, droid, camera_info)

TARGETS: Mapping[str, Exporter] = {
    exporter.name: exporter for module in _MODULES for exporter in module.EXPORTERS
}


def export(
    result: ResultFile,
    target: str,
    path: str | os.PathLike[str] | None = None,
    *,
    camera_name: str | None = None,
    camera_link: CameraLink | None = None,
    allow_failed: bool = False,
) -> tuple[Path, ...]:
    """Write the pose of ``result`` for one consumer, each file whole or not at all.

    Args:
        result: The calibration.
        target: A key of `TARGETS`.
        path: File, or folder for a file of the usual name; None means the working folder.
        camera_name: See `render`. Where the consumer finds the file by its name and none is given,
            the file's name is taken.
        camera_link: See `render`.
        allow_failed: See `render`.

    Returns:
        The files written, the main one first.

    Raises:
        InputError: See `render`; or the file cannot be written.
    """
    final = Path("." if path is None else path)
    if final.is_dir():
        final = final / default_filename(result, target, camera_name=camera_name)
    exporter = _exporter(target)
    if camera_name is None and exporter.name_is_stem:
        camera_name = final.name.removesuffix(exporter.suffix)
    files = render(
        result,
        target,
        camera_name=camera_name,
        camera_link=camera_link,
        allow_failed=allow_failed,
    )
    written = []
    for suffix, content in files.items():
        written.append(final.with_name(final.name + suffix))
        write_bytes(written[-1], content)
    return tuple(written)


def render(
    result: ResultFile,
    target: str,
    *,
    camera_name: str | None = None,
    camera_link: CameraLink | None = None,
    allow_failed: bool = False,
) -> dict[str, bytes]:
    """Return what `export` writes: content by what is appended to the file's name.

    Args:
        result: The calibration.
        target: A key of `TARGETS`.
        camera_name: What the consumer is to call the camera; the camera's frame when None.
        camera_link: Export the pose of this link, whose optical frame was calibrated, instead of
            the optical frame's.
        allow_failed: Export a result whose verdict is ``failed``.

    Raises:
        InputError: The target is unknown, cannot take the options or the set-up, or the result has
            no pose that should be used.
    """
    exporter = _exporter(target)
    if camera_name is not None and not (camera_name and camera_name.isprintable()):
        raise InputError(f"The camera name {camera_name!r} is empty or cannot be printed")
    pose = _pose(result, camera_name, allow_failed)
    if exporter.eye_to_hand_only and pose.mount_word != "base":
        raise InputError(
            f"Target {target!r} knows cameras beside the arm only, and this one rides on it"
        )
    if exporter.needs_name is not None and camera_name is None:
        raise InputError(
            f"Target {target!r} needs a camera name",
            expected=exporter.needs_name,
        )
    if camera_link is not None:
        if not exporter.takes_link:
            raise InputError(
                f"Target {target!r} places the camera itself, not the link of a driver",
                expected="no camera link, or one of the targets "
                + ", ".join(name for name, item in TARGETS.items() if item.takes_link),
            )
        pose = _moved_to_link(pose, camera_link)
    return dict(exporter.render(pose))


def default_filename(result: ResultFile, target: str, *, camera_name: str | None = None) -> str:
    """Return the file name that `export` uses where it is given a folder."""
    name = camera_name or result.camera.frame
    safe = "".join(c if (c.isascii() and c.isalnum()) or c in "-_." else "_" for c in name)
    return safe + _exporter(target).suffix


def _exporter(target: str) -> Exporter:
    if target not in TARGETS:
        raise InputError(f"Unknown export target {target!r}", expected=", ".join(TARGETS))
    return TARGETS[target]


def _pose(result: ResultFile, camera_name: str | None, allow_failed: bool) -> ExportPose:
    if result.T_mount_cam is None:
        raise InputError("The calibration failed and has no pose to export")
    if result.verdict == "failed" and not allow_failed:
        raise InputError(
            "The calibration's verdict is failed; its pose is not to be used",
            fix="See its reasons; allow_failed (--allow-failed) exports it all the same",
        )
    return ExportPose(
        T_parent_child=result.T_mount_cam.array,
        parent=result.T_mount_cam.parent,
        child=result.T_mount_cam.child,
        child_axes=OPTICAL_AXES,
        setup=result.setup,
        camera=result.camera.to_camera(),
        camera_name=camera_name or result.camera.frame,
        base_link=result.robot.base_link,
        ee_link=result.robot.ee_link,
        origin=_origin(result),
        created=result.created,
    )


def _origin(result: ResultFile) -> tuple[str, ...]:
    lines = [
        f"Camera pose by easyhecpp {result.package.version}, {result.setup}, calibrated "
        f"{result.created:%Y-%m-%d %H:%M:%S %Z}; verdict: {result.verdict}"
    ]
    if result.verdict != "ok":
        lines += [f"  {' '.join(reason.split())}" for reason in result.reasons]
    if result.sigma is not None:
        lines.append(
            f"standard deviation: {result.sigma.position_mm:.3g} mm, "
            f"{result.sigma.rotation_deg:.3g} deg"
        )
    return tuple(lines)


def _moved_to_link(pose: ExportPose, link: CameraLink) -> ExportPose:
    return replace(
        pose,
        T_parent_child=link.pose_of(pose.T_parent_child, pose.child),
        child=link.frame,
        child_axes="axes as its driver defines them, usually +X forward, +Y left, +Z up",
        origin=(
            *pose.origin,
            f"calibrated was {pose.child}; the link's pose follows from the link-to-optical "
            "transform given",
        ),
    )
