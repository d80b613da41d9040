"""Writes a calibration's results into a folder."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
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


def save(found: Calibration, folder: Path) -> None:
    """Write overlays, the report and, last, ``result.json``: where it stands, everything does.

    Raises:
        InputError: A file cannot be written.
    """
    write_overlays(folder / "overlays", found.capture, found.T_mount_cam, masks=found.masks)
    write_report(folder / "report.html", found.result, found.capture, found.estimate, found.masks)
    found.result.write(folder / "result.json")


def save_masks(found: Calibration, folder: Path) -> list[Path]:
    """Write the masks as ``masks/<view>.png``, overlays, and last the page to judge them by.

    Raises:
        InputError: A file cannot be written.
    """
    written = []
    for view, mask in found.masks.items():
        path = folder / "masks" / f"{view}.png"
        write_image(path, np.asarray(mask, np.float32) > 0.5)
        written.append(path)
    write_overlays(folder / "overlays", found.capture, found.T_mount_cam, masks=found.masks)
    write_masks_page(folder / MASKS_PAGE, found.result, found.capture, found.masks)
    return written


def save_failure(
    capture: Capture, error: CalibrationError, folder: Path, segmenter: str, command: str
) -> None:
    """Write the report and the result of a calibration that came to no pose.

    Raises:
        InputError: A file cannot be written.
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
    write_report(folder / "report.html", result, capture)
    result.write(folder / "result.json")
