"""Writing a capture folder, whole or not at all."""

from __future__ import annotations

import csv
import io
import os
import secrets
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

import numpy as np
import yaml

from easyhecpp._atomic import write_bytes, write_image, write_text
from easyhecpp.camera import Camera
from easyhecpp.capture._text import listing
from easyhecpp.capture.camera_info import camera_info_entries
from easyhecpp.capture.config import CONFIG_NAME, CaptureConfig, config_values, read_config
from easyhecpp.capture.folder import robot_path
from easyhecpp.capture.image_files import IMAGE_SUFFIXES
from easyhecpp.capture.joint_table import VIEW_COLUMN
from easyhecpp.capture.robot_copy import copy_robot
from easyhecpp.capture.view import View
from easyhecpp.errors import InputError
from easyhecpp.rig import Setup
from easyhecpp.robot import Robot

_MILLIMETRES_PER_METRE = 1000.0
_MAX_DEPTH = 65535


class CaptureLike(Protocol):
    """What a capture folder is written from; `Capture` is one."""

    @property
    def root(self) -> Path | None: ...  # noqa: D102
    @property
    def setup(self) -> Setup: ...  # noqa: D102
    @property
    def robot(self) -> Robot: ...  # noqa: D102
    @property
    def camera(self) -> Camera: ...  # noqa: D102
    @property
    def views(self) -> tuple[View, ...]: ...  # noqa: D102
    @property
    def ee_link(self) -> str | None: ...  # noqa: D102


@dataclass(frozen=True)
class RobotSource:
    """Where a capture's robot comes from.

    Attributes:
        path: `.urdf` or `.xacro` file.
        package_dirs: Folders that hold the packages of its `package://` names.
        ignore_links: Links whose geometry is not drawn.
        copy: Whether the capture gets a copy with all meshes; else `capture.yaml` names ``path``.
    """

    path: Path
    package_dirs: tuple[Path, ...] = ()
    ignore_links: tuple[str, ...] = ()
    copy: bool = True


def write_capture(
    folder: str | Path,
    capture: CaptureLike,
    *,
    robot: RobotSource | None = None,
    overwrite: bool = False,
) -> Path:
    """Write a capture folder that `Capture.load` reads back.

    Everything is written beside the folder first and then renamed, so that a reader never finds a
    part of it. Pictures that come from files are copied as they are; others become PNG.

    Args:
        folder: Where to; its parents are made.
        capture: What to write.
        robot: Where the robot comes from; by default from the folder that ``capture`` was read
            from.
        overwrite: Whether a folder that is there already may be replaced, with all it holds.

    Returns:
        The folder.

    Raises:
        InputError: The folder is there and not empty, cannot be written, or the views do not make
            a capture (names that are no file names, pictures for some views only).
    """
    target = Path(folder)
    source = robot or _source_of(capture)
    _check_target(target, source, overwrite)
    _check_views(capture.views)
    partial = target.with_name(f".{target.name}.{secrets.token_hex(6)}.tmp")
    try:
        _make(partial)
        _write_files(partial, target, capture, source)
        _put_in_place(partial, target)
    finally:
        shutil.rmtree(partial, ignore_errors=True)
    return target


def _source_of(capture: CaptureLike) -> RobotSource:
    if capture.root is None:
        raise InputError(
            "A capture made in memory does not know where its robot comes from",
            where="robot",
            expected="the path of the URDF",
            fix="Pass robot=RobotSource(path)",
        )
    config = read_config(capture.root)
    return RobotSource(
        robot_path(capture.root, config), config.package_paths(capture.root), config.ignore_links
    )


def _check_target(target: Path, source: RobotSource, overwrite: bool) -> None:
    if target.exists() and not target.is_dir():
        raise InputError("Cannot write a capture over a file", where=target)
    if target.is_dir() and any(target.iterdir()) and not overwrite:
        raise InputError(
            "The capture folder is there already and not empty",
            where=target,
            fix="Choose another name, or allow it to be overwritten",
        )
    if not source.copy and target.resolve() in source.path.resolve().parents:
        raise InputError(
            "The robot to refer to lies in the folder that is to be replaced",
            where=source.path,
            fix="Copy the robot instead",
        )


