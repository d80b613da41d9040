"""`result.json`: the outcome of a calibration, with everything needed to judge and to use it.

The file is written by `ResultFile.write` and read by `ResultFile.read`; docs/result_format.md
describes every key. Reading checks that the parts agree with each other, since people do edit such
files by hand, and a wrong transform is worse than none.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import AwareDatetime, Field, ValidationError, field_serializer, model_validator

from easyhecpp import __version__
from easyhecpp._atomic import write_text
from easyhecpp.camera import Camera
from easyhecpp.errors import InputError
from easyhecpp.formats._checks import DISTANCE_TOLERANCE, ROTATION_TOLERANCE
from easyhecpp.formats._json_text import json_text, plain
from easyhecpp.formats._result_reading import check_schema, input_error, load_json
from easyhecpp.formats.result_blocks import (
    Block,
    CameraBlock,
    Covariance,
    MaskResult,
    NonNegative,
    RefinedParameter,
    RobotBlock,
    Sigma,
    Transform,
    ViewResult,
    raise_if,
)
from easyhecpp.geometry import inverse
from easyhecpp.rig import Setup, mount_frame, mount_link

__all__ = [
    "SCHEMA",
    "CameraBlock",
    "Covariance",
    "MaskResult",
    "Package",
    "RefinedParameter",
    "ResultFile",
    "RobotBlock",
    "Sigma",
    "Transform",
    "ViewResult",
]

Verdict = Literal["ok", "doubtful", "failed"]

SCHEMA = 1


class Package(Block):
    """What wrote the file."""

    name: Literal["easyhecpp"] = "easyhecpp"
    version: str = __version__


class ResultFile(Block):
    """Everything in a `result.json`. Make one with `build`, store with `write`, load with `read`.

    A ``failed`` result may lack the pose (both transforms None); any other has one.
    """

    schema_version: Literal[1] = Field(default=SCHEMA, alias="schema")
    package: Package = Package()
    command: str | None = None
    setup: Setup
    segmenter: str | None = None
    created: AwareDatetime
    verdict: Verdict
    reasons: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    T_mount_cam: Transform | None
    T_cam_mount: Transform | None
    covariance: Covariance | None = None
    sigma: Sigma | None = None
    camera: CameraBlock
    robot: RobotBlock
    refined: tuple[RefinedParameter, ...] = ()
    views: tuple[ViewResult, ...] = ()
    masks: tuple[MaskResult, ...] = ()
    timings_s: dict[str, NonNegative] = Field(default_factory=dict)
    config: dict[str, Any] = Field(default_factory=dict)

    @classmethod
    def build(
        cls,
        *,
        setup: Setup,
        robot: RobotBlock,
        camera: Camera,
        verdict: Verdict,
        T_mount_cam: ArrayLike | None,
        covariance: ArrayLike | None = None,
        workspace_point: Sequence[float] | None = None,
        reasons: Sequence[str] = (),
        notes: Sequence[str] = (),
        views: Sequence[ViewResult] = (),
        masks: Sequence[MaskResult] = (),
        refined: Sequence[RefinedParameter] = (),
        segmenter: str | None = None,
        command: str | None = None,
        timings_s: Mapping[str, float] | None = None,
        config: Any = None,
        created: datetime | None = None,
    ) -> ResultFile:
        """Assemble a result whose parts agree by construction.

        Args:
            setup: Decides whether the mount is ``robot.base_link`` or ``robot.ee_link``.
            robot: Names of the arm and its links.
            camera: Intrinsics used; ``camera.frame`` becomes the child frame.
            verdict: ``ok``, ``doubtful`` or ``failed``.
            T_mount_cam: ``(4, 4)`` pose, or None when a failed calibration has none.
            covariance: ``(6, 6)`` of ``[v, w]`` in ``T_mount_cam @ exp([v, w])``, m and rad.
            workspace_point: Point in the mount's frame at which to state the uncertainty, metres.
            reasons: Sentences behind the verdict.
            notes: What the user should know about how it was done, sentences.
            views: One entry a view that has a mask.
            masks: One entry a view, also where no mask could be made.
            refined: Intrinsics and joint zeros that were refined with the pose.
            segmenter: Where the masks came from.
            command: The exact command line.
            timings_s: Seconds by stage.
            config: Dataclass or mapping of settings; anything JSON cannot hold becomes text.
            created: Defaults to now.

        Raises:
            InputError: The parts do not form a valid result.
        """
        mount = mount_link(setup, robot.base_link, robot.ee_link)
        if mount is None:
            raise InputError("An eye-in-hand result needs the robot's ee_link")
        T = None if T_mount_cam is None else np.asarray(T_mount_cam, dtype=np.float64)
        C = None if covariance is None else np.asarray(covariance, dtype=np.float64)
        try:
            return cls(
                command=command,
                setup=setup,
                segmenter=segmenter,
                created=created or datetime.now(timezone.utc).replace(microsecond=0),
                verdict=verdict,
                reasons=tuple(reasons),
                notes=tuple(notes),
                T_mount_cam=None if T is None else Transform.from_matrix(mount, camera.frame, T),
                T_cam_mount=None
                if T is None
                else Transform.from_matrix(camera.frame, mount, inverse(T)),
                covariance=None
                if C is None
                else Covariance(matrix=tuple(tuple(row) for row in (0.5 * (C + C.T)).tolist())),
                sigma=None
                if C is None or T is None
                else Sigma.from_covariance(T, C, workspace_point),
                camera=CameraBlock.from_camera(camera),
                robot=robot,
                refined=tuple(refined),
                views=tuple(views),
                masks=tuple(masks),
                timings_s=dict(timings_s or {}),
                config=plain(config) if config is not None else {},
            )
        except ValidationError as error:
            raise input_error(error, where=None) from error

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> ResultFile:
        """Load and check a result file.

        Raises:
            InputError: The file is missing, not JSON, no result, of a newer schema, or its parts
                contradict each other; the text says which and where.
        """
        path = Path(path)
        data = load_json(path)
        check_schema(data, SCHEMA, path)
        try:
            return cls.model_validate(data)
        except ValidationError as error:
            raise input_error(error, where=path) from error

    def to_text(self) -> str:
        """Return the file's content."""
        return json_text(self.model_dump(mode="json", by_alias=True))

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write the file whole or not at all.

        Raises:
            InputError: The folder cannot be written.
        """
        write_text(path, self.to_text())

    @field_serializer("created")
    def _utc(self, created: datetime) -> str:
        return created.astimezone(timezone.utc).isoformat().replace("+00:00", "Z")

    @model_validator(mode="after")
    def _parts_agree(self) -> ResultFile:
        problems = [*self._pose_problems(), *self._name_problems()]
        if self.covariance is not None and self.T_mount_cam is None:
            problems.append("there is a covariance, but no pose that it could belong to")
        problems += self._sigma_problems()
        for what, ids in (
            ("view", [view.id for view in self.views]),
            ("the mask of view", [mask.id for mask in self.masks]),
        ):
            twice = sorted({i for i in ids if ids.count(i) > 1})
            problems += [f"{what} {i!r} is listed twice" for i in twice]
        return raise_if(problems, self)

    def _pose_problems(self) -> list[str]:
        forth, back = self.T_mount_cam, self.T_cam_mount
        if forth is None or back is None:
            if forth is not None or back is not None:
                return ["only one of T_mount_cam and T_cam_mount is given"]
            if self.verdict != "failed":
                return [f"the verdict is {self.verdict!r}, but there is no pose"]
            return []
        problems = []
        if (forth.parent, forth.child) != (back.child, back.parent):
            problems.append(
                f"T_cam_mount goes from {back.parent!r} to {back.child!r}, which is not "
                f"T_mount_cam ({forth.parent!r} to {forth.child!r}) turned round"
            )
        if forth.parent == forth.child:
            problems.append(f"parent and child are the same frame {forth.parent!r}")
        product = forth.array @ back.array
        # Rounded rotations act on the lever arm of the translation.
        room = DISTANCE_TOLERANCE + 2.0 * ROTATION_TOLERANCE * float(np.linalg.norm(forth.xyz_m))
        if np.abs(product - np.eye(4)).max() > room:
            problems.append("T_cam_mount is not the inverse of T_mount_cam")
        return problems

    def _name_problems(self) -> list[str]:
        if self.T_mount_cam is None:
            return []
        problems = []
        mount = mount_link(self.setup, self.robot.base_link, self.robot.ee_link)
        if self.T_mount_cam.parent != mount:
            link = f"robot.{mount_frame(self.setup)}_link"
            problems.append(
                f"T_mount_cam.parent is {self.T_mount_cam.parent!r}, but {link} is {mount!r} and "
                f"the setup is {self.setup}"
            )
        if self.T_mount_cam.child != self.camera.frame:
            problems.append(
                f"T_mount_cam.child is {self.T_mount_cam.child!r}, but camera.frame is "
                f"{self.camera.frame!r}"
            )
        return problems

    def _sigma_problems(self) -> list[str]:
        if self.sigma is None or self.covariance is None or self.T_mount_cam is None:
            return []
        expected = Sigma.from_covariance(
            self.T_mount_cam.array, self.covariance.array, self.sigma.workspace_point_m
        )
        return [
            f"sigma.{name} is {given:.4g}, but the covariance makes it {right:.4g}"
            for name in ("position_mm", "rotation_deg", "workspace_mm")
            if (given := getattr(self.sigma, name)) is not None
            and (right := getattr(expected, name)) is not None
            and abs(given - right) > 1e-3 * right + 1e-9
        ]
