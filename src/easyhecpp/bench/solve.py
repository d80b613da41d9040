"""How well the pose is found on simulated arms, with no initial guess: `easyhecpp bench solve`.

Every scene is drawn once and used by all cases, so that cases can be compared scene by scene. Each
case calibrates from nothing: first pose by sampling, then the optimiser. Scene i of seed s is drawn
from the generator `default_rng([s, i])`, and the noise of a case from one that is keyed by the
noise's settings too: every row can be repeated alone, whatever else was run.
"""

from __future__ import annotations

import time
import zlib
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from easyhecpp.bench.metrics import PoseError, chi_square
from easyhecpp.bench.scenes_pool import SCENE_FAILURES, RowFile, resumed
from easyhecpp.bench.table import describe_machine
from easyhecpp.camera import Camera
from easyhecpp.errors import InputError
from easyhecpp.explore.candidates import joint_ranges
from easyhecpp.initialise import sample_initial_pose
from easyhecpp.rig import Rig
from easyhecpp.robot import Robot
from easyhecpp.sim.faults import add_blob, punch_holes, remove_link
from easyhecpp.sim.masks import Degradation, degrade_masks
from easyhecpp.sim.scenes import SimScene, random_scene
from easyhecpp.solve import Observation, solve_pose

F64 = NDArray[np.float64]
F32 = NDArray[np.float32]

Fault = Literal["missing link", "blob", "holes"]

SCENE_VIEWS = 5
"""Views of every scene; a case may use fewer of them."""

FAULTY_VIEW = 0
"""The view that carries a case's fault."""


@dataclass(frozen=True)
class Case:
    """One line of the table.

    Attributes:
        name: what the line is called.
        n_views: how many of the scene's views are used.
        degradation: how the masks' boundaries wander; None for exact masks.
        fault: a gross fault of one view's mask.
        leave_out_faulty: solve without the faulty view: what could be had if it were known.
    """

    name: str
    n_views: int = SCENE_VIEWS
    degradation: Degradation | None = None
    fault: Fault | None = None
    leave_out_faulty: bool = False

    @property
    def noise_key(self) -> int:
        """Equal for cases whose masks are the same, so that they share their noise."""
        return zlib.crc32(repr((self.degradation, self.fault)).encode())


_NOISY = Degradation()

CASES = (
    Case("exact masks"),
    Case("IoU 0.982", degradation=_NOISY),
    *(Case(f"IoU 0.982, {n} view{'s'[: n > 1]}", n, _NOISY) for n in (4, 3, 2, 1)),
    Case("IoU 0.982, correlated over 8 px", degradation=Degradation(correlation_px=(8.0,))),
    Case("IoU 0.982, correlated over 20 px", degradation=Degradation(correlation_px=(20.0,))),
    Case("IoU 0.982, masks 0.3 px too large", degradation=Degradation(bias_px=0.3)),
    Case("IoU 0.982, one view lacks a link", degradation=_NOISY, fault="missing link"),
    Case("... without that view", 5, _NOISY, "missing link", leave_out_faulty=True),
    Case("IoU 0.982, one view with a blob of 15 %", degradation=_NOISY, fault="blob"),
    Case("... without the blob's view", 5, _NOISY, "blob", leave_out_faulty=True),
)
"""The cases that the project's figures are stated for."""


@dataclass(frozen=True)
class Outcome:
    """What a calibration from nothing gives.

    Attributes:
        T_mount_cam_first: (4, 4) the first pose.
        T_mount_cam: (4, 4) the final one.
        covariance: (6, 6) of the tangent [v, w] in `T_mount_cam @ exp([v, w])`.
        margin: by how much the best basin of the first pose beats the second.
        status: of the optimiser.
        first_pose_s: seconds spent on the first pose.
        solve_s: seconds spent on the optimisation.
    """

    T_mount_cam_first: F64
    T_mount_cam: F64
    covariance: F64
    margin: float
    status: str
    first_pose_s: float
    solve_s: float


