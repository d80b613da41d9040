"""``easyhecpp bench`` on photo-real pictures."""

from __future__ import annotations

import dataclasses
import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from easyhecpp.cli.output import progress
from easyhecpp.cli.publish import publish, rows_file
from easyhecpp.errors import InputError

if TYPE_CHECKING:
    from easyhecpp.bench.photo import PhotoRow


@dataclass(frozen=True)
class BenchPhoto:
    """Photo-real scenes of several arms, calibrated from images alone, without weights."""

    scenes: int = 20
    """Number of scenes; the arms take turns."""

    seed: int = 1000
    """Scene i of a seed is always the same."""

    robots: tuple[str, ...] = ()
    """The arms by name or the paths of their URDFs; five arms when left out."""

    views: int = 6
    """Pictures per scene."""

    size: str = "960x540"
    """Of the pictures, WIDTHxHEIGHT."""

    spp: int = 12
    """Light paths per pixel."""

    difficulty: str = "normal"
    """Of the cells: easy, normal, anywhere (any side, the camera turned by any angle) or hard."""

    workers: int = 1
    """Processes side by side; the seconds in the table are honest with one only."""

    keep: Path | None = None
    """Folder that keeps the pictures; otherwise every scene is removed when it is done."""

    out: Path | None = None
    """Markdown file to write; a .json and a .png stand beside it, and a .rows.jsonl that an
    interrupted run goes on from."""

    def run(self, command_line: str) -> int:
        """Run and print the table."""
        from easyhecpp.bench.photo import ARMS, PhotoBench, run_photo_bench
        from easyhecpp.bench.photo_table import photo_plot, photo_table
        from easyhecpp.bench.table import describe_machine

        bench = PhotoBench(
            self.scenes,
            self.seed,
            self.robots or ARMS,
            self.views,
            picture_size(self.size),
            self.spp,
            self.difficulty,
        )
        with progress(quiet=False) as tell:
            rows = run_photo_bench(
                bench,
                folder=self.keep,
                rows_file=rows_file(self.out),
                workers=self.workers,
                progress=lambda done, row: tell(f"{done} of {self.scenes} scenes; {_said(row)}"),
            )
        publish(
            photo_table(bench, rows),
            self.out,
            command_line,
            figure=photo_plot(rows),
            settings=bench.settings(),
            all_rows=[dataclasses.asdict(row) for row in rows],
            machine=describe_machine(),
        )
        return 0


def picture_size(text: str) -> tuple[int, int]:
    """Width and height out of ``960x540``.

    Raises:
        InputError: It is not written like that, or a side is under 64 pixels.
    """
    found = re.fullmatch(r"(\d+)x(\d+)", text.strip())
    if found is None or min(int(n) for n in found.groups()) < 64:
        raise InputError(
            f"{text!r} is no size of a picture", where="--size", expected="such as 960x540"
        )
    return int(found[1]), int(found[2])


def _said(row: PhotoRow) -> str:
    if row.error is None:
        return f"scene {row.scene}, {row.arm}: {row.reasons[0]}"
    return (
        f"scene {row.scene}, {row.arm}: {row.error.position_mm:.2f} mm, "
        f"{row.error.rotation_deg:.3f} deg, {row.verdict}"
    )
