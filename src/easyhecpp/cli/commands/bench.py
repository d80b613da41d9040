"""``easyhecpp bench``: the published tables as commands."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated

import tyro
from tyro.conf import Positional

from easyhecpp.cli.commands.bench_baselines import BenchAdam, BenchMarker
from easyhecpp.cli.commands.bench_pictures import BenchPhoto
from easyhecpp.cli.commands.bench_recordings import BenchReal, BenchRepeat
from easyhecpp.cli.commands.bench_tables import BenchEyeToHand, BenchInit
from easyhecpp.cli.commands.bench_tasks import BenchBaxter, BenchTargeting
from easyhecpp.cli.output import complain, progress
from easyhecpp.cli.publish import publish, rows_file, table_file
from easyhecpp.errors import InputError


@dataclass(frozen=True)
class BenchSolve:
    """Calibrate simulated scenes from nothing with degraded masks; compare with the truth."""

    robot: str = "xarm7"
    """The arm, by name or the path of its URDF."""

    scenes: int = 20
    """Number of scenes."""

    seed: int = 1000
    """Scene i of a seed is always the same."""

    workers: int = 1
    """Processes side by side; the seconds in the table are honest with one only."""

    out: Path | None = None
    """Markdown file to write; a .json and a .png stand beside it, and a .rows.jsonl that an
    interrupted run goes on from."""

    def run(self, command_line: str) -> int:
        """Run and print the table."""
        from easyhecpp.bench.solve import run_solve_bench
        from easyhecpp.bench.solve_table import solve_plot, solve_table
        from easyhecpp.sim.robots import load_robot

        robot = load_robot(self.robot)
        with progress(quiet=False) as tell:
            bench = run_solve_bench(
                robot,
                n_scenes=self.scenes,
                seed=self.seed,
                workers=self.workers,
                rows_file=rows_file(self.out),
                progress=lambda done, _: tell(f"{done} of {self.scenes} scenes"),
            )
        # Some URDFs call the robot by another name than everyone else.
        bench = replace(bench, robot=self.robot)
        table, figure = solve_table(bench), solve_plot(bench)
        publish(table, self.out, command_line, figure=figure, **bench.record())
        return 0


@dataclass(frozen=True)
class BenchTrust:
    """Error bars against true errors, wrong views found, and verdicts on scenes built to fail."""

    scenes: int = 10
    """Scenes per family."""

    seed: int = 1000
    """Decides all scenes."""

    workers: int = 1
    """Processes side by side."""

    width: int = 640
    """Width of the pictures, pixels; 16 : 9."""

    families: tuple[str, ...] = ()
    """Only families whose name begins with one of these words; all when left out."""

    out: Path | None = None
    """Markdown file to write; a .json and a .png stand beside it, and a .rows.jsonl that an
    interrupted run goes on from."""

    def run(self, command_line: str) -> int:
        """Run and print the table."""
        from easyhecpp.bench.trust import run_trust_bench, trust_plot, trust_table
        from easyhecpp.bench.trust_scenes import FAMILIES

        chosen = tuple(n for n in FAMILIES if not self.families or n.startswith(self.families))
        if not chosen:
            raise InputError(
                f"No family's name begins with {', '.join(self.families)}",
                expected=f"beginnings of {'; '.join(FAMILIES)}",
            )
        with progress(quiet=False) as tell:
            rows = run_trust_bench(
                chosen,
                n_scenes=self.scenes,
                seed=self.seed,
                workers=self.workers,
                width=self.width,
                rows_file=rows_file(self.out),
                progress=lambda done, _: tell(f"{done} of {self.scenes} scenes of each family"),
            )
        publish(
            trust_table(rows, f"xarm7, seed {self.seed}"),
            self.out,
            command_line,
            figure=trust_plot(rows),
            # The verdicts' sentences, most of the bulk, stay in the .rows.jsonl.
            all_rows=[asdict(replace(row, reasons=())) for row in rows],
        )
        return 0


@dataclass(frozen=True)
class BenchPrompts:
    """Mask IoU of the prompt variants (a) to (f) beside the paper's table."""

    capture: Positional[Path]
    """Folder of a capture with true masks."""

    segmenter: str = "sam"
    """Pretrained segmenter whose box model is prompted."""

    box_weights: str | None = None
    """Folder or hub name in place of the model's own weights."""

    device: str = "auto"
    """Where the model runs: auto (CUDA if there is one, else the CPU), cpu, cuda, cuda:1, mps."""

    result: Path | None = None
    """Take the camera's pose from this result.json; otherwise the given masks are calibrated."""

    out: Path | None = None
    """Markdown file to write."""

    def run(self, command_line: str) -> int:
        """Run and print the table."""
        from easyhecpp.bench.prompts import prompts_table, run_prompts_bench
        from easyhecpp.capture import Capture
        from easyhecpp.formats.result_file import ResultFile
        from easyhecpp.models import registry
        from easyhecpp.models.runtime import Runtime
        from easyhecpp.session import CalibrationConfig, calibrate

        capture = Capture.load(self.capture)
        loaded = registry.load(
            self.segmenter,
            box_weights=self.box_weights,
            runtime=Runtime(self.device),
            with_text=False,
        )
        if self.result is not None:
            pose = ResultFile.read(self.result).T_mount_cam
            T_mount_cam = None if pose is None else pose.array
        else:
            complain("no --result given: calibrating with the capture's masks first")
            T_mount_cam = calibrate(capture, CalibrationConfig(segmenter="given")).T_mount_cam
        publish(
            prompts_table(run_prompts_bench(capture, loaded.boxes, T_mount_cam)),
            self.out,
            command_line,
        )
        return 0


Choice = (
    Annotated[BenchSolve, tyro.conf.subcommand("solve")]
    | Annotated[BenchTrust, tyro.conf.subcommand("trust")]
    | Annotated[BenchPrompts, tyro.conf.subcommand("prompts")]
    | Annotated[BenchPhoto, tyro.conf.subcommand("photo")]
    | Annotated[BenchEyeToHand, tyro.conf.subcommand("eye-to-hand")]
    | Annotated[BenchInit, tyro.conf.subcommand("init")]
    | Annotated[BenchTargeting, tyro.conf.subcommand("targeting")]
    | Annotated[BenchBaxter, tyro.conf.subcommand("baxter")]
    | Annotated[BenchMarker, tyro.conf.subcommand("marker")]
    | Annotated[BenchAdam, tyro.conf.subcommand("adam")]
    | Annotated[BenchReal, tyro.conf.subcommand("real")]
    | Annotated[BenchRepeat, tyro.conf.subcommand("repeat")]
)


@dataclass(frozen=True)
class Bench:
    """Reproduce a table of the results page."""

    table: Choice

    def run(self, command_line: str) -> int:
        """Run the table's own command."""
        table = self.table
        if table.out is not None:
            table = replace(table, out=table_file(table.out))
        return table.run(command_line)