Calibrate = Callable[[Rig, Camera, Sequence[Observation]], Outcome]


@dataclass(frozen=True)
class SolveRow:
    """One scene and case.

    Attributes:
        scene: number of the scene.
        case: name of the case.
        n_views: number of views used.
        sigma_px: standard deviation of the boundaries' displacement that gave the wanted IoU.
        error: of the final pose; None when there was none.
        first_error: of the first pose.
        chi_square: of the true error under the reported covariance, 6 degrees of freedom.
        margin: by how much the best basin of the first pose beat the second.
        status: of the optimiser, or the error's text.
        first_pose_s: seconds spent on the first pose.
        solve_s: seconds spent on the optimisation.
    """

    scene: int
    case: str
    n_views: int
    sigma_px: float
    error: PoseError | None = None
    first_error: PoseError | None = None
    chi_square: float | None = None
    margin: float | None = None
    status: str = ""
    first_pose_s: float | None = None
    solve_s: float | None = None


@dataclass(frozen=True)
class SolveBench:
    """The rows of a benchmark and what is needed to repeat it.

    Attributes:
        robot: name of the robot.
        seed: the seed.
        cases: what was asked.
        rows: scene by scene, case by case.
        scene_options: arguments of `random_scene` other than its defaults.
        machine: see `describe_machine`.
    """

    robot: str
    seed: int
    cases: tuple[Case, ...]
    rows: tuple[SolveRow, ...]
    scene_options: dict[str, Any]
    machine: dict[str, Any] = field(default_factory=describe_machine)

    def record(self) -> dict[str, Any]:
        """Everything that belongs beside the table in a file."""
        return {
            "robot": self.robot,
            "seed": self.seed,
            "scene_options": self.scene_options,
            "cases": [asdict(case) for case in self.cases],
            "all_rows": [asdict(row) for row in self.rows],
            "machine": self.machine,
        }


def calibrate_from_nothing(
    rig: Rig, camera: Camera, observations: Sequence[Observation]
) -> Outcome:
    """First pose and optimisation with their defaults."""
    start = time.perf_counter()
    first = sample_initial_pose(rig, camera, observations)
    middle = time.perf_counter()
    estimate = solve_pose(rig, camera, observations, first.T_mount_cam)
    return Outcome(
        T_mount_cam_first=first.T_mount_cam,
        T_mount_cam=estimate.T_mount_cam,
        covariance=estimate.covariance,
        margin=first.margin,
        status=estimate.status,
        first_pose_s=middle - start,
        solve_s=time.perf_counter() - middle,
    )


def run_solve_bench(
    robot: Robot,
    *,
    n_scenes: int,
    seed: int,
    cases: Sequence[Case] = CASES,
    workers: int = 1,
    calibrate: Calibrate = calibrate_from_nothing,
    rows_file: Path | None = None,
    progress: Callable[[int, tuple[SolveRow, ...]], None] | None = None,
    **scene_options: Any,
) -> SolveBench:
    """Calibrate simulated scenes from nothing and compare with the truth.

    Args:
        robot: any arm.
        n_scenes: number of scenes.
        seed: scene i is the same for every run with this seed.
        cases: the lines of the table.
        workers: processes side by side; timings are honest with one only.
        calibrate: what is measured; a function at the top of a module, if there are workers.
        rows_file: keeps finished scenes; they are not done again.
        progress: called with the number of scenes done and the rows of the last.
        scene_options: passed on to `easyhecpp.sim.scenes.random_scene`.

    Raises:
        InputError: no scenes, an arm without limits, or a file of other settings.
    """
    if n_scenes < 1:
        raise InputError(f"scenes is {n_scenes}", expected="1 or more")
    joint_ranges(robot)  # limits that mean nothing: say it before the first scene
    job = _Job(robot, seed, tuple(cases), calibrate, scene_options)
    settings = {
        "robot": robot.name,
        "seed": seed,
        "cases": [asdict(case) for case in job.cases],
        "scene_options": scene_options,
    }
    rows = resumed(
        partial(_run_scene, job),
        _read_row,
        n_scenes,
        RowFile(rows_file, settings),
        workers=workers,
        progress=progress,
    )
    return SolveBench(robot.name, seed, job.cases, rows, scene_options)


