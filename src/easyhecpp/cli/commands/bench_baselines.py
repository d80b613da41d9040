"""``easyhecpp bench``: ours beside other ways to the same pose."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from easyhecpp.cli.commands.bench_pictures import picture_size
from easyhecpp.cli.output import progress
from easyhecpp.cli.publish import publish, rows_file


@dataclass(frozen=True)
class BenchMarker:
    """Marker-based hand-eye calibration, seven solvers, beside ours without a marker."""

    scenes: int = 10
    """Number of scenes; 100 for the whole table."""

    seed: int = 1000
    """Scene i of a seed is always the same."""

    poses: int = 20
    """Joint poses that show the board."""

    board: Literal["chessboard", "charuco"] = "chessboard"
    """What is screwed to the arm."""

    robot: str = "xarm7"
    """The arm, by name or the path of its URDF."""

    ee_link: str | None = None
    """The link that holds the board; when left out, the known one of an arm by name, or the last
    link of the longest chain of a URDF."""

    size: str = "1280x720"
    """Of the pictures, WIDTHxHEIGHT."""

    workers: int = 1
    """Processes side by side; the seconds in the table are honest with one only."""

    out: Path | None = None
    """Markdown file to write; a .json and a .png stand beside it, and a .rows.jsonl that an
    interrupted run goes on from."""

    def run(self, command_line: str) -> int:
        """Run and print the table."""
        from easyhecpp.bench.marker import (
            JUDGE,
            MarkerBench,
            marker_plot,
            marker_table,
            run_marker_bench,
        )
        from easyhecpp.bench.table import describe_machine

        bench = MarkerBench(
            self.scenes,
            self.seed,
            self.poses,
            self.board,
            self.robot,
            picture_size(self.size),
            self.ee_link,
        )
        with progress(quiet=False) as tell:
            rows = run_marker_bench(
                bench,
                rows_file=rows_file(self.out),
                workers=self.workers,
                progress=lambda done, last: tell(
                    f"{done} of {self.scenes} scenes; "
                    + ", ".join(
                        f"{r.method}: {r.status or f'{r.position_mm:.2f} mm'}"
                        for r in last
                        if r.method in (JUDGE, "ours")
                    )
                ),
            )
        publish(
            marker_table(bench, rows),
            self.out,
            command_line,
            figure=marker_plot(bench, rows),
            settings=bench.settings(),
            all_rows=[dataclasses.asdict(row) for row in rows],
            machine=describe_machine(),
        )
        return 0


@dataclass(frozen=True)
class BenchAdam:
    """EasyHeC's optimiser beside ours: same masks, start, renderer and threads (extra models)."""

    scenes: int = 10
    """Number of scenes."""

    seed: int = 1000
    """Scene i of a seed is always the same."""

    views: int = 5
    """Random views of each scene."""

    steps: int = 1000
    """Steps of Adam."""

    robot: str = "xarm7"
    """The arm, by name or the path of its URDF."""

    size: str = "1280x720"
    """Of the masks, WIDTHxHEIGHT."""

    combine: Literal["union", "sum"] = "union"
    """How Adam's rendering puts links together: exact union, or min(1, sum) as published, which is
    eight times slower."""

    half_pixel: bool = False
    """Let Adam count pixels from the picture's edge, as the published code does."""

    out: Path | None = None
    """Markdown file to write; a .json and a .png stand beside it, and a .rows.jsonl that an
    interrupted run goes on from."""

    def run(self, command_line: str) -> int:
        """Run and print the table."""
        from easyhecpp.bench.adam import AdamBench, run_adam_bench
        from easyhecpp.bench.adam_table import adam_plot, adam_table
        from easyhecpp.bench.table import describe_machine

        bench = AdamBench(
            self.scenes,
            self.seed,
            self.views,
            self.steps,
            self.robot,
            picture_size(self.size),
            self.combine,
            self.half_pixel,
        )
        with progress(quiet=False) as tell:
            rows = run_adam_bench(
                bench,
                rows_file=rows_file(self.out),
                progress=lambda done, last: tell(
                    f"{done} of {self.scenes} scenes; "
                    + ", ".join(
                        f"{r.method}: {r.status or f'{r.position_mm:.2f} mm'}" for r in last
                    )
                ),
            )
        publish(
            adam_table(bench, rows),
            self.out,
            command_line,
            figure=adam_plot(bench, rows),
            settings=bench.settings(),
            all_rows=[dataclasses.asdict(row) for row in rows],
            machine=describe_machine(),
        )
        return 0
