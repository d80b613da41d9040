"""The main table: error against the number of views, chosen one after the other.

`easyhecpp bench eye-to-hand` follows the published protocol: an arm before a camera on a tripod,
the first joint pose fixed beforehand, every further one chosen with the pose found so far. After
every view the camera is sought anew; the pose found before is only one more start.
"""

from __future__ import annotations

import time
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from easyhecpp.bench.metrics import PoseError
from easyhecpp.bench.scenes_pool import SCENE_FAILURES, RowFile, resumed
from easyhecpp.bench.stages import (
    MaskStage,
    PictureStage,
    Stage,
    arm_for_scenes,
    poses_for_any_camera,
)
from easyhecpp.errors import InputError
from easyhecpp.explore import METHODS, ExploreConfig, Knowledge, choose_next
from easyhecpp.sim.options import options_for
from easyhecpp.sim.possible_poses import PossiblePoses
from easyhecpp.sim.random_cell import cell_with_poses
from easyhecpp.sim.robots import load_robot
from easyhecpp.sim.studio import FULL, mitsuba, tracer
from easyhecpp.solve import PoseEstimate

F64 = NDArray[np.float64]

_RENEW_AFTER = 10


@dataclass(frozen=True)
class EyeToHandBench:
    """What is measured.

    Attributes:
        scenes: Their number.
        seed: Scene k depends on it and on k alone.
        views: Largest number of views.
        source: ``masks`` at the paper's IoU, or photo-real ``images`` alone.
        choose: Ways of choosing joint poses, each run on every scene.
        first: ``informative`` first joint pose, or ``zero`` as published.
        robot: The arm, by name.
        size: Of the pictures.
        samples: Light paths per pixel, for images.
        extra: Pictures for the background plate, for images.
    """

    scenes: int
    seed: int
    views: int = 5
    source: Literal["masks", "images"] = "masks"
    choose: tuple[str, ...] = ("information",)
    first: Literal["informative", "zero"] = "informative"
    robot: str = "xarm7"
    size: tuple[int, int] = (1280, 720)
    samples: int = FULL.samples
    extra: int = 4

    def settings(self) -> dict[str, Any]:
        """What decides a scene, however many there are."""
        values = asdict(self)
        del values["scenes"]
        if self.source == "masks":
            del values["samples"], values["extra"]
        else:
            values["tracer"] = tracer()
        return values


@dataclass(frozen=True)
class Step:
    """What is known after one more view.

    Attributes:
        scene: Number of the scene.
        choose: How joint poses are chosen.
        views: Number of views so far.
        position_mm, rotation_deg: Error; None where no pose was found.
        seconds: Of the calibration with these views.
        choosing_s: Of the choice of this view's joint pose; None for the first.
        blind: Whether the joint pose was one for an unknown camera.
        status: Of the optimiser, or the error's text.
    """

    scene: int
    choose: str
    views: int
    position_mm: float | None = None
    rotation_deg: float | None = None
    seconds: float = 0.0
    choosing_s: float | None = None
    blind: bool = False
    status: str = ""

    @property
    def error(self) -> PoseError | None:
        """Of the pose; None where there is none."""
        return PoseError.of(self.position_mm, self.rotation_deg)


def run_eye_to_hand(
    bench: EyeToHandBench,
    *,
    rows_file: Path | None = None,
    workers: int = 1,
    progress: Callable[[int, tuple[Step, ...]], None] | None = None,
) -> tuple[Step, ...]:
    """Calibrate scenes view by view, and compare with the truth.

    Args:
        bench: What is measured.
        rows_file: Keeps finished scenes; they are not done again.
        workers: Processes side by side; seconds are honest with one only.
        progress: Called with the number of finished scenes and the steps of the last.

    Raises:
        InputError: Nonsensical counts or names, or a file of other settings.
        MissingExtraError: The arms, or the path tracer, are not installed.
    """
    check_bench(bench)
    kept = RowFile(rows_file, bench.settings())
    return resumed(
        partial(scene_steps, bench, blind_poses(bench)),
        lambda row: Step(**row),
        bench.scenes,
        kept,
        workers=workers,
        # The path tracer keeps memory of its own: processes are replaced now and then.
        renew_after=_RENEW_AFTER if bench.source == "images" else None,
        progress=progress,
    )


def scene_steps(bench: EyeToHandBench, blind: F64, scene: int) -> tuple[Step, ...]:
    """All steps of one scene, with every way of choosing; an error is a step without a pose.

    Args:
        bench: What is measured.
        blind: See `blind_poses`.
        scene: Number of the scene.
    """
    steps: list[Step] = []
    for method in bench.choose:
        try:
            stage, joints = make_stage(bench, blind, scene)
        except SCENE_FAILURES as error:
            for n in range(1, bench.views + 1):
                steps.append(Step(scene, method, n, status=str(error)))
            continue
        steps += [step for step, _ in walk(stage, joints, bench.seed, scene, method)]
    return tuple(steps)