def _check_views(views: Sequence[View]) -> None:
    if not views:
        raise InputError("A capture without views cannot be written", expected="one view or more")
    bad = [
        view.id
        for view in views
        if view.id != Path(view.id).name
        or view.id.startswith(".")
        or view.id != view.id.strip()
        or view.id.lower().endswith(IMAGE_SUFFIXES)
    ]
    if bad:
        raise InputError(
            f"Views cannot be stored under the names {listing(map(repr, bad))}",
            expected="names of files without a suffix, such as 0007",
        )
    bare = [view.id for view in views if not view.has_image]
    if bare and (len(bare) < len(views) or not all(view.has_mask for view in views)):
        raise InputError(
            f"Views without an image: {listing(bare)}",
            expected="an image for every view, or masks for all of them",
        )


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True)
    except OSError as error:
        raise InputError(
            f"Cannot write into the folder: {error.strerror}",
            where=folder.parent,
            fix="Choose a folder that you may write to",
        ) from error


def _write_files(partial: Path, target: Path, capture: CaptureLike, source: RobotSource) -> None:
    config = CaptureConfig(
        setup=capture.setup,
        base_link=capture.robot.base_link,
        ee_link=capture.ee_link,
        ignore_links=source.ignore_links,
        geometry=capture.robot.geometry,
    )
    if source.copy:
        copy_robot(
            source.path,
            partial / config.robot,
            source.package_dirs,
            source.ignore_links,
            config.geometry,
        )
    else:
        config = replace(
            config,
            robot=_reference(source.path, target),
            package_dirs=tuple(str(folder.resolve()) for folder in source.package_dirs),
        )
    entries = yaml.safe_dump(config_values(config), sort_keys=False)
    write_text(partial / CONFIG_NAME, entries)
    write_text(
        partial / config.camera_info,
        yaml.safe_dump(camera_info_entries(capture.camera), sort_keys=False),
    )
    write_text(partial / config.joints, _joint_table(capture))
    for view in capture.views:
        _write_view(partial, config, view)


def _reference(robot: Path, target: Path) -> str:
    """The robot's path as `capture.yaml` should name it: relative if it lies beside the capture."""
    robot, beside = robot.resolve(), target.resolve().parent
    if beside in robot.parents:
        return os.path.relpath(robot, target.resolve())
    return str(robot)


def _joint_table(capture: CaptureLike) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([VIEW_COLUMN, *capture.robot.joint_names])
    for view in capture.views:
        writer.writerow([view.id, *(repr(float(value)) for value in view.joints)])
    return text.getvalue()


def _write_view(folder: Path, config: CaptureConfig, view: View) -> None:
    path, image = view.image_path, view.image
    if path is not None:
        write_bytes(folder / config.images / f"{view.id}{path.suffix.lower()}", path.read_bytes())
    elif image is not None:
        write_image(folder / config.images / f"{view.id}.png", image)
    if (mask := view.mask) is not None:
        write_image(folder / config.masks / f"{view.id}.png", mask)
    if (depth := view.depth) is not None:
        known = np.isfinite(depth) & (depth > 0)
        stored = np.rint(np.where(known, depth, 0.0) * _MILLIMETRES_PER_METRE)
        stored[stored > _MAX_DEPTH] = 0
        write_image(folder / config.depth / f"{view.id}.png", stored.astype(np.uint16))


def _put_in_place(partial: Path, target: Path) -> None:
    """Rename the finished folder; what was there goes only once the new one is in place."""
    if not target.exists():
        partial.rename(target)
        return
    old = target.with_name(f"{partial.name}.old")
    target.rename(old)
    try:
        partial.rename(target)
    except OSError:
        old.rename(target)
        raise
    shutil.rmtree(old, ignore_errors=True)
