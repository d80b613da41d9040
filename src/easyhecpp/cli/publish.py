"""Where the tables of ``easyhecpp bench`` go: the terminal, and three files side by side."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from easyhecpp.cli.output import say

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from easyhecpp.bench.table import Table


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


def rows_file(out: Path | None) -> Path | None:
    """Where a long run keeps finished scenes, beside its table; None without one."""
    return None if out is None else out.with_suffix(".rows.jsonl")


def _show(table: Table) -> None:
    """Drawn on a terminal; as markdown into a pipe or a file, where lines have no width."""
    from rich.console import Console

    console = Console()
    if console.is_terminal:
        console.print(table.to_rich())
    else:
        say(table.to_markdown())
