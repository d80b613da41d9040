"""From photo-real pictures alone, without any weights: `easyhecpp bench photo`.

Scene k of a seed is one cell with one of several arms, photographed by the path tracer and
calibrated from images, joints, intrinsics and the URDF. The pose before the edge stage and the one
after it come from the same run.
"""

from __future__ import annotations

import contextlib
import dataclasses
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

from easyhecpp.bench.metrics import PoseError
from easyhecpp.bench.scenes_pool import SCENE_FAILURES, RowFile, in_order
from easyhecpp.bench.stages import arm_for_scenes
from easyhecpp.bench.truth_file import read_truth
from easyhecpp.capture import Capture
from easyhecpp.errors import EasyHecError, InputError
from easyhecpp.segment.classical.segmenter import FEWEST_VIEWS
from easyhecpp.session import CalibrationConfig, calibrate
from easyhecpp.sim.dataset import DatasetPlan, is_complete, make_scene
from easyhecpp.sim.options import options_for
from easyhecpp.sim.studio import FULL, mitsuba, tracer

ARMS = ("xarm7", "panda", "ur5", "kinova_gen2", "z1")
"""The arms that take turns."""

WORSE_SHARE, WORSE_MM = 0.10, 0.1
"""The edge stage made a scene worse when the error grew by more than both."""

_RENEW_AFTER = 10


@dataclass(frozen=True)
class PhotoBench:
    """What is measured.

    Attributes:
        scenes: Their number.
        seed: Scene k depends on it, on the arms and on k.
        arms: Scene k shows arm k modulo their number.
        views: Pictures per scene.
        size: Of the pictures, (width, height).
        samples: Light paths per pixel.
        difficulty: Of the cells: a name in `easyhecpp.sim.options.DIFFICULTIES`.
    """

    scenes: int
    seed: int
    arms: tuple[str, ...] = ARMS
    views: int = 6
    size: tuple[int, int] = (960, 540)
    samples: int = FULL.samples
    difficulty: str = "normal"

    def plan(self, scene: int) -> DatasetPlan:
        """The data set that a scene belongs to."""
        width, height = self.size
        return DatasetPlan(
            self.arms[scene % len(self.arms)],
            self.seed,
            self.views,
            replace(options_for(self.difficulty), width=width, height=height),
            replace(FULL, samples=self.samples),
        )

    def settings(self) -> dict[str, Any]:
        """What decides a scene, however many there are."""
        values = dataclasses.asdict(self) | {"tracer": tracer()}
        del values["scenes"]
        return values


@dataclass(frozen=True)
class PhotoRow:
    """One scene.

    Attributes:
        scene: Its number.
        arm: Its arm.
        verdict: ``ok``, ``doubtful`` or ``failed``; ``error`` when nothing came out.
        reach_m: Of the arm, metres.
        position_mm, rotation_deg: Error of the pose; None where there is none.
        before_mm, before_deg: Error of the pose before the edge stage.
        seconds: Of the calibration.
        made_s: Seconds that the pictures took; 0 when they were there.
        reasons: The verdict's sentences, or the error's text.
        made: Whether there were pictures to calibrate from.
    """

    scene: int
    arm: str
    verdict: str
    reach_m: float | None = None
    position_mm: float | None = None
    rotation_deg: float | None = None
    before_mm: float | None = None
    before_deg: float | None = None
    seconds: float | None = None
    made_s: float = 0.0
    reasons: tuple[str, ...] = field(default=())
    made: bool = True

    @property
    def error(self) -> PoseError | None:
        """Of the pose that a user gets."""
        return PoseError.of(self.position_mm, self.rotation_deg)

    @property
    def before(self) -> PoseError | None:
        """Of the pose before the edge stage."""
        return PoseError.of(self.before_mm, self.before_deg)

    @property
    def is_right(self) -> bool:
        """Whether the pose is within 20 mm and 2 deg."""
        return self.error is not None and self.error.is_right

    @property
    def worse_by_edges(self) -> bool:
        """Whether the edge stage harmed a pose that was right."""
        if self.position_mm is None or self.before_mm is None:
            return False
        if self.before is None or not self.before.is_right:
            return False
        more = self.position_mm - self.before_mm
        return more > WORSE_SHARE * self.before_mm and more > WORSE_MM


