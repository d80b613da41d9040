"""The first pose, with no guess at all: `easyhecpp bench init`.

The arm is driven to a few joint poses that are fixed beforehand; their masks, at the paper's IoU,
are explained by sampled viewpoints; then the pose is refined on the same masks.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from easyhecpp.bench.metrics import PoseError, summarise
from easyhecpp.bench.plots import cumulative_plot
from easyhecpp.bench.published import FIRST_POSE
from easyhecpp.bench.scenes_pool import SCENE_FAILURES, RowFile, resumed
from easyhecpp.bench.stages import MaskStage, arm_for_scenes, poses_for_any_camera
from easyhecpp.bench.table import Cell, Table, describe_machine, failure_notes, machine_sentence
from easyhecpp.errors import InputError
from easyhecpp.initialise import SamplingConfig, sample_initial_pose
from easyhecpp.sim.robots import load_robot
from easyhecpp.solve import solve_pose

F64 = NDArray[np.float64]
Grid = Literal["sphere", "paper"]

GRIDS: tuple[Grid, ...] = ("sphere", "paper")


@dataclass(frozen=True)
class InitBench:
    """What is measured.

    Attributes:
        scenes: Their number.
        seed: Scene k depends on it and on k alone.
        views: Joint poses that the arm is driven to.
        robot: The arm, by name.
        size: Of the masks.
    """

    scenes: int
    seed: int
    views: int = 5
    robot: str = "xarm7"
    size: tuple[int, int] = (1280, 720)

    def settings(self) -> dict[str, Any]:
        """What decides a scene, however many there are."""
        values = asdict(self)
        del values["scenes"]
        return values


@dataclass(frozen=True)
class InitRow:
    """One scene and one way of sampling.

    Attributes:
        scene: Its number.
        grid: ``sphere``, or the ``paper``'s 96 viewpoints at one metre.
        position_mm, rotation_deg: Error of the first pose; None where there is none.
        seconds: It took.
        refined_mm, refined_deg: Error after the refinement by masks.
        refining_s: It took.
        status: The error's text.
    """

    scene: int
    grid: str
    position_mm: float | None = None
    rotation_deg: float | None = None
    seconds: float | None = None
    refined_mm: float | None = None
    refined_deg: float | None = None
    refining_s: float | None = None
    status: str = ""

    def error(self, *, refined: bool) -> PoseError | None:
        """Before or after the refinement."""
        mm = self.refined_mm if refined else self.position_mm
        degrees = self.refined_deg if refined else self.rotation_deg
        return PoseError.of(mm, degrees)


def run_init_bench(
    bench: InitBench,
    *,
    rows_file: Path | None = None,
    workers: int = 1,
    progress: Callable[[int, tuple[InitRow, ...]], None] | None = None,
) -> tuple[InitRow, ...]:
    """Find first poses and compare with the truth.

    Args:
        bench: What is measured.
        rows_file: Keeps finished scenes; they are not done again.
        workers: Processes side by side; seconds are honest with one only.
        progress: Called with the number of finished scenes and the rows of the last.

    Raises:
        InputError: Nonsensical counts or names, or a file of other settings.
        MissingExtraError: The arms are not installed.
    """
    for name, value in (("scenes", bench.scenes), ("views", bench.views)):
        if value < 1:
            raise InputError(f"{name} is {value}", expected="1 or more")
    arm_for_scenes(bench.robot)
    kept = RowFile(rows_file, bench.settings())
    joints = poses_for_any_camera(bench.robot, bench.size, bench.views, bench.seed)
    return resumed(
        partial(init_rows, bench, joints),
        lambda row: InitRow(**row),
        bench.scenes,
        kept,
        workers=workers,
        progress=progress,
    )


def init_rows(bench: InitBench, joints: F64, scene: int) -> tuple[InitRow, ...]:
    """One scene, every way of sampling; an error is a row without a pose.

    Args:
        bench: What is measured.
        joints: (views, n) where the arm is driven to.
        scene: Number of the scene.
    """
    _warm_up(bench)
    stage = MaskStage.random(load_robot(bench.robot), bench.size, [bench.seed, scene])
    for q in joints:
        stage.look(q)
    return tuple(_row(stage, scene, grid) for grid in GRIDS)


def init_table(bench: InitBench, rows: Sequence[InitRow]) -> Table:
    """Ours beside the published rows."""
    lines: list[tuple[Cell, ...]] = []
    for grid in GRIDS:
        mine = [row for row in rows if row.grid == grid]
        lines += [_line(_name(grid, refined), mine, refined=refined) for refined in (False, True)]
    lines += [
        (f"published {p.name}", p.rotation_deg, None, None, p.position_mm, None, None, "", p.time)
        for p in FIRST_POSE
    ]
    scenes = len({row.scene for row in rows})
    width, height = bench.size
    return Table(
        title=f"First pose, {bench.robot}, {scenes} scenes, {bench.views} views, seed {bench.seed}",
        columns=(
            "method",
            "deg mean",
            "deg median",
            "deg 95 %",
            "mm mean",
            "mm median",
            "mm 95 %",
            "failures",
            "time",
        ),
        rows=tuple(lines),
        notes=(
            f"Masks of {width}x{height} at an IoU of 0.982. Means are over the right poses (within "
            "20 mm and 2 deg), medians and percentiles over all; time: median, warm, without the "
            "arm's motion and without a graphics card. The published time includes the motion.",
            "Matching against earlier calibrations is published, but not part of this package.",
            *failure_notes(
                [
                    (f"scene {row.scene}, {_name(row.grid, refined=False)}", row.status)
                    for row in rows
                    if row.status
                ]
            ),
            machine_sentence(describe_machine()),
        ),
    )


def init_plot(rows: Sequence[InitRow]) -> Figure:
    """Share of scenes over the error."""
    return cumulative_plot(
        {
            _name(grid, refined): [
                e.position_mm if (e := row.error(refined=refined)) else float("inf")
                for row in rows
                if row.grid == grid
            ]
            for grid in GRIDS
            for refined in (False, True)
        },
        title="First pose",
        label="error of the camera's centre, mm",
        marks={f"published {p.name}, mean": p.position_mm for p in FIRST_POSE},
    )


@lru_cache(maxsize=1)
def _warm_up(bench: InitBench) -> None:
    """Compiled code is loaded and meshes are simplified once in a process, not in every scene."""
    stage = MaskStage.random(load_robot(bench.robot), bench.size, [bench.seed])
    stage.look(stage.poses.draw(1, np.random.default_rng(0))[0])
    stage.estimate()


def _row(stage: MaskStage, scene: int, grid: Grid) -> InitRow:
    seen = stage.observations
    clock = time.perf_counter()
    try:
        first = sample_initial_pose(stage.rig, stage.camera, seen, SamplingConfig(grid))
        middle = time.perf_counter()
        refined = solve_pose(stage.rig, stage.camera, seen, first.T_mount_cam)
    except SCENE_FAILURES as error:
        return InitRow(scene, grid, status=str(error))
    end = time.perf_counter()
    before = PoseError.between(first.T_mount_cam, stage.T_mount_cam)
    after = PoseError.between(refined.T_mount_cam, stage.T_mount_cam)
    return InitRow(
        scene, grid, before.position_mm, before.rotation_deg, middle - clock,
        after.position_mm, after.rotation_deg, end - middle,
    )  # fmt: skip


def _line(name: str, rows: Sequence[InitRow], *, refined: bool) -> tuple[Cell, ...]:
    summary = summarise([row.error(refined=refined) for row in rows])
    seconds = [
        row.seconds + (row.refining_s if refined else 0.0)
        for row in rows
        if row.seconds is not None and row.refining_s is not None
    ]
    degrees, mm = summary.rotation_deg, summary.position_mm
    return (
        name,
        degrees.mean,
        degrees.median,
        degrees.p95,
        mm.mean,
        mm.median,
        mm.p95,
        f"{summary.failures} of {summary.count}",
        f"{np.median(seconds):.2f} s" if seconds else "",
    )


def _name(grid: str, refined: bool) -> str:
    way = "sampling" if grid == "sphere" else "the paper's grid"
    return f"ours, {way}, refined" if refined else f"ours, {way}"
