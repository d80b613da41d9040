"""Ours beside EasyHeC's optimiser: `easyhecpp bench adam`.

Same views, masks, start, renderer, threads and resolution. The start is as far off as the paper's
PVNet: the arm turned by 3.94 degrees about its middle and moved by 24 mm, in random directions.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from easyhecpp._optional import require
from easyhecpp._parallel import parallel_map
from easyhecpp.baselines.adam import (
    AdamConfig,
    AdamHistory,
    AdamSteps,
    calibrate_with_adam,
)
from easyhecpp.baselines.eq1 import Combine
from easyhecpp.bench.metrics import PoseError
from easyhecpp.bench.published import FIRST_POSE
from easyhecpp.bench.scenes_pool import SCENE_FAILURES, RowFile, resumed
from easyhecpp.bench.stages import MaskStage, arm_for_scenes
from easyhecpp.errors import InputError
from easyhecpp.geometry import exp_se3, inverse, perturb_about, transform_points
from easyhecpp.sim.robots import load_robot
from easyhecpp.solve import solve_pose

F64 = NDArray[np.float64]

START = FIRST_POSE[0]
"""How far off the start is."""

_TIMED = 40
_CURVE_POINTS = 24


@dataclass(frozen=True)
class AdamBench:
    """What is measured.

    Attributes:
        scenes: Their number.
        seed: Scene k depends on it and on k alone.
        views: Random views of each scene.
        steps: Of Adam.
        robot: The arm, by name.
        size: Of the masks.
        combine: How Adam's rendering puts links together, see `AdamConfig`; ours has the union.
        half_pixel: Whether Adam counts pixels as the published code does, see `AdamConfig`.
    """

    scenes: int
    seed: int
    views: int = 5
    steps: int = 1000
    robot: str = "xarm7"
    size: tuple[int, int] = (1280, 720)
    combine: Combine = "union"
    half_pixel: bool = False

    @property
    def config(self) -> AdamConfig:
        """Of Adam."""
        return AdamConfig(self.steps, combine=self.combine, half_pixel_bias=self.half_pixel)

    def settings(self) -> dict[str, Any]:
        """What decides a scene, however many there are."""
        values = asdict(self)
        del values["scenes"]
        return values


@dataclass(frozen=True)
class AdamRow:
    """One scene and one method.

    Attributes:
        scene: Its number.
        method: One of `METHODS`.
        position_mm, rotation_deg: Error; None where there is no pose.
        seconds: From the start to the pose.
        reached_s: Seconds until both of Adam's errors were first down to ours; None if never.
        step_ms, bare_ms: Median time of a step; of a forward and backward pass alone.
        curve_s, curve_mm: Seconds and error of some of the steps.
        status: Why there is no pose.
    """

    scene: int
    method: str
    position_mm: float | None = None
    rotation_deg: float | None = None
    seconds: float | None = None
    reached_s: float | None = None
    step_ms: float | None = None
    bare_ms: float | None = None
    curve_s: tuple[float, ...] = ()
    curve_mm: tuple[float, ...] = ()
    status: str = ""

    @property
    def error(self) -> PoseError | None:
        """Of the pose; None where there is none."""
        return PoseError.of(self.position_mm, self.rotation_deg)


OURS, LAST, BEST = "ours", "Adam, last step", "Adam, step of least loss"
METHODS = (OURS, LAST, BEST)


def run_adam_bench(
    bench: AdamBench,
    *,
    rows_file: Path | None = None,
    progress: Callable[[int, tuple[AdamRow, ...]], None] | None = None,
) -> tuple[AdamRow, ...]:
    """Refine the same start in both ways; one scene after the other, for times are compared.

    Args:
        bench: What is measured.
        rows_file: Keeps finished scenes; they are not done again.
        progress: Called with the number of finished scenes and the rows of the last.

    Raises:
        InputError: Nonsensical counts or names, or a file of other settings.
        MissingExtraError: torch, or the arms, are not installed.
    """
    for name, value in (("scenes", bench.scenes), ("views", bench.views), ("steps", bench.steps)):
        if value < 1:
            raise InputError(f"{name} is {value}", expected="1 or more")
    arm_for_scenes(bench.robot)
    require("torch", "models", "The Adam baseline")
    kept = RowFile(rows_file, bench.settings())
    return resumed(partial(adam_rows, bench), _row, bench.scenes, kept, progress=progress)


def adam_rows(bench: AdamBench, scene: int) -> tuple[AdamRow, ...]:
    """One scene, every method; an error of ours is a row without a pose."""
    _warm_up(bench)
    stage = _stage(bench, scene)
    start = _start(stage, np.random.default_rng([bench.seed, scene, 1]))
    ours = _our_row(stage, scene, start)
    _, history = calibrate_with_adam(
        stage.rig, stage.camera, stage.observations, start, bench.config
    )
    return ours, *_adam_rows(bench, stage, scene, history, ours.error)


def _stage(bench: AdamBench, scene: int) -> MaskStage:
    stage = MaskStage.random(load_robot(bench.robot), bench.size, [bench.seed, scene])
    for joints in stage.poses.draw(bench.views, np.random.default_rng([bench.seed, scene, 2])):
        stage.look(joints)
    return stage


def _start(stage: MaskStage, rng: np.random.Generator) -> F64:
    """T_mount_cam that is off as far as PVNet's."""
    T_cam_mount = inverse(stage.T_mount_cam)
    joints = np.stack([o.joints for o in stage.observations])
    middle = transform_points(T_cam_mount, stage.rig.robot.centre(joints).mean(axis=0))
    move, turn = (v / np.linalg.norm(v) for v in rng.standard_normal((2, 3)))
    delta = [*(START.position_mm / 1000.0 * move), *(np.deg2rad(START.rotation_deg) * turn)]
    return inverse(perturb_about(T_cam_mount, middle, delta))


