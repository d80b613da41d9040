"""Times the parts of a calibration and writes tables with the machine they were made on.

    python benchmarks/run.py                 all of it, some minutes
    python benchmarks/run.py rasterising     one part: rasterising, calibrating, exploring,
                                             photographing, command
    python benchmarks/run.py --quick         a look, not a measurement

Every part writes ``benchmarks/results/<part>.md`` and ``.json``. Nothing is asserted: seconds
depend on the machine and on what else it does.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import calibrating
import command
import exploring
import photographing
import rasterising

from easyhecpp._atomic import write_text
from easyhecpp.bench.table import Table, describe_machine, machine_sentence

RESULTS = Path(__file__).parent / "results"
SEED = 5


def main() -> None:
    """Run the parts that were asked for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parts: dict[str, Callable[[bool], Table]] = {
        "rasterising": lambda quick: rasterising.run(SEED, 0.2 if quick else 3.0),
        "calibrating": lambda quick: calibrating.run(SEED, 0.1 if quick else 20.0),
        "exploring": lambda quick: exploring.run(SEED, 0.1 if quick else 10.0),
        "photographing": lambda quick: photographing.run(SEED, 0.1 if quick else 20.0),
        "command": lambda quick: command.run(1 if quick else 5),
    }
    parser.add_argument("parts", nargs="*", help=f"some of: {', '.join(parts)}; default all")
    parser.add_argument("--quick", action="store_true", help="few repeats")
    parser.add_argument("--out", type=Path, default=RESULTS, help="folder for the tables")
    words = parser.parse_args()
    unknown = set(words.parts) - set(parts)
    if unknown:
        parser.error(f"unknown: {', '.join(sorted(unknown))}; there are {', '.join(parts)}")
    machine = describe_machine()
    for name in words.parts or parts:
        table = parts[name](words.quick)
        table = replace(table, notes=(*table.notes, machine_sentence(machine)))
        text = table.to_markdown()
        words.out.mkdir(parents=True, exist_ok=True)
        write_text(words.out / f"{name}.md", text)
        write_text(words.out / f"{name}.json", table.to_json(machine=machine, quick=words.quick))
        print(text)


if __name__ == "__main__":
    main()
