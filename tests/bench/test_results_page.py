"""The generator of the results page, as a script beside the package."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest


@pytest.fixture(scope="module")
def script() -> ModuleType:
    path = Path(__file__).parents[2] / "benchmarks" / "results_page.py"
    spec = importlib.util.spec_from_file_location("results_page", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_tables_come_in_order_with_pictures_that_the_page_finds(script: ModuleType, tmp_path: Path):
    results, docs = tmp_path / "benchmarks" / "results", tmp_path / "docs"
    results.mkdir(parents=True)
    (results / "zebra.md").write_text("### Zebra\n")
    (results / "photo.md").write_text("### Photo\n\n![Photo, all](photo.png)\n")
    (results / "eye_to_hand_masks.md").write_text("### Main\n")
    text = script.tables(results, docs)
    assert text == (
        "### Main\n\n### Photo\n\n![Photo, all](../benchmarks/results/photo.png)\n\n### Zebra"
    )


def test_only_what_stands_between_the_markers_changes(script: ModuleType):
    page = f"Words.\n{script.BEGIN}\nold\n{script.END}\nMore words.\n"
    new = script.with_tables(page, "new")
    assert new == f"Words.\n{script.BEGIN}\n\nnew\n\n{script.END}\nMore words.\n"
    assert script.with_tables(new, "new") == new
    with pytest.raises(SystemExit, match="lacks the lines"):
        script.with_tables("Words.", "new")


def test_the_page_in_the_repository_holds_the_tables_as_they_are(script: ModuleType):
    page = script.PAGE.read_text(encoding="utf-8")
    anew = script.with_tables(page, script.tables(script.RESULTS, script.PAGE.parent))
    assert page == anew, "run: python benchmarks/results_page.py"
