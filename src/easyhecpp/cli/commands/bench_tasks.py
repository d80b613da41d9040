"""``easyhecpp bench``: what a calibration is good for."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from easyhecpp.cli.commands.bench_pictures import picture_size
from easyhecpp.cli.output import progress
from easyhecpp.cli.publish import publish, rows_file


@dataclass(frozen=True)
class BenchTargeting:
    """The tip sent to a corner that the calibrated camera sees: by how much it misses."""

    scenes: int = 10
    """Number of scenes."""

    seed: int = 1000
    """Scene i of a seed is always the same."""

    trials: int = 10
    """Corners per scene."""

    views: int = 5
    """Views of the calibration."""

    source: Literal["masks", "images"] = "masks"
    """Calibrated from masks at the IoU of the paper's, or from photo-real images alone."""

    robot: str = "xarm7"
    """The arm, by name or the path of its URDF."""

    ee_link: str | None = None
    """The link that is sent to the corner; when left out, the known one of an arm by name, or the
    last link of the longest chain of a URDF."""

    size: str = "1280x720"
    """Of the pictures, WIDTHxHEIGHT."""

    workers: int = 1
    """Processes side by side."""

    out: Path | None = None
    """Markdown file to write; a .json and a .png stand beside it, and a .rows.jsonl that an
    interrupted run goes on from."""

    def run(self, command_line: str) -> int:
        """Run and print the table."""
        from easyhecpp.bench.eye_to_hand import EyeToHandBench
        from easyhecpp.bench.table import describe_machine
        from easyhecpp.bench.targeting import run_targeting, targeting_plot, targeting_table

        bench = EyeToHandBench(
            self.scenes,
            self.seed,
            self.views,
            self.source,
            robot=self.robot,
            size=picture_size(self.size),
        )
        with progress(quiet=False) as tell:
            targets = run_targeting(
                bench,
                self.trials,
                ee_link=self.ee_link,
                rows_file=rows_file(self.out),
                workers=self.workers,
                progress=lambda done, _: tell(f"{done} of {self.scenes} scenes"),
            )
        publish(
            targeting_table(bench, targets),
            self.out,
            command_line,
            figure=targeting_plot(targets),
            settings=bench.settings(),
            all_rows=[dataclasses.asdict(target) for target in targets],
            machine=describe_machine(),
        )
        return 0


@dataclass(frozen=True)
class BenchBaxter:
    """PCK of the Baxter's end effector, on the published recording or a simulated stand-in."""

    data: Path | None = None
    """Folder of the published recording; without it, simulated scenes take its place."""

    segmenter: str = "auto"
    """Where masks of the recording come from, as in calibrate."""

    scenes: int = 5
    """Camera poses of the stand-in."""

    seed: int = 1000
    """Scene i of a seed is always the same."""

    size: str = "1024x768"
    """Of the stand-in's masks, WIDTHxHEIGHT; 4 : 3 as the recording's."""

    workers: int = 1
    """Processes side by side."""

    out: Path | None = None
    """Markdown file to write; a .json and a .png stand beside it."""

    def run(self, command_line: str) -> int:
        """Run and print the table."""
        from easyhecpp.bench.baxter import (
            baxter_plot,
            baxter_table,
            run_baxter_recording,
            run_baxter_stand_in,
        )
        from easyhecpp.bench.table import describe_machine

        with progress(quiet=False) as tell:
            if self.data is not None:
                bench = run_baxter_recording(self.data, self.segmenter)
            else:
                bench = run_baxter_stand_in(
                    scenes=self.scenes,
                    seed=self.seed,
                    size=picture_size(self.size),
                    workers=self.workers,
                    progress=lambda done: tell(f"{done} of {self.scenes} scenes"),
                )
        publish(
            baxter_table(bench),
            self.out,
            command_line,
            figure=baxter_plot(bench),
            all_rows={
                count: {"pixels": errors.pixels.tolist(), "metres": errors.metres.tolist()}
                for count, errors in bench.views.items()
            },
            machine=describe_machine(),
        )
        return 0
