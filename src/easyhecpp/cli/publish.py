"""Where the tables of ``easyhecpp bench`` go: the terminal, and three files side by side."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from easyhecpp.cli.output import say
from easyhecpp.errors import InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from easyhecpp.bench.table import Table

_ROWS = ".rows.jsonl"
_NAME = "the name of a file that ends in .md, such as results/table.md"


def publish(
    table: Table,
    out: Path | None,
    command_line: str,
    *,
    figure: Figure | None = None,
    **more: Any,
) -> None:
    """Print a table; with ``out``, write it as markdown, JSON and a plot.

    Args:
        table: The table.
        out: The markdown file; the others stand beside it with suffixes ``.json`` and ``.png``.
        command_line: What was typed, for the record.
        figure: The plot.
        more: What else belongs into the JSON: the rows of all scenes, the seed, the machine.

    Raises:
        InputError: A file cannot be written.
    """
    from easyhecpp._atomic import atomic_path, write_text

    _show(table)
    if out is None:
        return
    written = [out, out.with_suffix(".json")]
    text = table.to_markdown()
    if figure is not None:
        written.append(out.with_suffix(".png"))
        with atomic_path(written[-1]) as path:
            figure.savefig(path, dpi=110)
        text += f"\n![{table.title}]({written[-1].name})\n"
    write_text(out, f"{text}\nCommand: `{command_line}`\n")
    write_text(written[1], table.to_json(command=command_line, **more))
    say(f"written: {', '.join(map(str, written))}")


def table_file(out: Path) -> Path:
    """The markdown file that a table is written to, looked at before the work begins.

    Args:
        out: As the user named it; without a suffix it gets ``.md``.

    Raises:
        InputError: The name ends otherwise, so that what is written beside it could be the same
            file, or nothing can be written there.
    """
    if not out.suffix and not out.is_dir():
        out = out.with_suffix(".md")
    for path in (out, *(out.with_suffix(end) for end in (".json", ".png", _ROWS) if out.name)):
        if path.is_dir():
            raise InputError(f"'{path}' is a folder", where="--out", expected=_NAME)
    if out.suffix.lower() != ".md":
        raise InputError(f"'{out}' is no markdown file", where="--out", expected=_NAME)
    above = next(folder for folder in out.absolute().parents if folder.exists())
    if not above.is_dir() or not os.access(above, os.W_OK):
        raise InputError(
            f"'{above}' is no folder that can be written",
            where="--out",
            expected="a place that you may write to",
        )
    return out


def rows_file(out: Path | None) -> Path | None:
    """Where a long run keeps finished scenes, beside its table; None without one."""
    return None if out is None else out.with_suffix(_ROWS)


def _show(table: Table) -> None:
    """Drawn on a terminal; as markdown into a pipe or a file, where lines have no width."""
    from rich.console import Console

    console = Console()
    if console.is_terminal:
        console.print(table.to_rich())
    else:
        say(table.to_markdown())
