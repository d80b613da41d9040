"""The pages' templates and how values are spelt in them."""

from __future__ import annotations

from functools import cache
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from easyhecpp.formats.result_file import Transform


@cache
def template(name: str) -> Any:
    """A template of this package by its file name."""
    environment = Environment(
        loader=PackageLoader("easyhecpp.report", "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    filters: dict[str, Any] = {
        "anchor": _anchor,
        "code": _code,
        "lack": _lack,
        "matrix": _matrix,
        "numbers": _numbers,
        "shade": _shade,
        "signed": _signed,
        "xyzw": _xyzw,
    }
    environment.filters.update(filters)
    return environment.get_template(name)


def _code(text: str) -> Markup:
    """Text whose backquoted parts become code."""
    parts = text.split("`")
    return Markup("").join(
        Markup("<code>{}</code>").format(part) if i % 2 else escape(part)
        for i, part in enumerate(parts)
    )


def _numbers(values: tuple[float, ...], digits: int = 6) -> str:
    return "  ".join(f"{value + 0.0:+.{digits}f}" for value in values)


def _matrix(transform: Transform) -> str:
    rows = [", ".join(f"{value:+.7f}" for value in row) for row in transform.matrix[:3]]
    return "[[" + "],\n [".join([*rows, "0, 0, 0, 1"]) + "]]"


def _xyzw(quat_wxyz: tuple[float, ...]) -> tuple[float, ...]:
    return (*quat_wxyz[1:], quat_wxyz[0])


def _signed(value: float) -> str:
    """With its sign and one decimal; plain 0.0 for what rounds to nothing."""
    return f"{value:+.1f}" if abs(value) >= 0.05 else "0.0"


def _shade(value: float) -> str:
    """Background of a table's cell: blue for inward, red for outward, none for nothing."""
    share = min(1.0, abs(value) / 3.0)
    colour = "220 60 50" if value > 0 else "45 105 220"
    return f"background: rgb({colour} / {0.55 * share:.2f})"


def _lack(score: float) -> str:
    """Background of a table's cell: red for a score of 0, none for 1."""
    return f"background: rgb(220 60 50 / {0.55 * (1.0 - min(1.0, max(0.0, score))):.2f})"


def _anchor(view_id: str) -> str:
    """A view's name as it may stand in an element's id and in a link to it."""
    return "".join(c if c.isalnum() and c.isascii() else f"_{ord(c):x}" for c in view_id)