def walk(
    stage: Stage, blind: F64, seed: int, scene: int, method: str
) -> Iterator[tuple[Step, PoseEstimate | None]]:
    """Take views one after the other, each where the pose found so far says.

    Args:
        stage: What is calibrated.
        blind: Joint poses (views, n): the first one, and those for when no pose is known.
        seed: Of the benchmark.
        scene: Number of the scene.
        method: How joint poses are chosen.

    Yields:
        After each view, what is known, and the pose itself.
    """
    rng = np.random.default_rng([seed, scene, zlib.crc32(method.encode())])
    checker = PossiblePoses.of(stage.poses)
    config = ExploreConfig(method=method)  # pyright: ignore[reportArgumentType]  # it checks
    taken: list[F64] = []
    estimate: PoseEstimate | None = None
    for n, unknown in enumerate(blind, start=1):
        step, joints = Step(scene, method, n), unknown
        if n > 1:
            clock = time.perf_counter()
            chosen = _chosen(stage, estimate, taken, config, rng, checker)
            step = replace(step, choosing_s=time.perf_counter() - clock, blind=chosen is None)
            joints = unknown if chosen is None else chosen
        taken.append(joints)
        stage.look(joints)
        step, estimate = _estimated(stage, step)
        yield step, estimate


def _chosen(
    stage: Stage,
    estimate: PoseEstimate | None,
    taken: Sequence[F64],
    config: ExploreConfig,
    rng: np.random.Generator,
    checker: PossiblePoses,
) -> F64 | None:
    """The next joint pose, or None when no pose is known to choose with."""
    if estimate is None:
        return None
    try:
        known = Knowledge.of(estimate, taken)
        return choose_next(stage.rig, stage.camera, known, config, rng, checker=checker).joints
    except InputError:  # no joint pose suits, or the covariance is none; options were checked
        return None


def _estimated(stage: Stage, step: Step) -> tuple[Step, PoseEstimate | None]:
    clock = time.perf_counter()
    try:
        estimate = stage.estimate()
    except SCENE_FAILURES as error:
        return replace(step, seconds=time.perf_counter() - clock, status=str(error)), None
    error = PoseError.between(estimate.T_mount_cam, stage.T_mount_cam)
    step = replace(
        step,
        seconds=time.perf_counter() - clock,
        position_mm=error.position_mm,
        rotation_deg=error.rotation_deg,
        status=estimate.status,
    )
    return step, estimate


def make_stage(bench: EyeToHandBench, blind: F64, scene: int) -> tuple[Stage, F64]:
    """The stage of a scene, and those of the blind joint poses that are possible in it."""
    robot = load_robot(bench.robot)
    seed = [bench.seed, scene]
    if bench.source == "masks":
        stage = MaskStage.random(robot, bench.size, seed)
        return stage, blind
    width, height = bench.size
    options = replace(options_for("normal"), width=width, height=height)
    rng = np.random.default_rng(seed)
    cell, extra = cell_with_poses(bench.robot, rng, options, bench.extra)
    stage = PictureStage(cell, replace(FULL, samples=bench.samples), extra)
    # What stands on this table may be in the way of a joint pose.
    free = cell.poses.is_free(blind)
    return stage, np.where(free[:, None], blind, cell.random_joints(len(blind), rng))


def blind_poses(bench: EyeToHandBench) -> F64:
    """Joint poses (views, n) for an unknown camera: the same in all scenes of a benchmark."""
    poses = poses_for_any_camera(bench.robot, bench.size, bench.views, bench.seed)
    if bench.first == "zero":
        poses = np.concatenate([np.zeros_like(poses[:1]), poses[:-1]])
    return poses


def check_bench(bench: EyeToHandBench) -> None:
    """Look at everything that all scenes share, before the first one.

    Raises:
        InputError: Nonsensical counts or names, or an arm that cannot be used.
        MissingExtraError: The arms, or the path tracer, are not installed.
    """
    for name, value in (("scenes", bench.scenes), ("views", bench.views), ("spp", bench.samples)):
        if value < 1:
            raise InputError(f"{name} is {value}", expected="1 or more")
    unknown = [method for method in bench.choose if method not in METHODS]
    if unknown or not bench.choose:
        raise InputError(
            f"There is no way of choosing called {', '.join(unknown) or 'nothing'}",
            expected=f"one or more of {', '.join(METHODS)}",
        )
    if len(set(bench.choose)) < len(bench.choose):
        raise InputError(
            f"A way of choosing is named twice: {', '.join(bench.choose)}",
            expected="each of them once: scenes are counted by it",
        )
    arm_for_scenes(bench.robot)
    if bench.source == "images":
        mitsuba()
        if bench.extra < 2:
            raise InputError(
                f"extra is {bench.extra}", expected="2 or more: one view needs two others beside it"
            )
