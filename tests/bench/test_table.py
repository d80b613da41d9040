from __future__ import annotations

import io
import json
import math

import pytest
import rich.console

from easyhecpp.bench.table import Table, describe_machine, failure_notes, machine_sentence

TABLE = Table(
    title="Errors",
    columns=("masks", "mm", "failures"),
    rows=(("exact | best", 0.0812345, 0), ("worse", 12.3456, None), ("none", math.inf, 3)),
    notes=("Two cores.",),
)


def test_markdown() -> None:
    assert TABLE.to_markdown().splitlines() == [
        "### Errors",
        "",
        "| masks | mm | failures |",
        "| --- | ---: | ---: |",
        "| exact \\| best | 0.0812 | 0 |",
        "| worse | 12.3 |  |",
        "| none | inf | 3 |",
        "",
        "Two cores.",
    ]


def test_json_is_strict_and_not_rounded() -> None:
    content = json.loads(TABLE.to_json(seed=3), parse_constant=pytest.fail)
    assert content["seed"] == 3
    assert content["rows"][0] == {"masks": "exact | best", "mm": 0.0812345, "failures": 0}
    assert content["rows"][2]["mm"] is None


def test_terminal() -> None:
    console = rich.console.Console(file=io.StringIO(), width=80)
    console.print(TABLE.to_rich())
    text = console.file.getvalue()  # type: ignore[attr-defined]
    for expected in ("Errors", "0.0812", "worse", "Two cores."):
        assert expected in text


def test_rows_must_fit_the_columns() -> None:
    with pytest.raises(ValueError, match="1 cells for 2 columns"):
        Table("t", ("a", "b"), ((1,),))


def test_machine_is_described() -> None:
    machine = describe_machine()
    assert machine["cores"] >= 1
    assert machine["packages"]["numpy"]
    sentence = machine_sentence(machine)
    assert "cores" in sentence
    assert "Python 3." in sentence


def test_three_failures_are_told_and_the_others_counted():
    failures = [(f"scene {k}", "lost") for k in range(5)]
    assert failure_notes([]) == ()
    assert failure_notes(failures[:2]) == ("Failed, scene 0: lost", "Failed, scene 1: lost")
    assert failure_notes(failures)[2:] == ("Failed, scene 2: lost", "2 more failed.")
