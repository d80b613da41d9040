"""The parts of a `result.json`, each of which checks itself; see `result_file` for the whole."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, model_validator

from easyhecpp.camera import Camera
from easyhecpp.errors import InputError
from easyhecpp.formats._checks import (
    DISTANCE_TOLERANCE,
    covariance_problems,
    quaternion_problems,
    rigid_problems,
)
from easyhecpp.geometry import inverse, quat_wxyz_from_matrix
from easyhecpp.solve.workspace import point_sigma_mm

Array = NDArray[np.float64]

TANGENT = "T_mount_cam @ exp([v, w])"
PIXEL_CENTRE = "an integer pixel coordinate is the centre of the pixel (OpenCV)"

Row3 = Annotated[tuple[FiniteFloat, ...], Field(min_length=3, max_length=3)]
Row4 = Annotated[tuple[FiniteFloat, ...], Field(min_length=4, max_length=4)]
Row6 = Annotated[tuple[FiniteFloat, ...], Field(min_length=6, max_length=6)]
NonNegative = Annotated[FiniteFloat, Field(ge=0.0)]
Share = Annotated[FiniteFloat, Field(ge=0.0, le=1.0)]


class Block(BaseModel):
    """An object in the file whose keys are all known."""

    # Unknown keys are refused: a misspelt key would otherwise be dropped without a word.
    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True)


class Transform(Block):
    """The pose of frame ``child`` in frame ``parent``: ``p_parent = matrix @ p_child``."""

    parent: str = Field(min_length=1)
    child: str = Field(min_length=1)
    xyz_m: Row3
    quat_wxyz: Row4
    matrix: Annotated[tuple[Row4, ...], Field(min_length=4, max_length=4)]

    @classmethod
    def from_matrix(cls, parent: str, child: str, T_parent_child: ArrayLike) -> Transform:
        """Make all three spellings from the ``(4, 4)`` matrix."""
        T = np.asarray(T_parent_child, dtype=np.float64) + 0.0  # + 0.0 turns -0.0 into 0.0
        return cls(
            parent=parent,
            child=child,
            xyz_m=tuple(T[:3, 3].tolist()),
            quat_wxyz=tuple((quat_wxyz_from_matrix(T[:3, :3]) + 0.0).tolist()),
            matrix=tuple(tuple(row) for row in T.tolist()),
        )

    @property
    def array(self) -> Array:
        """The ``(4, 4)`` matrix."""
        return np.array(self.matrix, dtype=np.float64)

    @model_validator(mode="after")
    def _parts_agree(self) -> Transform:
        problems = [
            f"the name of the {role} frame {name!r} holds characters that cannot be printed"
            for role, name in (("parent", self.parent), ("child", self.child))
            if not name.isprintable()
        ]
        T = self.array
        rigid = rigid_problems(T)
        problems += [f"matrix is not a rigid transform: {problem}" for problem in rigid]
        problems += quaternion_problems(self.quat_wxyz, None if rigid else T[:3, :3])
        apart = float(np.abs(T[:3, 3] - self.xyz_m).max())
        if apart > DISTANCE_TOLERANCE:
            problems.append(f"xyz_m and the matrix's last column differ by {apart:.3g} m")
        return raise_if(problems, self)


class Covariance(Block):
    """Uncertainty of ``T_mount_cam``: the covariance of ``[v, w]``, in metres and radians."""

    matrix: Annotated[tuple[Row6, ...], Field(min_length=6, max_length=6)]
    tangent: Literal["T_mount_cam @ exp([v, w])"] = TANGENT
    units: Literal["m and rad"] = "m and rad"

    @property
    def array(self) -> Array:
        """The ``(6, 6)`` matrix."""
        return np.array(self.matrix, dtype=np.float64)

    @model_validator(mode="after")
    def _is_covariance(self) -> Covariance:
        return raise_if(covariance_problems(self.array), self)


class Sigma(Block):
    """One standard deviation of the pose; each is the root of the variances' sum over the axes.

    ``position_mm`` and ``rotation_deg`` are those of the camera itself. ``workspace_mm`` is that of
    a point fixed in front of the camera as the mount sees it, at ``workspace_point_m`` (in the
    mount's frame): what a grasp there would suffer.
    """

    position_mm: NonNegative
    rotation_deg: NonNegative
    workspace_mm: NonNegative | None = None
    workspace_point_m: Row3 | None = None

    @classmethod
    def from_covariance(
        cls,
        T_mount_cam: ArrayLike,
        covariance: ArrayLike,
        workspace_point: Sequence[float] | None = None,
    ) -> Sigma:
        """Derive the numbers from the pose ``(4, 4)`` and its covariance ``(6, 6)``.

        Args:
            T_mount_cam: The pose.
            covariance: Of ``[v, w]`` in ``T_mount_cam @ exp([v, w])``, metres and radians.
            workspace_point: Point in the mount's frame, metres, or None for none.
        """
        C = np.asarray(covariance, dtype=np.float64)
        workspace_mm, point = None, None
        if workspace_point is not None:
            point = tuple(float(value) for value in workspace_point)
            p_cam = (inverse(T_mount_cam) @ np.append(point, 1.0))[:3]
            workspace_mm = point_sigma_mm(C, p_cam)
        return cls(
            position_mm=1e3 * float(np.sqrt(np.trace(C[:3, :3]))),
            rotation_deg=float(np.degrees(np.sqrt(np.trace(C[3:, 3:])))),
            workspace_mm=workspace_mm,
            workspace_point_m=point,
        )


class CameraBlock(Block):
    """The intrinsics that the pose was computed with, and holds for."""

    frame: str = Field(min_length=1)
    width: int = Field(gt=0)
    height: int = Field(gt=0)
    fx: Annotated[FiniteFloat, Field(gt=0.0)]
    fy: Annotated[FiniteFloat, Field(gt=0.0)]
    cx: FiniteFloat
    cy: FiniteFloat
    distortion_model: str = "none"
    distortion: tuple[FiniteFloat, ...] = ()
    pixel_convention: Literal["an integer pixel coordinate is the centre of the pixel (OpenCV)"] = (
        PIXEL_CENTRE
    )

    @classmethod
    def from_camera(cls, camera: Camera) -> CameraBlock:
        """Copy a `Camera`."""
        names = ("frame", "width", "height", "fx", "fy", "cx", "cy", "distortion_model")
        values = {name: getattr(camera, name) for name in names}
        return cls(**values, distortion=tuple(camera.distortion))

    def to_camera(self) -> Camera:
        """Return the `Camera`."""
        return Camera(**self.model_dump(exclude={"pixel_convention"}))

    @model_validator(mode="after")
    def _is_camera(self) -> CameraBlock:
        try:
            self.to_camera()
        except InputError as error:
            raise ValueError(str(error).rstrip(".")) from error
        return self


class RobotBlock(Block):
    """Which arm, and the links that exporters name."""

    name: str
    base_link: str = Field(min_length=1)
    ee_link: str | None = None


class RefinedParameter(Block):
    """A parameter that was refined together with the pose.

    On the user's wish, or where the outlines show it: ``k1`` and ``k2`` of a lens that nobody
    stated, zeros of joints, and ``sag``, see `Robot.sag`.
    """

    name: str = Field(min_length=1)
    correction: FiniteFloat
    sigma: NonNegative
    unit: Literal["relative", "px", "coefficient", "rad or m"]


class ViewResult(Block):
    """How one view took part. What a view without a fit cannot have is None."""

    id: str
    weight: NonNegative
    rms_px: NonNegative | None = None
    iou: Share | None = None
    prediction_px: NonNegative | None = None
    flags: tuple[str, ...] = ()


class LinkAgreement(Block):
    """How well colour, edges and kinematics agree along one link's outline in one view.

    ``edge`` and ``colour`` are shares of that outline: with an edge of the picture nearby, and
    where the picture differs from the background on the inside only. ``offset_px`` is how far out
    its edges lie in the median, None where it has none.
    """

    link: str = Field(min_length=1)
    score: Share
    edge: Share
    colour: Share
    offset_px: FiniteFloat | None = None
    length_px: NonNegative


class MaskResult(Block):
    """The mask of one view, ``score`` None when there is none, and how the links fare in it."""

    id: str
    score: Share | None = None
    notes: tuple[str, ...] = ()
    links: tuple[LinkAgreement, ...] = ()


def raise_if(problems: list[str], value: Any) -> Any:
    """Hand ``value`` on, or raise the ValueError that pydantic turns into its own."""
    if problems:
        raise ValueError("; ".join(problems))
    return value