def _our_row(stage: MaskStage, scene: int, start: F64) -> AdamRow:
    clock = time.perf_counter()
    try:
        T = solve_pose(stage.rig, stage.camera, stage.observations, start).T_mount_cam
    except SCENE_FAILURES as error:
        return AdamRow(scene, OURS, status=str(error))
    seconds = time.perf_counter() - clock
    error = PoseError.between(T, stage.T_mount_cam)
    return AdamRow(scene, OURS, error.position_mm, error.rotation_deg, seconds)


def _adam_rows(
    bench: AdamBench, stage: MaskStage, scene: int, history: AdamHistory, ours: PoseError | None
) -> tuple[AdamRow, AdamRow]:
    errors = [PoseError.between(T, stage.T_mount_cam) for T in history.Ts_mount_cam]
    seconds = history.seconds
    reached = [
        s
        for s, e in zip(seconds.tolist(), errors, strict=True)
        if ours is not None
        and e.position_mm <= ours.position_mm
        and e.rotation_deg <= ours.rotation_deg
    ]
    steps = np.unique(np.geomspace(1, len(history.losses), _CURVE_POINTS).round().astype(int))
    best = int(history.losses.argmin())
    last = AdamRow(
        scene,
        LAST,
        errors[-1].position_mm,
        errors[-1].rotation_deg,
        float(seconds[-1]),
        reached[0] if reached else None,
        *_costs_ms(bench, stage, history.Ts_mount_cam[0]),
        tuple(float(seconds[i]) for i in steps),
        tuple(errors[i].position_mm for i in steps),
    )
    return last, AdamRow(
        scene, BEST, errors[best].position_mm, errors[best].rotation_deg, float(seconds[-1])
    )


def _costs_ms(bench: AdamBench, stage: MaskStage, start: F64) -> tuple[float, float]:
    """Median times of a step, and of rendering, comparing and differentiating all views alone.

    Taken in turns, so that whatever else the machine does slows both.
    """
    adam = AdamSteps(stage.rig, stage.camera, stage.observations, start, bench.config)
    times = np.empty((_TIMED, 3))
    for row in times:
        T_cam_mount = exp_se3(adam.tangent)
        row[0] = time.perf_counter()
        parallel_map(lambda view, T=T_cam_mount: view(T), adam.views)
        row[1] = time.perf_counter()
        adam.step()
        row[2] = time.perf_counter()
    bare, step = 1e3 * np.median(np.diff(times), axis=0)
    return float(step), float(bare)


def _row(values: dict[str, Any]) -> AdamRow:
    """A row from a file, where tuples have become lists."""
    row = AdamRow(**values)
    return replace(row, curve_s=tuple(row.curve_s), curve_mm=tuple(row.curve_mm))


@lru_cache(maxsize=1)
def _warm_up(bench: AdamBench) -> None:
    """Code is loaded before anything is timed."""
    stage = _stage(bench, 0)
    solve_pose(stage.rig, stage.camera, stage.observations, stage.T_mount_cam)
    calibrate_with_adam(
        stage.rig,
        stage.camera,
        stage.observations,
        stage.T_mount_cam,
        replace(bench.config, steps=2),
    )