def run_photo_bench(
    bench: PhotoBench,
    *,
    folder: Path | None = None,
    rows_file: Path | None = None,
    workers: int = 1,
    progress: Callable[[int, PhotoRow], None] | None = None,
) -> tuple[PhotoRow, ...]:
    """Photograph scenes, calibrate them, and compare with the truth.

    What goes wrong with a scene is a counted failure with its text; what concerns all scenes (a
    missing package, a full disk) ends the run. Scenes whose row stands in
    ``rows_file`` are not done again, but those whose pictures could not be made are.

    Args:
        bench: What is measured.
        folder: Keeps the data set; otherwise every scene is removed when it is done.
        rows_file: Keeps the rows as they come.
        workers: Processes side by side; seconds are honest with one only.
        progress: Called with the number of rows so far and the last of them.

    Raises:
        InputError: Unknown arm or difficulty, an arm without limits, no scenes, too few views, or
            a file of other settings.
        MissingExtraError: The path tracer or the arms are not installed.
    """
    _check(bench)
    kept = RowFile(rows_file, bench.settings())
    rows = {scene: row for scene, row in kept.rows(_row_from).items() if scene < bench.scenes}
    missing = [scene for scene in range(bench.scenes) if scene not in rows]
    work = partial(photo_row, bench, folder)
    # The path tracer keeps memory of its own: processes are replaced now and then.
    for row in in_order(work, missing, workers, renew_after=_RENEW_AFTER):
        rows[row.scene] = row
        if row.made:
            kept.append(dataclasses.asdict(row))
        if progress is not None:
            progress(len(rows), row)
    return tuple(rows[scene] for scene in sorted(rows))


def photo_row(bench: PhotoBench, folder: Path | None, scene: int) -> PhotoRow:
    """Photograph and calibrate one scene.

    Raises:
        EasyHecError: Something that concerns all scenes; a scene's own failure is its row.
    """
    plan = bench.plan(scene)
    row = PhotoRow(scene, plan.robot, "error")
    with _place(folder) as root:
        clock = time.perf_counter()
        try:
            place = root / f"scene_{scene:04d}"
            if not is_complete(place, plan, scene):
                make_scene(root, plan, scene)
                row = replace(row, made_s=time.perf_counter() - clock)
        except Exception as error:
            return replace(row, made=False, reasons=(_counted(error),))
        try:
            return _calibrated(row, place)
        except Exception as error:
            return replace(row, reasons=(_counted(error),))


def _calibrated(row: PhotoRow, place: Path) -> PhotoRow:
    truth = read_truth(place).T_mount_cam
    assert truth is not None  # the generator writes it
    capture = Capture.load(place)
    clock = time.perf_counter()
    found = calibrate(capture, CalibrationConfig(segmenter="classical"))
    seconds = time.perf_counter() - clock
    error = PoseError.between(found.T_mount_cam, truth)
    start = found.before_edges or found.estimate
    before = PoseError.between(start.T_mount_cam, truth)
    return replace(
        row,
        verdict=found.result.verdict,
        reach_m=capture.robot.reach,
        position_mm=error.position_mm,
        rotation_deg=error.rotation_deg,
        before_mm=before.position_mm,
        before_deg=before.rotation_deg,
        seconds=seconds,
        reasons=(*found.result.reasons, *found.notes),
    )


def _check(bench: PhotoBench) -> None:
    for name, value, least in (
        ("scenes", bench.scenes, 1),
        ("views", bench.views, FEWEST_VIEWS),
        ("spp", bench.samples, 1),
    ):
        if value < least:
            raise InputError(f"{name} is {value}", expected=f"{least} or more")
    if not bench.arms:
        raise InputError("No arm is named", expected="at least one")
    # Missing packages and misspelt names are told at once, not scene by scene.
    mitsuba()
    for arm in bench.arms:
        arm_for_scenes(arm)
    bench.plan(0)


@contextlib.contextmanager
def _place(folder: Path | None) -> Iterator[Path]:
    if folder is not None:
        yield folder
        return
    with tempfile.TemporaryDirectory(prefix="easyhecpp-photo-") as place:
        yield Path(place)


def _row_from(values: dict[str, Any]) -> PhotoRow:
    reasons = tuple(values.pop("reasons"))
    return PhotoRow(**values, reasons=reasons)


def _counted(error: Exception) -> str:
    """The text of a scene's failure; what concerns all scenes goes on up."""
    if isinstance(error, EasyHecError) and not isinstance(error, SCENE_FAILURES):
        raise error
    return f"{type(error).__name__}: {error}"