@dataclass(frozen=True)
class _Job:
    """Everything that a worker needs to know."""

    robot: Robot
    seed: int
    cases: tuple[Case, ...]
    calibrate: Calibrate
    scene_options: dict[str, Any]


def _read_row(row: dict[str, Any]) -> SolveRow:
    plain = dict(row)
    error, first = plain.pop("error"), plain.pop("first_error")
    return SolveRow(
        **plain,
        error=None if error is None else PoseError(**error),
        first_error=None if first is None else PoseError(**first),
    )


def _run_scene(job: _Job, index: int) -> list[SolveRow]:
    scene = random_scene(
        job.robot,
        np.random.default_rng([job.seed, index]),
        n_views=SCENE_VIEWS,
        **job.scene_options,
    )
    made: dict[int, _Masks] = {}
    rows = []
    for case in job.cases:
        if case.noise_key not in made:
            rng = np.random.default_rng([job.seed, index, case.noise_key])
            made[case.noise_key] = _make_masks(scene, case, rng)
        rows.append(_run_case(job, scene, index, case, made[case.noise_key]))
    return rows


@dataclass(frozen=True)
class _Masks:
    masks: tuple[NDArray[np.bool_], ...]
    sigma_px: float


def _make_masks(scene: SimScene, case: Case, rng: np.random.Generator) -> _Masks:
    """The masks of all views of a scene as a case wants them."""
    truths: list[F32] = list(scene.coverages)
    if case.fault is not None:
        truths[FAULTY_VIEW] = _with_fault(scene, truths[FAULTY_VIEW], case.fault, rng)
    if case.degradation is None:
        return _Masks(tuple(truth > 0.5 for truth in truths), 0.0)
    degraded = degrade_masks(truths, rng, case.degradation)
    return _Masks(degraded.masks, degraded.sigma_px)


def _with_fault(scene: SimScene, truth: F32, fault: Fault, rng: np.random.Generator) -> F32:
    if fault == "blob":
        return add_blob(truth, rng, 0.15)
    if fault == "holes":
        return punch_holes(truth, rng)
    links = scene.visible_links(FAULTY_VIEW)
    shares = np.bincount(links[links >= 0], minlength=len(scene.robot.meshes))
    shares = shares / max(1, shares.sum())
    # A link that shows, but is not most of what shows.
    candidates = np.flatnonzero((shares > 0.05) & (shares < 0.4))
    link = int(rng.choice(candidates)) if len(candidates) else int(np.argmax(shares))
    return remove_link(truth, links, link)


def _run_case(job: _Job, scene: SimScene, index: int, case: Case, made: _Masks) -> SolveRow:
    views = list(range(case.n_views))
    if case.leave_out_faulty:
        views.remove(FAULTY_VIEW)
    observations = [
        Observation(joints=scene.joints[view], mask=made.masks[view], id=str(view))
        for view in views
    ]
    row = SolveRow(scene=index, case=case.name, n_views=len(views), sigma_px=made.sigma_px)
    try:
        outcome = job.calibrate(Rig(scene.robot), scene.camera, observations)
    except SCENE_FAILURES as error:
        return replace(row, status=str(error))
    return replace(
        row,
        error=PoseError.between(outcome.T_mount_cam, scene.T_base_cam),
        first_error=PoseError.between(outcome.T_mount_cam_first, scene.T_base_cam),
        chi_square=chi_square(outcome.T_mount_cam, outcome.covariance, scene.T_base_cam),
        margin=outcome.margin,
        status=outcome.status,
        first_pose_s=outcome.first_pose_s,
        solve_s=outcome.solve_s,
    )
