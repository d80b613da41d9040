"""`joints.csv` as a table of numbers: a row per view, a column per name, no robot yet."""

from __future__ import annotations

import csv
import io
import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from easyhecpp._paths import reason
from easyhecpp.capture._text import listing, plural
from easyhecpp.capture.image_files import IMAGE_SUFFIXES
from easyhecpp.capture.problems import Findings, Problem
from easyhecpp.errors import InputError

VIEW_COLUMN = "view"

_LAYOUT = "a header 'view,JOINT,JOINT,...' with the robot's joint names, then one row per view"


@dataclass(frozen=True)
class JointTable:
    """The rows that could be read.

    Attributes:
        columns: The header without the view column.
        rows: Values by view id, NaN in cells that are not numbers.
        views: Ids of all rows, also of those that could not be read.
        texts: Cells that are not finite numbers: (view, line, column, text).
        path: The file.
    """

    columns: tuple[str, ...]
    rows: dict[str, NDArray[np.float64]]
    views: tuple[str, ...]
    texts: tuple[tuple[str, int, str, str], ...]
    path: Path


def read_joint_table(path: Path, findings: Findings) -> JointTable:
    """Read the table; what is wrong with single rows goes into ``findings``.

    Raises:
        InputError: The file cannot be read, or its header is no header.
    """
    lines = _lines(path)
    header = [cell.strip() for cell in lines[0][1]]
    columns = _checked_header(header, path)
    if len(lines) == 1:
        raise InputError("The table of joints has no rows", where=path, expected=_LAYOUT)
    view_index = header.index(VIEW_COLUMN)
    rows: dict[str, NDArray[np.float64]] = {}
    line_of: dict[str, int] = {}
    texts: list[tuple[str, int, str, str]] = []
    for line, cells in lines[1:]:
        view = _view_id(cells[view_index]) if view_index < len(cells) else ""
        problem = _row_problem(view, cells, len(header), line_of, f"{path}, line {line}")
        if problem is not None:
            findings.add(problem)
        line_of.setdefault(view, line)
        if problem is not None:
            continue
        values = [cell for index, cell in enumerate(cells) if index != view_index]
        rows[view] = np.array([_value(cell) for cell in values])
        texts += [
            (view, line, name, cell.strip())
            for name, cell in zip(columns, values, strict=True)
            if not math.isfinite(_value(cell))
        ]
    return JointTable(columns, rows, tuple(line_of), tuple(texts), path)


def _row_problem(
    view: str, cells: list[str], n_columns: int, line_of: dict[str, int], where: str
) -> Problem | None:
    """What keeps a row from being read, if anything; ``line_of`` holds the rows before it."""
    if not view:
        return Problem("error", "The row names no view", where, "Enter the name of its image")
    if view in line_of:
        return Problem(
            "error",
            f"View '{view}' has a second row; its first is in line {line_of[view]}",
            where,
            "Delete the wrong one",
            "one row per view",
            (view,),
            "view",
        )
    if len(cells) != n_columns:
        return Problem(
            "error",
            f"The row of view '{view}' has {plural(len(cells), 'cell')}, the header {n_columns}",
            where,
            "Complete or delete the row",
            "one cell per column, numbers with a decimal point",
            (view,),
            "view",
        )
    return None


def _lines(path: Path) -> list[tuple[int, list[str]]]:
    """Lines that are not blank, each with its number in the file."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except FileNotFoundError as error:
        raise InputError(
            "There is no table of joint positions",
            where=path,
            expected=_LAYOUT,
            fix="Write joints.csv, or name the file in capture.yaml: 'joints: FILE'",
        ) from error
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(
            f"The table of joints cannot be read: {reason(error)}",
            where=path,
            fix="Make it a text file that you may read",
        ) from error
    lines = [(line, cells) for line, cells in _rows(text, path) if any(c.strip() for c in cells)]
    if not lines:
        raise InputError("The table of joints is empty", where=path, expected=_LAYOUT)
    return lines


def _rows(text: str, path: Path) -> Iterator[tuple[int, list[str]]]:
    """The rows of the file, each with the number of its last line."""
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    line = 0
    try:
        for cells in reader:
            line = reader.line_num
            yield line, cells
    except csv.Error as error:
        raise InputError(
            f"The table of joints is no table from here on: {error}",
            where=f"{path}, line {line + 1}",
            expected="numbers between commas; what opens with a quotation mark closes with one",
            fix="Correct the line, or export the table again",
        ) from error


def _checked_header(header: list[str], path: Path) -> tuple[str, ...]:
    """The columns' names without the view column."""
    if len(header) == 1 and any(mark in header[0] for mark in ";\t"):
        raise InputError(
            "The table of joints is not separated by commas",
            where=path,
            expected=_LAYOUT,
            fix="Export it with commas between cells and points in the numbers",
        )
    twice = [name for name, count in Counter(header).items() if count > 1]
    if twice:
        raise InputError(
            f"Column {listing(twice)} stands more than once in the table of joints",
            where=path,
            expected=_LAYOUT,
            fix="Keep one of them",
        )
    if VIEW_COLUMN not in header:
        raise InputError(
            f"The table of joints has no column '{VIEW_COLUMN}'; its header is {listing(header)}",
            where=path,
            expected=_LAYOUT,
            fix="Name the column that holds the images' names 'view'",
        )
    return tuple(name for name in header if name != VIEW_COLUMN)


def _view_id(cell: str) -> str:
    """A view's id; an image's file name stands for its stem."""
    name = cell.strip()
    suffix = next((end for end in IMAGE_SUFFIXES if name.lower().endswith(end)), "")
    return name[: len(name) - len(suffix)]


def _value(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return math.nan
