"""``easyhecpp export``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from easyhecpp.cli.output import say


@dataclass(frozen=True)
class Export:
    """Hand a result to what you run: ROS, MoveIt, MuJoCo, USD, SAPIEN, numpy and others."""

    result: Positional[Path]
    """The result.json."""

    target: Positional[str]
    """The consumer: ros2, ros2-launch, ros1, easy-handeye2, easy-handeye, urdf, json, npz, npy,
    opengl, mujoco, usd, isaaclab, sapien, droid, camera-info."""

    output: Path | None = None
    """File to write, or folder for one of the usual name. When left out, text is printed, and
    anything else is written into the current folder."""

    camera_name: str | None = None
    """What the consumer is to call the camera; its optical frame when left out."""

    camera_link: Path | None = None
    """YAML or JSON with the transform from the driver's camera_link to its optical frame: then the
    pose of camera_link is exported, as drivers publish the rest."""

    allow_failed: bool = False
    """Export the pose of a failed calibration all the same."""

    def run(self, command_line: str) -> int:
        """Write or print the export."""
        from easyhecpp.formats.exporters import CameraLink, export, render
        from easyhecpp.formats.result_file import ResultFile

        result = ResultFile.read(self.result)
        link = None if self.camera_link is None else CameraLink.read(self.camera_link)
        if self.output is None:
            parts = render(
                result,
                self.target,
                camera_name=self.camera_name,
                camera_link=link,
                allow_failed=self.allow_failed,
            )
            if len(parts) == 1 and _is_text(parts[""]):
                say(parts[""].decode().rstrip("\n"))
                return 0
        written = export(
            result,
            self.target,
            self.output,
            camera_name=self.camera_name,
            camera_link=link,
            allow_failed=self.allow_failed,
        )
        for path in written:
            say(f"written: {path}")
        return 0


def _is_text(data: bytes) -> bool:
    try:
        data.decode()
    except UnicodeDecodeError:
        return False
    return b"\0" not in data
