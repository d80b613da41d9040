"""Error bars and verdicts of a family of scenes, and rows that are found again."""

from __future__ import annotations

from pathlib import Path

import pytest

from easyhecpp.bench.trust import run_trust_bench, trust_plot, trust_table

FAMILIES = ("honest, exact", "bad view: wrong row")


def test_families_are_summed_up_and_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept = tmp_path / "rows.jsonl"
    rows = run_trust_bench(FAMILIES, n_scenes=1, seed=62, width=480, rows_file=kept)
    honest, bad = rows
    assert honest.error is not None
    assert honest.error.position_mm < 1.0
    assert honest.chi_square is not None
    assert (bad.wrong, bad.wrong_found, bad.good, bad.good_flagged) == (1, 1, 4, 0)
    table = trust_table(rows, "two families")
    assert [line[0] for line in table.rows] == list(FAMILIES)
    assert table.rows[1][6] == "1 of 1"
    assert len(trust_plot(rows).axes[0].lines) == 3, "one honest family, two marks"

    monkeypatch.setattr("easyhecpp.bench.trust.build_case", None)
    assert run_trust_bench(FAMILIES, n_scenes=1, seed=62, width=480, rows_file=kept) == rows
