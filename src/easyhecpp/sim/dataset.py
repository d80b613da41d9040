"""Data sets of photo-real scenes: capture folders with the truth beside them."""

from __future__ import annotations

import json
import multiprocessing
import os
import shutil
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass, field, replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from easyhecpp._atomic import write_text
from easyhecpp._parallel import lost_processes_told, usable_cores
from easyhecpp.capture import Capture
from easyhecpp.capture.write import write_capture
from easyhecpp.errors import InputError
from easyhecpp.rig import rides_on_arm
from easyhecpp.sim.cell import Cell
from easyhecpp.sim.options import CellOptions, options_for
from easyhecpp.sim.random_cell import cell_with_poses
from easyhecpp.sim.robots import robot_source
from easyhecpp.sim.studio import FULL, Quality, limit_threads, mitsuba, tracer

TRUTH = "truth.json"
SCHEMA = "easyhecpp-sim-truth/1"

Progress = Callable[[int, int, str], None]


@dataclass(frozen=True)
class DatasetPlan:
    """What to generate.

    Attributes:
        robot: name of the arm, or path of its URDF.
        seed: of the whole data set; scene k depends on it and on k alone.
        views: per scene.
        options: of the cells.
        quality: of the pictures.
        copy_robot: whether every scene gets the URDF and meshes; else it refers to them.
    """

    robot: str = "xarm7"
    seed: int = 0
    views: int = 5
    options: CellOptions = field(default_factory=CellOptions)
    quality: Quality = FULL
    copy_robot: bool = False

    def settings(self) -> dict[str, Any]:
        """The plan as plain values, for the record and for comparison."""
        return json.loads(json.dumps(asdict(self) | {"tracer": tracer()}))


def generate_scenes(
    folder: str | Path,
    n: int,
    seed: int = 0,
    *,
    robot: str = "xarm7",
    views: int = 5,
    difficulty: str = "normal",
    options: CellOptions | None = None,
    quality: Quality = FULL,
    copy_robot: bool = False,
    workers: int | None = None,
    progress: Progress | None = None,
) -> list[Path]:
    """Write n scenes as capture folders ``scene_0000``, ... with a ``truth.json`` each.

    A scene that is complete and was made with the same settings is left alone; half-written ones
    and ones made otherwise are made again. So an interrupted run is simply repeated.

    Args:
        folder: where to.
        n: number of scenes.
        seed: of the data set; scene k is the same however many there are.
        robot: name of the arm, see `easyhecpp.sim.robots.robot_names`, or path of its URDF.
        views: per scene.
        difficulty: ``easy``, ``normal``, ``anywhere`` (the camera on any side and turned about its
            axis by any angle) or ``hard``.
        options: replaces the difficulty's options.
        quality: of the pictures.
        copy_robot: whether every scene gets the URDF and meshes; else it refers to them.
        workers: processes; by default one per core.
        progress: called with (scenes done, n, the scene's folder name) after each.

    Returns:
        The n folders.

    Raises:
        InputError: unknown robot or difficulty, nonsensical counts, a folder not writable.
        CalibrationError: the system ended a worker process.
        MissingExtraError: Mitsuba or the robot's data are not installed.
    """
    for name, value in (("n", n), ("views", views), ("workers", workers or 1)):
        if value < 1:
            raise InputError(f"{name} is {value}", expected="1 or more")
    chosen = options_for(difficulty) if options is None else options
    plan = DatasetPlan(robot, seed, views, chosen, quality, copy_robot)
    # Missing packages and misspelt names are told now, not by n workers.
    mitsuba()
    robot_source(robot)
    root = Path(folder)
    folders = [root / f"scene_{k:04d}" for k in range(n)]
    missing = [k for k in range(n) if not is_complete(folders[k], plan, k)]
    done = n - len(missing)
    for k in _made(root, plan, missing, workers or usable_cores()):
        done += 1
        if progress is not None:
            progress(done, n, folders[k].name)
    return folders


def is_complete(folder: Path, plan: DatasetPlan, index: int) -> bool:
    """Whether a folder holds scene ``index`` of the plan, whole."""
    try:
        truth = json.loads((folder / TRUTH).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    return truth.get("settings") == plan.settings() and truth.get("index") == index


def make_scene(root: str | Path, plan: DatasetPlan, index: int) -> Path:
    """Draw, photograph and write scene ``index`` of a plan; returns its folder."""
    folder = Path(root) / f"scene_{index:04d}"
    rng = np.random.default_rng([plan.seed, index])
    cell, joints = cell_with_poses(plan.robot, rng, plan.options, plan.views)
    views = cell.capture(joints, quality=plan.quality)
    capture = Capture(
        folder.name,
        None,
        cell.rig.setup,
        cell.robot,
        cell.camera,
        tuple(view.as_view() for view in views),
        cell.rig.ee_link,
    )
    source = replace(robot_source(plan.robot), copy=plan.copy_robot)
    # The truth goes last: its presence says that the scene is whole.
    (folder / TRUTH).unlink(missing_ok=True)
    for leftover in folder.parent.glob(f".{folder.name}.*.tmp*"):
        shutil.rmtree(leftover, ignore_errors=True)
    write_capture(folder, capture, robot=source, overwrite=True)
    write_text(folder / TRUTH, json.dumps(_truth(cell, plan, index), indent=1) + "\n")
    return folder


def _truth(cell: Cell, plan: DatasetPlan, index: int) -> dict[str, Any]:
    T = np.asarray(cell.T_mount_cam)
    truth: dict[str, Any] = {
        "schema": SCHEMA,
        "package": _package_version(),
        "index": index,
        "settings": plan.settings(),
        "T_mount_cam": {"parent": cell.rig.mount, "child": cell.camera.frame, "matrix": T.tolist()},
        "cell": {
            "arm": cell.look.name,
            **cell.surroundings.description,
            "distractor": None if cell.distractor is None else cell.distractor.robot.name,
            "sensor": asdict(cell.sensor),
        },
    }
    if not rides_on_arm(cell.rig.setup):
        truth["T_base_cam"] = T.tolist()
    return truth


def _package_version() -> str:
    try:
        return f"easyhecpp {version('easyhecpp')}"
    except PackageNotFoundError:
        return "easyhecpp"


def _made(root: Path, plan: DatasetPlan, missing: list[int], workers: int) -> Iterator[int]:
    """Make scenes and yield each one's index when it is done."""
    workers = min(workers, len(missing))
    if workers <= 1:
        for k in missing:
            make_scene(root, plan, k)
            yield k
        return
    threads = max(1, (os.cpu_count() or 1) // workers)
    # Threads of compiled code do not survive a fork.
    context = multiprocessing.get_context("spawn")
    executor = ProcessPoolExecutor(workers, context, limit_threads, (threads,))
    with lost_processes_told(), executor as pool:
        jobs = {pool.submit(make_scene, root, plan, k): k for k in missing}
        try:
            for job in as_completed(jobs):
                job.result()
                yield jobs[job]
        finally:
            for job in jobs:
                job.cancel()
