"""``easyhecpp bench`` on recordings."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from easyhecpp.cli.output import progress
from easyhecpp.cli.publish import publish


@dataclass(frozen=True)
class BenchRepeat:
    """How well two halves of a recording agree, from given masks and from images alone."""

    capture: Positional[Path]
    """Folder of a capture with six views or more."""

    splits: int = 20
    """How often the views are dealt out."""

    seed: int = 1000
    """Split i of a seed is always the same."""

    workers: int = 1
    """Processes side by side."""

    out: Path | None = None
    """Markdown file to write; a .json of all splits is written beside it."""

    def run(self, command_line: str) -> int:
        """Run and print the table."""
        from easyhecpp.bench.repeat import repeat_table, run_repeat_bench
        from easyhecpp.capture import Capture

        capture = Capture.load(self.capture)
        with progress(quiet=False) as tell:
            rows = run_repeat_bench(
                capture,
                splits=self.splits,
                seed=self.seed,
                workers=self.workers,
                progress=lambda done: tell(f"{done} pairs of halves"),
            )
        publish(
            repeat_table(capture, rows, self.seed),
            self.out,
            command_line,
            all_rows=[dataclasses.asdict(row) for row in rows],
        )
        return 0


@dataclass(frozen=True)
class BenchReal:
    """Recordings whose truth is known, or pairs of a stereo camera."""

    folder: Positional[Path]
    """Holds captures with a truth.json each; docs/benchmarks.md describes that file."""

    segmenter: str = "auto"
    """Where masks come from, as in calibrate."""

    edges: bool = True
    """Whether the outline is fitted to the image's own edges after the masks."""

    out: Path | None = None
    """Markdown file to write; a .json and a .png stand beside it."""

    def run(self, command_line: str) -> int:
        """Run and print the table."""
        from easyhecpp.bench.real import real_plot, real_table, run_real_bench
        from easyhecpp.bench.table import describe_machine
        from easyhecpp.session import CalibrationConfig

        config = CalibrationConfig(segmenter=self.segmenter, edges=self.edges)
        with progress(quiet=False) as tell:
            rows = run_real_bench(self.folder, config, progress=tell)
        publish(
            real_table(self.folder, rows),
            self.out,
            command_line,
            figure=real_plot(rows),
            all_rows=[dataclasses.asdict(row) for row in rows],
            machine=describe_machine(),
        )
        return 0
