"""Writes a calibration's results into a folder."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np

from easyhecpp._atomic import write_image
from easyhecpp.capture import Capture
from easyhecpp.errors import CalibrationError, InputError
from easyhecpp.formats.result_file import ResultFile
from easyhecpp.report.html import write_report
from easyhecpp.report.masks_page import write_masks_page
from easyhecpp.report.overlay import write_overlays
from easyhecpp.session.calibration import Calibration, robot_block

RESULT, REPORT, OVERLAYS, MASKS = "result.json", "report.html", "overlays", "masks"
MASKS_PAGE = "masks.html"


@contextmanager
def output_folder(folder: Path) -> Iterator[None]:
    """Make the output folder before any work is done; a failure leaves no empty folder behind.

    Raises:
        InputError: It cannot be made or written.
    """
    made = [path for path in (folder, *folder.parents) if not path.exists()]
    try:
        _make(folder)
        yield
    except BaseException:
        for path in made:
            with suppress(OSError):  # something was written into it: that stays
                path.rmdir()
        raise


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise InputError(
            "The output folder cannot be written",
            where=folder,
            expected="a folder that you may write to",
            fix=f"choose another with --out ({error.strerror or error})",
        ) from error


@contextmanager
def _staged(folder: Path) -> Iterator[Path]:
    """A folder to write into; what is in it moves to ``folder`` when all is written.

    Overlays of an earlier run go then, and its ``result.json`` before anything else does: where
    that file stands, it and all beside it come from one run.

    Raises:
        InputError: Something is in the way of a file or folder, or cannot be changed.
    """
    _make(folder)
    with tempfile.TemporaryDirectory(dir=folder, prefix=".new-") as name:
        stage = Path(name)
        yield stage
        written = [path.relative_to(stage) for path in stage.rglob("*") if path.is_file()]
        _check_places(folder, written)
        try:
            _move(stage, folder, written)
        except OSError as error:
            raise InputError(
                f"The results cannot be written: {error.strerror or error}",
                where=error.filename or folder,
                fix="choose another folder with --out",
            ) from error


def _move(stage: Path, folder: Path, written: Iterable[Path]) -> None:
    files = sorted(written, key=lambda path: path.name == RESULT)
    if Path(RESULT) in files:
        (folder / RESULT).unlink(missing_ok=True)
    for old in (folder / OVERLAYS).glob("*.jpg"):
        old.unlink()
    for path in files:
        target = folder / path
        target.parent.mkdir(exist_ok=True)
        shutil.move(stage / path, os.path.realpath(target))


def _check_places(folder: Path, written: Iterable[Path]) -> None:
    for path in written:
        if (folder / path).is_dir():
            raise InputError("Cannot write a file over a folder", where=folder / path)
        if (folder / path).parent.is_file():
            raise InputError("Cannot make a folder in the place of a file", where=folder / path)


def save(found: Calibration, folder: Path) -> None:
    """Write overlays, the report and, last, ``result.json``: where it stands, everything does.

    Raises:
        InputError: A file cannot be written; what an earlier run left is then unchanged.
    """
    with _staged(folder) as stage:
        write_overlays(stage / OVERLAYS, found.capture, found.T_mount_cam, masks=found.masks)
        write_report(stage / REPORT, found.result, found.capture, found.estimate, found.masks)
        found.result.write(stage / RESULT)


def save_masks(found: Calibration, folder: Path) -> list[Path]:
    """Write the masks as ``masks/<view>.png``, overlays, and last the page to judge them by.

    Masks of other views that are there already stay: they may be somebody's work.

    Raises:
        InputError: A file cannot be written; what an earlier run left is then unchanged.
    """
    names = [Path(MASKS) / f"{view}.png" for view in found.masks]
    with _staged(folder) as stage:
        for name, mask in zip(names, found.masks.values(), strict=True):
            write_image(stage / name, np.asarray(mask, np.float32) > 0.5)
        write_overlays(stage / OVERLAYS, found.capture, found.T_mount_cam, masks=found.masks)
        write_masks_page(stage / MASKS_PAGE, found.result, found.capture, found.masks)
    return [folder / name for name in names]


def save_failure(
    capture: Capture, error: CalibrationError, folder: Path, segmenter: str, command: str
) -> None:
    """Write the report and the result of a calibration that came to no pose.

    Raises:
        InputError: A file cannot be written; what an earlier run left is then unchanged.
    """
    result = ResultFile.build(
        setup=capture.setup,
        robot=robot_block(capture),
        camera=capture.camera,
        verdict="failed",
        reasons=[str(error)],
        T_mount_cam=None,
        segmenter=segmenter,
        command=command,
    )
    with _staged(folder) as stage:
        write_report(stage / REPORT, result, capture)
        result.write(stage / RESULT)
