"""The tip sent to a corner that the calibrated camera sees: `easyhecpp bench targeting`.

The camera is calibrated with chosen views, as in `bench eye-to-hand`. Then boards lie on the table:
their corners are found in a picture, one of them is carried over to the arm's base by the camera's
pose, and the arm's tip is sent there by inverse kinematics. What a person would measure with a
ruler is the distance from the tip to the corner; here it is exact.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.optimize import least_squares

from easyhecpp.baselines.board_views import render_board_view
from easyhecpp.baselines.boards import CharucoBoard, board_pose
from easyhecpp.bench.eye_to_hand import (
    EyeToHandBench,
    blind_poses,
    check_bench,
    make_stage,
    walk,
)
from easyhecpp.bench.metrics import Spread
from easyhecpp.bench.plots import cumulative_plot
from easyhecpp.bench.published import TARGETING_MM
from easyhecpp.bench.scenes_pool import SCENE_FAILURES, RowFile, resumed
from easyhecpp.bench.stages import Stage
from easyhecpp.bench.table import Cell, Table, describe_machine, failure_notes, machine_sentence
from easyhecpp.errors import InputError
from easyhecpp.geometry import inverse, make_transform, transform_points
from easyhecpp.robot import Robot
from easyhecpp.sim.robots import end_link

F64 = NDArray[np.float64]

BOARD = CharucoBoard(5, 4, square=0.06, marker=0.045)

_SIDE = (BOARD.columns * BOARD.square, BOARD.rows * BOARD.square)
_TRIES = 200
_STARTS = 4
_REACHED_M = 1e-4

_PLACES, _WELL_FOUND_PX = 30, 0.15
"""Places that a board is laid at until it is found well: whole, and its corners within so much
(root mean square) of those of one pose."""


@dataclass(frozen=True)
class Target:
    """One attempt.

    Attributes:
        scene: Number of the scene.
        trial: Number within the scene.
        tip_mm: Distance from the tip to the corner; None when no attempt could be made.
        ideal_mm: The same had the camera's pose been exact: what finding the corner costs.
        distance_m: From the camera to the corner.
        status: Why there was no attempt.
    """

    scene: int
    trial: int
    tip_mm: float | None = None
    ideal_mm: float | None = None
    distance_m: float | None = None
    status: str = ""


def run_targeting(
    bench: EyeToHandBench,
    trials: int,
    *,
    ee_link: str | None = None,
    rows_file: Path | None = None,
    workers: int = 1,
    progress: Callable[[int, tuple[Target, ...]], None] | None = None,
) -> tuple[Target, ...]:
    """Calibrate scenes, and send the tip to corners.

    Args:
        bench: How cameras are calibrated; the first of its ways of choosing counts.
        trials: Corners per scene.
        ee_link: The link whose origin is sent to the corner, see `end_link`.
        rows_file: Keeps finished scenes; they are not done again.
        workers: Processes side by side.
        progress: Called with the number of finished scenes and the attempts of the last.

    Raises:
        InputError: Nonsensical counts or names, or a file of other settings.
        MissingExtraError: The arms, or the path tracer, are not installed.
    """
    check_bench(bench)
    if trials < 1:
        raise InputError(f"trials is {trials}", expected="1 or more")
    tip = end_link(bench.robot, ee_link)
    settings: dict[str, Any] = {**bench.settings(), "trials": trials, "ee_link": tip}
    kept = RowFile(rows_file, settings)
    return resumed(
        partial(scene_targets, bench, trials, tip, blind_poses(bench)),
        lambda row: Target(**row),
        bench.scenes,
        kept,
        workers=workers,
        progress=progress,
    )


def scene_targets(
    bench: EyeToHandBench, trials: int, tip: str, blind: F64, scene: int
) -> list[Target]:
    """All attempts of one scene; an error is an attempt that missed.

    Args:
        bench: How the camera is calibrated.
        trials: Number of attempts.
        tip: The link whose origin is sent to the corner.
        blind: See `blind_poses`.
        scene: Number of the scene.
    """
    try:
        stage, joints = make_stage(bench, blind, scene)
        *_, (last, estimate) = walk(stage, joints, bench.seed, scene, bench.choose[0])
        if estimate is None:
            return [Target(scene, k, status=last.status) for k in range(trials)]
        rng = np.random.default_rng([bench.seed, scene, 1])
        return list(_attempts(stage, estimate.T_mount_cam, tip, trials, scene, rng))
    except SCENE_FAILURES as error:
        return [Target(scene, k, status=str(error)) for k in range(trials)]


def targeting_table(bench: EyeToHandBench, targets: Sequence[Target]) -> Table:
    """Ours beside the published distances."""
    lines: list[tuple[Cell, ...]] = [
        _line(f"ours, {bench.views} view{'s'[: bench.views > 1]}", [t.tip_mm for t in targets]),
        _line("with the true camera pose", [t.ideal_mm for t in targets]),
        *(
            (f"published {name}, real arm", None, value, None, None)
            for name, value in TARGETING_MM.items()
        ),
    ]
    scenes = len({t.scene for t in targets})
    far = [t.distance_m for t in targets if t.distance_m is not None]
    width, height = bench.size
    return Table(
        title=f"Targeting, {bench.robot}, {scenes} scenes from {bench.source}, seed {bench.seed}",
        columns=("method", "attempts", "mm mean", "mm median", "mm 95 %"),
        rows=tuple(lines),
        notes=(
            f"A ChArUco board of {1e3 * _SIDE[0]:.0f}x{1e3 * _SIDE[1]:.0f} mm on the table, "
            f"{width}x{height}, corners {min(far, default=0):.2f} to {max(far, default=0):.2f} m "
            "away. The simulated arm goes exactly where it is sent and the distance is exact; the "
            "published ones were measured by hand on a real arm, whose own errors are in them.",
            f"A board that is not found whole, or whose corners lie more than {_WELL_FOUND_PX} px "
            "from those of one pose, is laid elsewhere.",
            "Mean over the attempts that could be made; an attempt without a pose or a corner "
            "counts as a miss in median and percentile: "
            f"{sum(t.tip_mm is None for t in targets)} of {len(targets)}.",
            *failure_notes(
                [(f"scene {t.scene}, attempt {t.trial}", t.status) for t in targets if t.status]
            ),
            machine_sentence(describe_machine()),
        ),
    )


def targeting_plot(targets: Sequence[Target]) -> Figure:
    """Share of attempts over the distance."""
    return cumulative_plot(
        {
            "ours": [float("inf") if t.tip_mm is None else t.tip_mm for t in targets],
            "with the true camera pose": [
                float("inf") if t.ideal_mm is None else t.ideal_mm for t in targets
            ],
        },
        title="Targeting",
        label="distance from the tip to the corner, mm",
        marks={"published EasyHeC++, real arm": TARGETING_MM["EasyHeC++"]},
    )


def _attempts(
    stage: Stage, T_base_cam: F64, tip: str, trials: int, scene: int, rng: np.random.Generator
) -> Iterator[Target]:
    for trial in range(trials):
        sighted = _sighting(stage, rng)
        if isinstance(sighted, str):
            yield Target(scene, trial, status=sighted)
            continue
        T_base_board, found = sighted
        corner = BOARD.corners[int(rng.integers(len(BOARD.corners)))]
        there = transform_points(T_base_board, corner)
        yield Target(
            scene,
            trial,
            *(
                1e3 * float(np.linalg.norm(_tip_at(stage.rig.robot, tip, goal, rng) - there))
                for goal in (
                    transform_points(T @ found, corner) for T in (T_base_cam, stage.T_mount_cam)
                )
            ),
            distance_m=float(np.linalg.norm(there - stage.T_mount_cam[:3, 3])),
        )


def _sighting(stage: Stage, rng: np.random.Generator) -> tuple[F64, F64] | str:
    """A board that was found well: where it lies (4, 4) and T_cam_board as found; or why not.

    A board whose corners fit together badly, or that is not seen whole, is laid elsewhere, as
    anybody would who looks at the detection.
    """
    for _ in range(_PLACES):
        T_base_board = _board_on_table(stage, rng)
        if T_base_board is None:
            return "no place on the table is in view and in reach"
        T_cam_board = inverse(stage.T_mount_cam) @ T_base_board
        seen = BOARD.detect(render_board_view(BOARD, stage.camera, T_cam_board, rng).picture)
        if seen is None or len(seen.ids) < len(BOARD.corners):
            continue
        found = board_pose(BOARD, stage.camera, seen)
        if found is None:
            continue
        again = stage.camera.project(transform_points(found, BOARD.corners[seen.ids]))
        if np.sqrt(np.square(again - seen.pixels).sum(axis=1).mean()) < _WELL_FOUND_PX:
            return T_base_board, found
    return f"the board was not found well at any of {_PLACES} places"


def _board_on_table(stage: Stage, rng: np.random.Generator) -> F64 | None:
    """A board (4, 4) that lies face up, in reach and wholly in the picture; None if there is none.

    Its frame's z axis points into the table.
    """
    reach, z = stage.rig.robot.reach, stage.poses.floor_z
    for _ in range(_TRIES):
        angle, turn = rng.uniform(-np.pi, np.pi, 2)
        r = reach * rng.uniform(0.35, 0.65)
        c, s = np.cos(turn), np.sin(turn)
        R = np.array([[c, s, 0.0], [s, -c, 0.0], [0.0, 0.0, -1.0]])
        middle = np.array([r * np.cos(angle), r * np.sin(angle), z])
        T_base_board = make_transform(R, middle - R @ np.array([*_SIDE, 0.0]) / 2.0)
        x, y = _SIDE
        sheet = np.array([[0, 0, 0], [x, 0, 0], [0, y, 0], [x, y, 0]], np.float64)
        in_cam = transform_points(inverse(stage.T_mount_cam) @ T_base_board, sheet)
        px = stage.camera.project(in_cam)
        size = np.array([stage.camera.width, stage.camera.height])
        if (in_cam[:, 2] > 0.2).all() and ((px > 10) & (px < size - 10)).all():
            return T_base_board
    return None


def _tip_at(robot: Robot, tip: str, goal: F64, rng: np.random.Generator) -> F64:
    """Where the tip (3,) comes to stand when it is sent to a point: there, if it can reach it."""
    low, high = np.maximum(robot.lower, -np.pi), np.minimum(robot.upper, np.pi)
    best = np.full(3, np.inf)
    for k in range(_STARTS):
        start = np.clip(robot.neutral, low, high) if k == 0 else rng.uniform(low, high)
        solved = least_squares(
            lambda q: robot.frame_pose(q, tip)[:3, 3] - goal,
            np.clip(start, low + 1e-6, high - 1e-6),
            bounds=(low, high),
            xtol=1e-12,
            ftol=1e-14,
        )
        at = robot.frame_pose(solved.x, tip)[:3, 3]
        if np.linalg.norm(at - goal) < np.linalg.norm(best - goal):
            best = at
        if np.linalg.norm(best - goal) < _REACHED_M:
            break
    return best


def _line(name: str, values: Sequence[float | None]) -> tuple[Cell, ...]:
    spread = Spread.of(values, [value is not None for value in values])
    return name, len(values), spread.mean, spread.median, spread.p95
