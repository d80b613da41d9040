"""The texts that docs/troubleshooting.md is keyed by are those that the program prints."""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path

import pytest

import easyhecpp
from easyhecpp.report.wording import FLAGS as EXPLAINED

SOURCE = Path(easyhecpp.__file__).parent
PAGE = Path(__file__).parents[1] / "docs" / "troubleshooting.md"

VARIES = "…"
"""Stands for every placeholder of an f-string, here and on the page."""


@cache
def texts() -> frozenset[str]:
    """All strings in the source, placeholders replaced."""
    found: set[str] = set()
    for path in SOURCE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.JoinedStr):
                parts = [p.value if isinstance(p, ast.Constant) else VARIES for p in node.values]
                found.add("".join(map(str, parts)))
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                found.add(node.value)
    return frozenset(found)


def symptoms() -> list[str]:
    rows = re.findall(r"^\| (.*?) \|", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    return rows[1:]  # without the heading


QUOTED = [quote for row in symptoms() for quote in re.findall(r'"([^"]+)"', row)]
FLAGS = [flag for row in symptoms() for flag in re.findall("flagged `([^`]+)`", row)]


def test_the_page_quotes() -> None:
    assert len(QUOTED) > 10
    assert len(FLAGS) > 3


@pytest.mark.parametrize("quote", QUOTED)
def test_the_program_says_so(quote: str) -> None:
    assert any(quote in text for text in texts())


def test_every_flag_of_a_view_is_explained() -> None:
    assert set(FLAGS) == set(EXPLAINED)
