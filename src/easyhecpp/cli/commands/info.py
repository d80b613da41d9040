"""``easyhecpp info``."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from tyro.conf import Positional

from easyhecpp.cli.output import say, say_json
from easyhecpp.errors import InputError

_ROBOT_SUFFIXES = (".urdf", ".xacro")


@dataclass(frozen=True)
class Info:
    """Describe a robot (URDF, xacro), a capture folder or a result file."""

    path: Positional[Path]
    """A .urdf or .xacro file, a capture's folder, or a result.json."""

    package_dirs: tuple[Path, ...] = ()
    """For a robot: folders that hold the packages of package:// names."""

    ignore_links: tuple[str, ...] = ()
    """For a robot: links whose geometry is left out."""

    geometry: Literal["visual", "collision"] = "visual"
    """For a robot: which geometry is read. What a capture takes stands in its capture.yaml."""

    json: bool = False
    """Print as JSON."""

    def run(self, command_line: str) -> int:
        """Look at what the path is and describe it."""
        if self.path.suffix in _ROBOT_SUFFIXES:
            facts = self._robot()
        else:
            self._refuse_robot_options()
            facts = _describe(self.path)
        if self.json:
            say_json(facts)
        else:
            _show(facts)
        return 0

    def _robot(self) -> dict[str, Any]:
        from easyhecpp.robot import Robot, describe

        robot = Robot.from_urdf(
            self.path,
            package_dirs=self.package_dirs,
            ignore_links=self.ignore_links,
            geometry=self.geometry,
        )
        return {"robot": asdict(describe(robot))}

    def _refuse_robot_options(self) -> None:
        given = {
            "--package-dirs": self.package_dirs,
            "--ignore-links": self.ignore_links,
            "--geometry": self.geometry != "visual",
        }
        wrong = [name for name, value in given.items() if value]
        if wrong:
            raise InputError(
                f"{', '.join(wrong)} is for a robot description",
                where=self.path,
                expected="a .urdf or .xacro file",
                fix="Write the keys of these names into capture.yaml of a capture",
            )


def _describe(path: Path) -> dict[str, Any]:
    if path.suffix == ".json":
        from easyhecpp.formats.result_file import ResultFile

        result = ResultFile.read(path)
        return result.model_dump(mode="json", by_alias=True)
    from easyhecpp.capture import Capture
    from easyhecpp.robot import describe

    capture = Capture.load(path)
    camera = capture.camera
    return {
        "capture": {
            "name": capture.name,
            "setup": capture.setup,
            "views": list(capture.view_ids),
            "with images": sum(v.has_image for v in capture.views),
            "with masks": sum(v.has_mask for v in capture.views),
            "notes": list(capture.notes),
        },
        "camera": {
            "frame": camera.frame,
            "size": f"{camera.width}x{camera.height}",
            "fx fy cx cy": [camera.fx, camera.fy, camera.cx, camera.cy],
            "distortion": [camera.distortion_model, *camera.distortion],
        },
        "robot": asdict(describe(capture.robot)),
    }


def _show(facts: Any, indent: int = 0) -> None:
    pad = "  " * indent
    for key, value in facts.items():
        if isinstance(value, dict):
            say(f"{pad}{key}:")
            _show(value, indent + 1)
        elif isinstance(value, (list, tuple)) and value and isinstance(value[0], dict):
            say(f"{pad}{key}:")
            for item in value:
                say(f"{pad}  " + ", ".join(f"{k} {_plain(v)}" for k, v in item.items()))
        else:
            say(f"{pad}{key}: {_plain(value)}")


def _plain(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, (list, tuple)):
        return ", ".join(_plain(v) for v in value) or "none"
    return "none" if value is None else str(value)
