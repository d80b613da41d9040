"""Result tables, the same for every benchmark, and the machine that they were made on."""

from __future__ import annotations

import json
import math
import os
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import metadata
from pathlib import Path
from typing import Any

import rich.table

from easyhecpp import __version__
from easyhecpp._parallel import usable_cores

Cell = str | int | float | None

_TOLD = 3
_PACKAGES = ("numpy", "scipy", "numba", "opencv-python-headless", "trimesh")


@dataclass(frozen=True)
class Table:
    """A small table of results.

    Attributes:
        title: what was measured.
        columns: headings, with units.
        rows: cells; None is an empty one, and a number is shown with three significant digits.
        notes: sentences that belong below the table.
    """

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    notes: tuple[str, ...] = field(default=())

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                raise ValueError(f"{len(row)} cells for {len(self.columns)} columns: {row}")

    def to_markdown(self) -> str:
        """The table as GitHub's markdown; numbers are aligned to the right."""
        ruler = ["---:" if numeric else "---" for numeric in self._numeric()]
        lines = [f"### {self.title}", ""]
        for cells in (self.columns, ruler, *self._texts()):
            lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
        for note in self.notes:
            lines += ["", note]
        return "\n".join(lines) + "\n"

    def to_rich(self) -> rich.table.Table:
        """The table for a terminal."""
        table = rich.table.Table(title=self.title, caption="\n".join(self.notes) or None)
        for column, numeric in zip(self.columns, self._numeric(), strict=True):
            table.add_column(column, justify="right" if numeric else "left")
        for cells in self._texts():
            table.add_row(*cells)
        return table

    def to_json(self, **more: Any) -> str:
        """The table as JSON, numbers unrounded, with anything else that should stand beside it."""
        content = {
            "title": self.title,
            "rows": [dict(zip(self.columns, row, strict=True)) for row in self.rows],
            "notes": list(self.notes),
            **more,
        }
        return json.dumps(_finite(content), indent=1, allow_nan=False) + "\n"

    def _numeric(self) -> list[bool]:
        cells = zip(*self.rows, strict=True) if self.rows else ((),) * len(self.columns)
        return [all(not isinstance(cell, str) for cell in column) for column in cells]

    def _texts(self) -> list[list[str]]:
        return [[_text(cell) for cell in row] for row in self.rows]


def failure_notes(failures: Sequence[tuple[str, str]]) -> tuple[str, ...]:
    """What the first failures said, for below a table; the others are counted.

    Args:
        failures: Where each happened, and its text.
    """
    told = tuple(f"Failed, {where}: {text}" for where, text in failures[:_TOLD])
    more = len(failures) - len(told)
    return (*told, f"{more} more failed.") if more else told


def describe_machine() -> dict[str, Any]:
    """Processor, cores, memory, Python and the versions that matter, for below a table."""
    return {
        "cpu": _cpu_model(),
        "cores": usable_cores(),
        "memory_gb": _memory_gb(),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "easyhecpp": __version__,
        "packages": {name: metadata.version(name) for name in _PACKAGES if _installed(name)},
    }


def machine_sentence(machine: Mapping[str, Any]) -> str:
    """One line for below a table."""
    packages = ", ".join(f"{name} {version}" for name, version in machine["packages"].items())
    return (
        f"{machine['cpu']}, {machine['cores']} cores, {machine['memory_gb']} GB, "
        f"{machine['system']}, Python {machine['python']}, easyhecpp {machine['easyhecpp']}, "
        f"{packages}."
    )


def _text(cell: Cell) -> str:
    if cell is None:
        return ""
    if isinstance(cell, float):
        if not math.isfinite(cell):
            return "-" if math.isnan(cell) else "inf"
        digits = 2 - math.floor(math.log10(abs(cell))) if cell else 0
        return f"{cell:.{max(0, min(digits, 6))}f}"
    return str(cell)


def _finite(content: Any) -> Any:
    """JSON knows neither infinity nor not-a-number: both become null."""
    if isinstance(content, float):
        return content if math.isfinite(content) else None
    if isinstance(content, Mapping):
        return {key: _finite(value) for key, value in content.items()}
    if isinstance(content, Sequence) and not isinstance(content, str):
        return [_finite(value) for value in content]
    return content


def _cpu_model() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return " ".join(line.split(":", 1)[1].split())
    except OSError:  # not on Linux
        pass
    return platform.processor() or platform.machine() or "unknown processor"


def _memory_gb() -> int | None:
    try:
        return round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30)
    except (AttributeError, ValueError, OSError):  # not on Windows
        return None


def _installed(name: str) -> bool:
    try:
        metadata.version(name)
    except metadata.PackageNotFoundError:
        return False
    return True
