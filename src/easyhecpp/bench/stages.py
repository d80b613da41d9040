"""What is calibrated step by step: an arm that is told where to go, and what is seen of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from easyhecpp.bench.metrics import PoseError
from easyhecpp.camera import Camera
from easyhecpp.errors import CalibrationError
from easyhecpp.explore import first_joint_poses
from easyhecpp.explore.candidates import joint_ranges
from easyhecpp.initialise import sample_initial_pose
from easyhecpp.rig import Rig
from easyhecpp.robot import Robot
from easyhecpp.segment.classical import ClassicalSegmenter
from easyhecpp.segment.classical.first_pose import FINAL_TOLERANCE
from easyhecpp.segment.classical.search import PairScore, Scored
from easyhecpp.segment.edges import refine_edges
from easyhecpp.sim.cell import Cell
from easyhecpp.sim.masks import Degradation, degrade_masks
from easyhecpp.sim.options import CellOptions
from easyhecpp.sim.placement import random_camera, tripod_camera
from easyhecpp.sim.poses import PoseSampler
from easyhecpp.sim.possible_poses import PossiblePoses
from easyhecpp.sim.random_cell import stand_height
from easyhecpp.sim.robots import load_robot
from easyhecpp.sim.scenes import SimScene
from easyhecpp.sim.studio import Quality
from easyhecpp.solve import Observation, PoseEstimate, solve_pose

F64 = NDArray[np.float64]


_STARTS = 2
_NEAR_MM, _NEAR_DEG = 30.0, 3.0


class Stage(Protocol):
    """A camera to be calibrated while views come in."""

    @property
    def rig(self) -> Rig:
        """The arm."""
        ...

    @property
    def camera(self) -> Camera:
        """The intrinsics."""
        ...

    @property
    def T_mount_cam(self) -> F64:
        """(4, 4) the truth."""
        ...

    @property
    def poses(self) -> PoseSampler:
        """Which joint poses are possible here."""
        ...

    @property
    def extra_views(self) -> int:
        """Pictures beyond those that the pose rests on."""
        ...

    def look(self, joints: F64) -> None:
        """Move the arm to (n,) and take a view."""
        ...

    def estimate(self) -> PoseEstimate:
        """The camera's pose from the views so far, with no initial guess.

        Raises:
            EasyHecError: It cannot be found.
        """
        ...


def arm_for_scenes(name: str) -> Robot:
    """An arm whose joint poses can be drawn: asked for before the first scene.

    Args:
        name: Of a built-in arm, or the path of a URDF.

    Raises:
        InputError: No such arm, anything wrong with its file, or joint limits that mean nothing.
        MissingExtraError: The arms are not installed.
    """
    robot = load_robot(name)
    joint_ranges(robot)
    return robot


def poses_for_any_camera(robot: str, size: tuple[int, int], count: int, seed: int) -> F64:
    """Joint poses (count, n) that tell much wherever the camera stands, above the table."""
    stage = MaskStage.random(load_robot(robot), size, [seed])
    return first_joint_poses(
        stage.rig.robot,
        stage.camera,
        count,
        np.random.default_rng(seed),
        checker=PossiblePoses.of(stage.poses),
    )


@dataclass
class MaskStage:
    """Masks as a segmenter would make them: exact ones whose boundaries wander.

    Args:
        rig: The arm.
        camera: The intrinsics.
        T_mount_cam: (4, 4) the truth.
        degradation: How far the boundaries wander.
        rng: Draws the wandering.
    """

    rig: Rig
    camera: Camera
    T_mount_cam: F64
    degradation: Degradation
    rng: np.random.Generator
    extra_views: int = 0
    observations: list[Observation] = field(default_factory=list)
    found: F64 | None = None

    @classmethod
    def random(cls, robot: Robot, size: tuple[int, int], seed: Sequence[int]) -> MaskStage:
        """A camera on a tripod beside an arm on a table, as in the published scenes."""
        rng = np.random.default_rng(seed)
        options = CellOptions()
        camera = random_camera(rng, *size)
        T_base_cam = tripod_camera(
            rng,
            robot,
            stand_height(robot),
            azimuth_deg=options.azimuth_deg,
            elevation_deg=options.elevation_deg,
            distance=options.distance,
        )
        return cls(Rig(robot), camera, T_base_cam, Degradation(), rng)

    @property
    def poses(self) -> PoseSampler:
        """Poses above the table."""
        floor = stand_height(self.rig.robot)
        return PoseSampler(self.rig, self.camera, self.T_mount_cam, floor, (), 0.7)

    def look(self, joints: F64) -> None:
        """Take a mask."""
        scene = SimScene(self.rig.robot, self.camera, self.T_mount_cam, joints[None])
        mask = degrade_masks([scene.coverage(0)], self.rng, self.degradation).masks[0]
        self.observations.append(Observation(joints, mask, id=str(len(self.observations))))

    def estimate(self) -> PoseEstimate:
        """First poses by sampling, then the optimiser; the pose found before is a start too.

        One or two views may look alike from two sides: whichever explains the masks best wins.
        """
        seen = [o for o in self.observations if o.mask.any()]
        if not seen:
            raise CalibrationError("The arm is in no picture.")
        first = sample_initial_pose(self.rig, self.camera, seen)
        starts = [T for T, _ in first.candidates[:_STARTS]]
        if self.found is not None:
            starts = [self.found, *(T for T in starts if not _near(T, self.found))]
        estimates = [solve_pose(self.rig, self.camera, seen, T) for T in starts]
        best = max(estimates, key=lambda e: float(np.mean([v.iou for v in e.views])))
        self.found = best.T_mount_cam
        return best


@dataclass
class PictureStage:
    """Photo-real pictures, the classical way of finding the arm in them, and its edges.

    The pose rests on the outlines of the views that were asked for. Extra pictures, taken first,
    help to tell the background, and to find the arm at all.

    Args:
        cell: The cell.
        quality: Of the pictures.
        extra: Joint poses (P, n) of the extra pictures.
    """

    cell: Cell
    quality: Quality
    extra: F64
    images: list[NDArray[np.uint8]] = field(default_factory=list)
    joints: list[F64] = field(default_factory=list)
    found: F64 | None = None

    def __post_init__(self) -> None:
        for joints in self.extra:
            self.look(joints)

    @property
    def rig(self) -> Rig:
        """The arm."""
        return self.cell.rig

    @property
    def camera(self) -> Camera:
        """The intrinsics."""
        return self.cell.camera

    @property
    def T_mount_cam(self) -> F64:
        """(4, 4) the truth."""
        return self.cell.T_mount_cam

    @property
    def poses(self) -> PoseSampler:
        """Poses above the table, between the things on it."""
        return self.cell.poses

    @property
    def extra_views(self) -> int:
        """Number of extra pictures."""
        return len(self.extra)

    def look(self, joints: F64) -> None:
        """Take a picture."""
        view = self.cell.capture(joints, quality=self.quality, first_index=len(self.images))[0]
        self.images.append(view.image)
        self.joints.append(joints)

    def estimate(self) -> PoseEstimate:
        """Find the arm in all pictures, then fit the outlines of those that count."""
        ids = [str(i) for i in range(len(self.images))]
        count = [i >= self.extra_views for i in range(len(self.images))]
        segmenter = ClassicalSegmenter(self.rig, self.camera, self.images, self.joints, ids=ids)
        T = segmenter.settle(self._candidates(segmenter))[0].T_mount_cam
        masks = [
            mask if counts else replace(mask, mask=None)
            for mask, counts in zip(segmenter.masks_at(T), count, strict=True)
        ]
        start = segmenter.solve(T, masks)
        weights = [float(counts) for counts in count]
        T = start.T_mount_cam
        backgrounds = segmenter.backgrounds(T)
        found = refine_edges(backgrounds, start, ids=ids, weights=weights).estimate
        self.found = found.T_mount_cam
        return found

    def _candidates(self, segmenter: ClassicalSegmenter) -> list[Scored]:
        """First poses, best first; the pose found before is one of them."""
        if self.found is None:
            return segmenter.first_pose()
        score = PairScore(segmenter.scene, segmenter.changes, FINAL_TOLERANCE)
        before = Scored(self.found, score(self.found))
        try:
            return sorted([before, *segmenter.first_pose()], key=lambda s: -s.score)
        except CalibrationError:
            return [before]


def _near(T_a_cam: F64, T_a_other: F64) -> bool:
    """Whether two starts lead to the same pose."""
    apart = PoseError.between(T_a_cam, T_a_other)
    return apart.position_mm < _NEAR_MM and apart.rotation_deg < _NEAR_DEG
