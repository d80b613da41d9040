"""The table commands: what they write, and what they refuse; `bench` has tests of its own."""

from __future__ import annotations

import importlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from small_arm import write_urdf

from easyhecpp.bench.adam import AdamRow
from easyhecpp.bench.baxter import BaxterBench
from easyhecpp.bench.eye_to_hand import Step
from easyhecpp.bench.init import InitRow
from easyhecpp.bench.marker import MarkerRow
from easyhecpp.bench.metrics import PoseError
from easyhecpp.bench.pck import KeypointErrors
from easyhecpp.bench.photo import PhotoRow
from easyhecpp.bench.real import RealRow
from easyhecpp.bench.targeting import Target
from easyhecpp.cli import main

ERRORS = KeypointErrors(np.array([5.0, 500.0]), np.array([0.01, np.inf]))

TABLES: dict[str, tuple[list[str], str, Any]] = {
    "photo": (
        ["photo", "--scenes", "2", "--robots", "xarm7", "--size", "96x64"],
        "photo.run_photo_bench",
        (
            PhotoRow(0, "xarm7", "ok", 1.0, 1.0, 0.1, 2.0, 0.2, 3.0),
            PhotoRow(1, "xarm7", "error", reasons=("lost",)),
        ),
    ),
    "eye-to-hand": (
        ["eye-to-hand", "--scenes", "1", "--views", "2", "--choose", "random"],
        "eye_to_hand.run_eye_to_hand",
        (Step(0, "random", 1, 2.0, 0.1, 1.0), Step(0, "random", 2, 1.0, 0.1, 1.0, 0.5)),
    ),
    "init": (
        ["init", "--scenes", "1"],
        "init.run_init_bench",
        tuple(InitRow(0, grid, 2.0, 0.1, 1.0, 1.0, 0.1, 1.0) for grid in ("sphere", "paper")),
    ),
    "targeting": (
        ["targeting", "--scenes", "1", "--trials", "1"],
        "targeting.run_targeting",
        (Target(0, 0, 1.5, 0.5, 1.2),),
    ),
    "baxter": (
        ["baxter", "--scenes", "1"],
        "baxter.run_baxter_stand_in",
        BaxterBench("a test", {1: ERRORS, 2: ERRORS, 3: ERRORS}),
    ),
    "marker": (
        ["marker", "--scenes", "1", "--board", "charuco"],
        "marker.run_marker_bench",
        (MarkerRow(0, "Tsai-Lenz", "ordinary", 20, 2.0, 0.1, 0.01), MarkerRow(0, "ours", "", 5)),
    ),
    "adam": (
        ["adam", "--scenes", "1"],
        "adam.run_adam_bench",
        (AdamRow(0, "ours", 0.5, 0.1, 0.4), AdamRow(0, "Adam, last step", 0.6, 0.1, 20.0)),
    ),
    "real": (
        ["real", "."],
        "real.run_real_bench",
        (RealRow("a", "arm", 5, "pose", PoseError(1.0, 0.1), "ok", 0.5, 6.0, 2.0),),
    ),
}


