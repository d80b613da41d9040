"""``easyhecpp bench``: the paper's tables."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from easyhecpp.cli.commands.bench_pictures import picture_size
from easyhecpp.cli.output import progress
from easyhecpp.cli.publish import publish, rows_file

if TYPE_CHECKING:
    from easyhecpp.bench.eye_to_hand import Step


@dataclass(frozen=True)
class BenchEyeToHand:
    """Error over the number of views, chosen one after the other, beside the published rows."""

    scenes: int = 10
    """Number of scenes; 100 for the whole table."""

    seed: int = 1000
    """Scene i of a seed is always the same."""

    views: int = 5
    """Largest number of views."""

    source: Literal["masks", "images"] = "masks"
    """Masks at the IoU of the paper's, or photo-real images alone."""

    choose: tuple[str, ...] = ("information",)
    """Ways of choosing joint poses: information, consistency (the paper's), random; several are
    run on the same scenes."""

    first: Literal["informative", "zero"] = "informative"
    """First joint pose: one that tells much for cameras anywhere, or all zeros as published."""

    robot: str = "xarm7"
    """The arm, by name or the path of its URDF."""

    size: str = "1280x720"
    """Of the pictures, WIDTHxHEIGHT."""

    spp: int = 12
    """Light paths per pixel, for images."""

    extra: int = 4
    """Pictures beside the counted views that tell the background, for images."""

    workers: int = 1
    """Processes side by side; the seconds in the table are honest with one only."""

    out: Path | None = None
    """Markdown file to write; a .json and a .png stand beside it, and a .rows.jsonl that an
    interrupted run goes on from."""

    def run(self, command_line: str) -> int:
        """Run and print the table."""
        from easyhecpp.bench.eye_to_hand import EyeToHandBench, run_eye_to_hand
        from easyhecpp.bench.eye_to_hand_table import eye_to_hand_plot, eye_to_hand_table
        from easyhecpp.bench.table import describe_machine

        bench = EyeToHandBench(
            self.scenes,
            self.seed,
            self.views,
            self.source,
            self.choose,
            self.first,
            self.robot,
            picture_size(self.size),
            self.spp,
            self.extra,
        )
        with progress(quiet=False) as tell:
            steps = run_eye_to_hand(
                bench,
                rows_file=rows_file(self.out),
                workers=self.workers,
                progress=lambda done, last: tell(
                    f"{done} of {self.scenes} scenes; {_said(last, self.views)}"
                ),
            )
        publish(
            eye_to_hand_table(bench, steps),
            self.out,
            command_line,
            figure=eye_to_hand_plot(bench, steps),
            settings=bench.settings(),
            all_rows=[dataclasses.asdict(step) for step in steps],
            machine=describe_machine(),
        )
        return 0


def _said(steps: tuple[Step, ...], views: int) -> str:
    """The errors after the last view of a scene."""
    last = [step for step in steps if step.views == views]
    return ", ".join(
        f"{s.choose}: " + (f"{s.position_mm:.2f} mm" if s.position_mm is not None else s.status)
        for s in last
    )


@dataclass(frozen=True)
class BenchInit:
    """First pose without a guess, beside the published ways."""

    scenes: int = 10
    """Number of scenes; 100 for the whole table."""

    seed: int = 1000
    """Scene i of a seed is always the same."""

    views: int = 5
    """Joint poses that the arm is driven to, the same in all scenes."""

    robot: str = "xarm7"
    """The arm, by name or the path of its URDF."""

    size: str = "1280x720"
    """Of the masks, WIDTHxHEIGHT."""

    workers: int = 1
    """Processes side by side; the seconds in the table are honest with one only."""

    out: Path | None = None
    """Markdown file to write; a .json and a .png stand beside it, and a .rows.jsonl that an
    interrupted run goes on from."""

    def run(self, command_line: str) -> int:
        """Run and print the table."""
        from easyhecpp.bench.init import InitBench, init_plot, init_table, run_init_bench
        from easyhecpp.bench.table import describe_machine

        bench = InitBench(self.scenes, self.seed, self.views, self.robot, picture_size(self.size))
        with progress(quiet=False) as tell:
            rows = run_init_bench(
                bench,
                rows_file=rows_file(self.out),
                workers=self.workers,
                progress=lambda done, last: tell(f"{done} of {self.scenes} scenes"),
            )
        publish(
            init_table(bench, rows),
            self.out,
            command_line,
            figure=init_plot(rows),
            settings=bench.settings(),
            all_rows=[dataclasses.asdict(row) for row in rows],
            machine=describe_machine(),
        )
        return 0
