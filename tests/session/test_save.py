"""Results on disk: all of one run, or what was there before."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from report_case import solved

from easyhecpp.errors import CalibrationError, InputError
from easyhecpp.formats.result_file import ResultFile
from easyhecpp.session import Calibration
from easyhecpp.session import save as save_module
from easyhecpp.session.save import save, save_failure, save_masks


@pytest.fixture
def found() -> Calibration:
    case = solved()
    assert case.estimate is not None
    findings: Any = None  # not written
    return Calibration(case.result, case.capture, case.estimate, findings, case.masks)


def contents(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


OVERLAYS = {f"overlays/{i:04d}.jpg" for i in range(4)}


def test_a_run_of_fewer_views_leaves_no_overlay_of_the_one_before(
    found: Calibration, tmp_path: Path
) -> None:
    save(found, tmp_path)
    assert set(contents(tmp_path)) == {*OVERLAYS, "report.html", "result.json"}
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / "overlays" / "notes.txt").write_text("mine")
    fewer = replace(found, capture=found.capture.subset(["0000", "0002"]))
    save(fewer, tmp_path)
    assert set(contents(tmp_path)) == {
        "overlays/0000.jpg", "overlays/0002.jpg", "report.html", "result.json",
        "notes.txt", "overlays/notes.txt",
    }  # fmt: skip


def test_a_failure_leaves_no_overlay_of_the_run_before(found: Calibration, tmp_path: Path) -> None:
    save(found, tmp_path)
    save_failure(found.capture, CalibrationError("No outline."), tmp_path, "given", "easyhecpp")
    assert set(contents(tmp_path)) == {"report.html", "result.json"}
    assert ResultFile.read(tmp_path / "result.json").verdict == "failed"


@pytest.mark.parametrize("fails", ["write_overlays", "write_report"])
def test_what_fails_on_the_way_changes_nothing(
    fails: str, found: Calibration, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    save(found, tmp_path)
    before = contents(tmp_path)
    whole = getattr(save_module, fails)

    def half(*arguments: Any, **options: Any) -> None:
        whole(*arguments, **options)
        raise InputError("No room")

    monkeypatch.setattr(save_module, fails, half)
    fewer = replace(found, capture=found.capture.subset(["0001"]))
    with pytest.raises(InputError, match="No room"):
        save(fewer, tmp_path)
    assert contents(tmp_path) == before
    assert not [p for p in tmp_path.iterdir() if p.name.startswith(".")]


def test_an_old_result_goes_before_anything_else_changes(
    found: Calibration, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Stopped between two files: nothing claims to be whole."""
    save(found, tmp_path)

    def stop(*_: object) -> None:
        assert not (tmp_path / "result.json").exists()
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(save_module.shutil, "move", stop)
    with pytest.raises(InputError, match=r"results cannot be written: Permission denied.*--out"):
        save(found, tmp_path)
    assert "result.json" not in contents(tmp_path)


def test_something_in_the_way(found: Calibration, tmp_path: Path) -> None:
    (tmp_path / "a" / "report.html").mkdir(parents=True)
    with pytest.raises(InputError, match=r"file over a folder.*report\.html"):
        save(found, tmp_path / "a")
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "overlays").write_text("mine")
    with pytest.raises(InputError, match=r"in the place of a file.*overlays"):
        save(found, tmp_path / "b")
    assert contents(tmp_path) == {"b/overlays": b"mine"}


def test_masks_of_other_views_stay(found: Calibration, tmp_path: Path) -> None:
    (tmp_path / "masks").mkdir()
    (tmp_path / "masks" / "0009.png").write_text("drawn by hand")
    written = save_masks(found, tmp_path)
    assert written == [tmp_path / "masks" / f"{i:04d}.png" for i in range(4)]
    masks = {f"masks/{i:04d}.png" for i in (0, 1, 2, 3, 9)}
    assert set(contents(tmp_path)) == masks | OVERLAYS | {"masks.html"}


def test_other_people_may_read_what_was_written(found: Calibration, tmp_path: Path) -> None:
    save(found, tmp_path / "new")
    (tmp_path / "plain").mkdir()
    (tmp_path / "plain" / "file").touch()
    folder, file = ((tmp_path / "plain" / name).stat().st_mode for name in ("", "file"))
    for path in (tmp_path / "new").rglob("*"):
        assert path.stat().st_mode == (folder if path.is_dir() else file)
