"""A photo-real simulated cell: an arm, a camera and a room, with the exact truth.

cell = Cell.random("xarm7", np.random.default_rng(1))
views = cell.capture(cell.random_joints(5, np.random.default_rng(2)))
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from easyhecpp.camera import Camera
from easyhecpp.capture import View
from easyhecpp.errors import InputError
from easyhecpp.geometry import inverse
from easyhecpp.rig import Rig, rides_on_arm
from easyhecpp.robot import LinkMesh, Robot
from easyhecpp.sim.arm_surface import ArmSurface
from easyhecpp.sim.distractor import Distractor
from easyhecpp.sim.finishes import ArmLook, dress
from easyhecpp.sim.lens import plan_pinhole
from easyhecpp.sim.options import CellOptions, options_for
from easyhecpp.sim.poses import PoseSampler
from easyhecpp.sim.room import Surroundings
from easyhecpp.sim.sensor import Sensor, metered_gain
from easyhecpp.sim.studio import FULL, PREVIEW, Quality, Studio
from easyhecpp.sim.truth import Truth, TruthRenderer

F64 = NDArray[np.float64]

_METER_WIDTH = 160


@dataclass(frozen=True, eq=False)
class SimView:
    """One picture of the cell with its truth.

    Attributes:
        index: number of the picture; names the view and seeds its noise.
        joints: (n,) of the arm.
        image: (H, W, 3) uint8 sRGB.
        T_base_cam: (4, 4) where the camera was.
        cell: that it was taken in.
    """

    index: int
    joints: F64
    image: NDArray[np.uint8]
    T_base_cam: F64
    cell: Cell = field(repr=False)

    @cached_property
    def truth(self) -> Truth:
        """Exact coverage, links and depth; worked out at the first call."""
        return self.cell.truth(self.joints, index=self.index)

    @property
    def mask(self) -> NDArray[np.bool_]:
        """(H, W) exact mask of the visible arm."""
        return self.truth.mask

    def as_view(self) -> View:
        """The view as it stands in a capture, mask and depth exact."""
        name = f"{self.index:04d}"
        return View(name, self.joints, self.image, self.mask, self.truth.depth)


@dataclass
class _Stage:
    """What is costly to set up and does not depend on where the camera is."""

    studio: Studio | None = None
    gains: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Cell:
    """An arm, a camera and a room.

    Attributes:
        rig: the arm and the link that the camera is fixed to.
        camera: the intrinsics.
        T_mount_cam: (4, 4) the truth that calibration looks for.
        look: finishes of the arm.
        surroundings: the room.
        sensor: the camera's electronics.
        stand_z: height of the surface that the base stands on, base frame.
        seed: of all noise.
        distractor: a second arm, if there is one.
        min_visible: least share of the arm in view in random poses.
    """

    rig: Rig
    camera: Camera
    T_mount_cam: F64
    look: ArmLook
    surroundings: Surroundings
    sensor: Sensor
    stand_z: float
    seed: int
    distractor: Distractor | None = None
    min_visible: float = 0.7
    _stage: _Stage = field(default_factory=_Stage, repr=False)

    @classmethod
    def random(
        cls,
        robot: Robot | str,
        rng: np.random.Generator,
        *,
        difficulty: str = "normal",
        options: CellOptions | None = None,
    ) -> Cell:
        """Draw a plausible cell; the same generator state draws the same cell.

        Args:
            robot: a robot, a name that `easyhecpp.sim.robots.load_robot` knows, or a URDF's path.
            rng: all randomness comes from here.
            difficulty: ``easy``, ``normal``, ``anywhere`` (any camera) or ``hard`` (clutter, noise,
                a second arm).
            options: replaces the difficulty's options.

        Raises:
            InputError: unknown robot, difficulty or ee link.
            MissingExtraError: a robot by name without its data.
        """
        from easyhecpp.sim.random_cell import random_cell

        return random_cell(robot, rng, options_for(difficulty) if options is None else options)

    @property
    def robot(self) -> Robot:
        """The arm that matters."""
        return self.rig.robot

    def with_camera(
        self, T_mount_cam: ArrayLike | None = None, camera: Camera | None = None
    ) -> Cell:
        """The same cell with the camera elsewhere, or with another camera."""
        T = self.T_mount_cam if T_mount_cam is None else np.asarray(T_mount_cam, float)
        return replace(self, T_mount_cam=T, camera=camera or self.camera)

    def T_base_cam(self, joints: ArrayLike) -> F64:
        """(4, 4) where the camera is when the joints (n,) are there."""
        return self.robot.frame_pose(np.asarray(joints, float), self.rig.mount) @ self.T_mount_cam

    def random_joints(self, count: int, rng: np.random.Generator) -> F64:
        """Poses (count, n) in view of the camera and free of collisions.

        Raises:
            InputError: such poses are too rare.
        """
        return self.poses.draw(count, rng)

    def capture(
        self,
        joints: ArrayLike,
        *,
        quality: Quality | str = FULL,
        first_index: int = 0,
    ) -> list[SimView]:
        """Photograph the arm.

        Args:
            joints: (N, n) poses, or (n,) for one.
            quality: ``full``, ``preview`` or a `Quality`.
            first_index: number of the first picture; the number decides the noise.

        Returns:
            N views.

        Raises:
            MissingExtraError: Mitsuba is not installed.
        """
        poses = np.atleast_2d(np.asarray(joints, float))
        return [
            self._photograph(q, _quality(quality), first_index + k) for k, q in enumerate(poses)
        ]

    def truth(self, joints: ArrayLike, *, index: int = 0) -> Truth:
        """What the camera truly sees; needs no path tracer.

        Args:
            joints: (n,).
            index: number of the picture: a second arm may move from one to the next.
        """
        q = np.asarray(joints, float)
        T_cam_base = inverse(self.T_base_cam(q))
        poses = [T_cam_base @ self.robot.link_poses(q)]
        others = T_cam_base[None].repeat(self._n_still, axis=0)
        if self.distractor is not None:
            second = self.distractor.link_poses(self._second_joints(q, index))
            others = np.concatenate([T_cam_base @ second, others])
        return self._truth_renderer.render(poses[0], others)

    def light(self, joints: ArrayLike, quality: Quality, *, index: int = 0) -> NDArray[np.float32]:
        """(H, W, 3) linear radiance that reaches the sensor, before exposure and noise."""
        q = np.asarray(joints, float)
        poses = [self.robot.link_poses(q)]
        if self.distractor is not None:
            poses.append(self.distractor.link_poses(self._second_joints(q, index)))
        plan = plan_pinhole(self.camera)
        quality = replace(quality, samples=plan.samples(quality.samples))
        seed = int(np.random.SeedSequence([self.seed, index]).generate_state(1)[0])
        picture = self._studio.photograph(plan.pinhole, self.T_base_cam(q), poses, quality, seed)
        return plan.finish(picture)

    def _photograph(self, q: F64, quality: Quality, index: int) -> SimView:
        light = self.light(q, quality, index=index)
        rng = np.random.default_rng([self.seed, index, 1])
        image = self.sensor.develop(light, self._gain(light), rng)
        return SimView(index, q, image, self.T_base_cam(q), self)

    def _gain(self, light: NDArray[np.float32]) -> float:
        """Exposure: of each picture on the wrist, of the arm at rest for a camera that stands."""
        if rides_on_arm(self.rig.setup):
            return metered_gain(light, np.zeros(light.shape[:2], bool))
        key = f"{self.T_mount_cam.tobytes().hex()} {self.camera}"
        if key not in self._stage.gains:
            small = self.with_camera(camera=self.camera.scaled(_METER_WIDTH / self.camera.width))
            rest = self.robot.neutral
            seen = small.light(rest, replace(PREVIEW, samples=8))
            self._stage.gains[key] = metered_gain(seen, small.truth(rest).mask)
        return self._stage.gains[key]

    @property
    def _studio(self) -> Studio:
        if self._stage.studio is None:
            arms = [dress(self.robot, self.look)]
            feet = []
            if self.distractor is not None:
                arms.append(dress(self.distractor.robot, self.distractor.look))
                feet = [self.distractor.foot]
            self._stage.studio = Studio(self.surroundings, feet, arms)
        return self._stage.studio

    @cached_property
    def _truth_renderer(self) -> TruthRenderer:
        movable = [] if self.distractor is None else list(self.distractor.robot.meshes)
        return TruthRenderer(self.robot.meshes, [*movable, *self._still], self.camera)

    @cached_property
    def _still(self) -> list[LinkMesh]:
        room = self.surroundings
        surfaces = [p.surface for p in (*room.props, *room.panels)]
        if self.distractor is not None:
            surfaces.append(self.distractor.foot.surface)
        return [LinkMesh.from_triangles(s.vertices, s.faces) for s in surfaces]

    @property
    def _n_still(self) -> int:
        return len(self._still)

    @cached_property
    def poses(self) -> PoseSampler:
        """Draws joint poses that make sense here, and knows which do not."""
        boxes = [
            (prop.surface.vertices.min(axis=0), prop.surface.vertices.max(axis=0))
            for prop in self.surroundings.props
            if prop.name == "clutter"
        ]
        return PoseSampler(
            self.rig, self.camera, self.T_mount_cam, self.stand_z, boxes, self.min_visible
        )

    def _second_joints(self, q: F64, index: int) -> F64:
        assert self.distractor is not None
        points = ArmSurface.of(self.robot).in_base(q)
        return self.distractor.joints(index, points)


def _quality(value: Quality | str) -> Quality:
    if isinstance(value, Quality):
        return value
    known = {"full": FULL, "preview": PREVIEW}
    if value not in known:
        raise InputError(f"There is no picture quality {value!r}", expected=" or ".join(known))
    return known[value]
