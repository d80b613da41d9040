"""Reading a capture folder: everything that is there and everything that is wrong with it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from easyhecpp._paths import expanded, is_file, obstacle, reason
from easyhecpp.camera import Camera
from easyhecpp.capture._text import listing
from easyhecpp.capture.camera_info import parse_camera_info
from easyhecpp.capture.config import CONFIG_NAME, CaptureConfig, read_config
from easyhecpp.capture.joint_table import JointTable, read_joint_table
from easyhecpp.capture.joints import JointReader
from easyhecpp.capture.picture_files import PictureFiles
from easyhecpp.capture.pictures import check_depths, check_images, check_masks
from easyhecpp.capture.problems import Findings, Part, Problem
from easyhecpp.capture.view import View
from easyhecpp.errors import InputError
from easyhecpp.rig import Rig
from easyhecpp.robot import Robot
from easyhecpp.robot.resolve import FileFinder, told

_LAYOUT = (
    "camera_info.yaml, joints.csv, images/NNNN.png, robot/robot.urdf, and optionally "
    "capture.yaml, masks/ and depth/"
)


@dataclass(frozen=True)
class FolderContents:
    """What a capture folder holds.

    Attributes:
        root: The folder.
        config: Its settings.
        camera: Intrinsics, None when they could not be read.
        robot: The robot, None when it could not be read.
        views: Views with joints and pictures, without those that `findings` drop.
        findings: Everything that was wrong or had to be assumed.
        rig_errors: Those of the findings that left no camera or no robot.
    """

    root: Path
    config: CaptureConfig
    camera: Camera | None
    robot: Robot | None
    views: tuple[View, ...]
    findings: Findings
    rig_errors: tuple[Problem, ...]


def read_folder(folder: str | Path) -> FolderContents:
    """Read a capture folder as far as possible, collecting what is wrong.

    Raises:
        InputError: There is no such folder, it is empty, or its settings cannot be read, so that
            nothing else can be looked at.
    """
    root = _checked_root(Path(folder))
    config = read_config(root)
    findings = Findings()
    camera = _read_camera(root, config, findings)
    robot = _read_robot(root, config, findings)
    rig_errors = tuple(findings.errors)
    table: JointTable | None = None
    with findings.catching():
        table = read_joint_table(root / config.joints, findings)
    vectors: dict[str, NDArray[np.float64]] = {}
    if robot is not None and table is not None:
        vectors = JointReader(table, robot, config, findings).vectors()
    files = PictureFiles.find(root, config, findings)
    if table is not None:
        files.match(table, findings)
    bits = check_images(files.images, camera, findings)
    check_masks(files.masks, camera, findings)
    check_depths(files.depths, camera, findings)
    views = _views(vectors, files, bits, findings)
    return FolderContents(root, config, camera, robot, views, findings, rig_errors)


def _checked_root(root: Path) -> Path:
    try:
        entries = sorted(item for item in root.iterdir() if not item.name.startswith("."))
    except (FileNotFoundError, NotADirectoryError) as error:
        raise InputError(
            "This is not a folder" if is_file(root) else "There is no such capture folder",
            where=root,
            expected=f"a folder with {_LAYOUT}",
        ) from error
    except OSError as error:
        raise InputError(
            f"The capture folder cannot be listed: {reason(error)}", where=root
        ) from error
    if not entries:
        raise InputError(
            "The capture folder is empty", where=root, expected=f"a folder with {_LAYOUT}"
        )
    inner = [item.name for item in entries if is_file(item / "joints.csv")]
    if inner and not any(is_file(root / name) for name in ("joints.csv", CONFIG_NAME)):
        raise InputError(
            "This folder holds captures, it is none itself",
            where=root,
            expected=f"a folder with {_LAYOUT}",
            fix=f"Take one of {listing(inner)}",
        )
    return root


def _read_camera(root: Path, config: CaptureConfig, findings: Findings) -> Camera | None:
    with findings.catching():
        camera, notes = parse_camera_info(root / config.camera_info)
        for note in notes:
            findings.note(note, where=config.camera_info)
        return camera
    return None


def _read_robot(root: Path, config: CaptureConfig, findings: Findings) -> Robot | None:
    with findings.catching():
        robot = Robot.from_urdf(
            robot_path(root, config),
            package_dirs=config.package_paths(root),
            base_link=config.base_link,
            ignore_links=config.ignore_links,
            geometry=config.geometry,
        )
        for note in robot.notes:
            findings.note(note, where=config.robot)
        Rig(robot, config.setup, config.ee_link)
        return robot
    return None


def robot_path(root: Path, config: CaptureConfig) -> Path:
    """The file of a capture's robot.

    Raises:
        InputError: There is none.
    """
    if not config.robot.startswith("package://"):
        path = root / expanded(config.robot, f"{root / CONFIG_NAME}, robot")
        # What is there and may not be read is told by whoever reads it.
        if obstacle(path) is None and not is_file(path):
            raise InputError(
                "There is no robot description",
                where=path,
                expected="a .urdf or .xacro file",
                fix=f"Put it there, or name it in {CONFIG_NAME}: 'robot: FILE'",
            )
        return path
    finder = FileFinder(root / CONFIG_NAME, config.package_paths(root))
    found, tried = finder.find(config.robot)
    if found is None:
        raise InputError(
            f"There is no robot description '{config.robot}'; looked for at {told(tried)}",
            where=root / CONFIG_NAME,
            fix="Add the folder that holds the package to 'package_dirs'",
        )
    return found


def _views(
    vectors: Mapping[str, NDArray[np.float64]], files: PictureFiles, bits: int, findings: Findings
) -> tuple[View, ...]:
    """The views without what the errors drop."""
    dropped: dict[Part, set[str]] = {"view": set(), "mask": set(), "depth": set()}
    for problem in findings.errors:
        if problem.drops is not None:
            dropped[problem.drops].update(problem.views)
    return tuple(
        View(
            view,
            joints,
            files.images.get(view),
            None if view in dropped["mask"] else files.masks.get(view),
            None if view in dropped["depth"] else files.depths.get(view),
            image_bits=bits,
        )
        for view, joints in vectors.items()
        if view not in dropped["view"]
    )
