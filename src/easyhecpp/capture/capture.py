"""A capture: a robot, a camera, and views of the one through the other."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

from easyhecpp.camera import Camera
from easyhecpp.capture._text import did_you_mean, listing
from easyhecpp.capture.folder import read_folder
from easyhecpp.capture.problems import joined_error
from easyhecpp.capture.view import View
from easyhecpp.errors import InputError
from easyhecpp.rig import Rig, Setup
from easyhecpp.robot import Robot


@dataclass(frozen=True, eq=False)
class Capture:
    """Everything that one calibration is computed from, immutable.

    Attributes:
        name: For reports; the folder's name when it was loaded from one.
        root: The folder, None for a capture made in memory.
        setup: `eye-to-hand` or `eye-in-hand`; only `Rig` asks which.
        robot: The arm.
        camera: The intrinsics.
        views: The views, ids unique, in the order of the table.
        ee_link: Link that an eye-in-hand camera rides on.
        notes: What a user should know about the input, sentences.

    Raises:
        InputError: Ids that are not unique, joints that are not the robot's, or pictures in memory
            that do not have the camera's size.
    """

    name: str
    root: Path | None
    setup: Setup
    robot: Robot
    camera: Camera
    views: tuple[View, ...]
    ee_link: str | None = None
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        ids = self.view_ids
        twice = sorted({view for view in ids if ids.count(view) > 1})
        if twice:
            raise InputError(f"View ids stand more than once: {listing(twice)}", where=self.name)
        for view in self.views:
            if len(view.joints) != self.robot.n_joints:
                raise InputError(
                    f"View '{view.id}' has {len(view.joints)} joint positions",
                    where=self.name,
                    expected=f"{self.robot.n_joints}: {', '.join(self.robot.joint_names)}",
                )
            view.check_size(self.camera.height, self.camera.width)

    @classmethod
    def load(cls, folder: str | Path, *, strict: bool = True) -> Capture:
        """Read a capture folder.

        Pictures are looked at but not kept: they are read when a view is asked for them.

        Args:
            folder: The folder; see the documentation for its layout.
            strict: Whether anything wrong with a single view is an error. If not, the view (or
                only its mask or depth) is left out, and the capture's notes say so.

        Raises:
            InputError: Anything wrong with the folder; several things are listed together.
        """
        contents = read_folder(folder)
        findings = contents.findings
        fatal = [p for p in findings.errors if strict or p.drops is None]
        if fatal or contents.camera is None or contents.robot is None:
            raise joined_error(fatal, contents.root)
        if not contents.views:
            raise joined_error(findings.errors, contents.root)
        return cls(
            name=contents.root.resolve().name,
            root=contents.root,
            setup=contents.config.setup,
            robot=contents.robot,
            camera=contents.camera,
            views=contents.views,
            ee_link=contents.config.ee_link,
            notes=tuple(f"Left out: {p}" for p in findings.errors) + findings.remarks,
        )

    @cached_property
    def rig(self) -> Rig:
        """The robot together with the link that the camera is fixed to."""
        return Rig(self.robot, self.setup, self.ee_link)

    @property
    def view_ids(self) -> tuple[str, ...]:
        """Ids of the views, in order."""
        return tuple(view.id for view in self.views)

    def view(self, id: str) -> View:  # noqa: A002
        """The view of that id.

        Raises:
            InputError: There is none.
        """
        for view in self.views:
            if view.id == id:
                return view
        raise InputError(
            f"The capture has no view '{id}'",
            where=self.name,
            expected=f"one of {listing(self.view_ids, limit=20)}",
            fix=did_you_mean(id, self.view_ids),
        )

    def subset(self, ids: Iterable[str]) -> Capture:
        """The capture of some views only, in the order of ``ids``.

        Raises:
            InputError: An id is unknown.
        """
        return replace(self, views=tuple(self.view(view) for view in ids))