@pytest.mark.parametrize("name", TABLES)
def test_a_table_is_printed_and_written_with_all_rows_and_a_plot(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    words, function, rows = TABLES[name]
    module, _, attribute = function.partition(".")
    monkeypatch.setattr(
        importlib.import_module(f"easyhecpp.bench.{module}"), attribute, lambda *a, **k: rows
    )
    out = tmp_path / "results" / f"{name}.md"
    assert main(["bench", *words, "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    text = out.read_text()
    assert text.startswith("### ")
    assert text.splitlines()[0] in printed
    assert f"]({name}.png)" in text
    assert f"bench {words[0]}" in text.splitlines()[-1]  # the command that repeats it
    content = json.loads(out.with_suffix(".json").read_text())
    assert len(content["all_rows"]) == (3 if name == "baxter" else len(rows))
    assert out.with_suffix(".png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    "words",
    [
        ["photo", "--robots"],
        ["eye-to-hand", "--robot"],
        ["targeting", "--robot"],
        ["init", "--robot"],
        ["marker", "--robot"],
        ["solve", "--robot"],
    ],
    ids=lambda words: words[0],
)
def test_an_arm_without_limits_is_refused_before_the_first_scene(
    words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    pytest.importorskip("mitsuba", reason="bench photo needs it before anything else")
    urdf = write_urdf(tmp_path)
    urdf.write_text(urdf.read_text().replace('lower="-1.2" upper="1.2"', 'lower="0" upper="0"'))
    assert main(["bench", *words, str(urdf), "--out", str(tmp_path / "table.md")]) == 2
    assert "The limits of pitch [0, 0] are missing or mean nothing" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == [urdf]


def run_targeting_table(out: str, monkeypatch: pytest.MonkeyPatch) -> int:
    words, _, rows = TABLES["targeting"]
    module = importlib.import_module("easyhecpp.bench.targeting")
    monkeypatch.setattr(module, "run_targeting", lambda *a, **k: rows)
    return main(["bench", *words, "--out", out])


@pytest.mark.parametrize(
    ("out", "expected"),
    [
        ("table.json", "'table.json' is no markdown file"),
        ("table.png", "'table.png' is no markdown file"),
        ("", "'.' is a folder"),
        ("/", "'/' is a folder"),
        ("there", "'there' is a folder"),
        ("there.md", "'there.json' is a folder"),
        ("file/table.md", "is no folder that can be written"),
    ],
)
def test_a_place_for_the_table_that_cannot_be_is_refused_before_the_run(
    out: str,
    expected: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "there").mkdir()
    (tmp_path / "there.json").mkdir()
    (tmp_path / "file").touch()
    assert run_targeting_table(out, monkeypatch) == 2
    captured = capsys.readouterr()
    assert expected in captured.err
    assert captured.out == ""


def test_a_name_without_a_suffix_is_that_of_a_markdown_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    assert run_targeting_table(str(tmp_path / "table"), monkeypatch) == 0
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == ["table.json", "table.md", "table.png"]


@pytest.mark.parametrize(
    "words",
    [
        *(["bench", name] for name in ("solve", "trust", "photo", "eye-to-hand", "init")),
        *(["bench", name] for name in ("targeting", "baxter", "marker", "adam")),
        ["bench", "repeat", "."],
        ["demo"],
        ["explore", "."],
    ],
    ids=" ".join,
)
def test_a_negative_seed_is_refused(words: list[str], capsys: pytest.CaptureFixture[str]):
    assert main([*words, "--seed", "-1"]) == 2
    assert "The seed is -1 (--seed). Expected: 0 or more." in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["photo", "--size", "large"], "no size of a picture"),
        (["photo", "--size", "960x20"], "no size of a picture"),
        (["photo", "--robots", "hal9000"], "no built-in robot called 'hal9000'"),
        (["eye-to-hand", "--choose", "luck"], "called luck"),
        (["eye-to-hand", "--robot", "hal9000"], "no built-in robot"),
        (["init", "--scenes", "0"], "scenes is 0"),
        (["marker", "--poses", "2"], "poses is 2"),
        (["marker", "--robot", "hal9000"], "no built-in robot"),
        (["adam", "--steps", "0"], "steps is 0"),
        (["targeting", "--trials", "0"], "trials is 0"),
        (["targeting", "--views", "0"], "views is 0"),
        (["targeting", "--ee-link", "hook"], "No link is called 'hook'"),
        (["eye-to-hand", "--choose", "random", "random"], "named twice"),
        (["photo", "--views", "2"], "views is 2"),
        (["solve", "--scenes", "0"], "scenes is 0"),
        (["trust", "--scenes", "0"], "scenes is 0"),
        (["trust", "--width", "8"], "width is 8"),
        (["baxter", "--data", "nowhere"], "Cannot be read"),
        (["real", "nowhere"], "No capture below this folder"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_bad_input_is_said_in_a_sentence(
    words: list[str],
    expected: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    pytest.importorskip("mitsuba", reason="bench photo needs it before anything else")
    monkeypatch.chdir(tmp_path)
    assert main(["bench", *words]) == 2
    captured = capsys.readouterr()
    assert expected in captured.err
    assert "Traceback" not in captured.err
    assert list(tmp_path.iterdir()) == []
