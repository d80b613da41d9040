"""``easyhecpp overlay``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from easyhecpp.cli.output import say
from easyhecpp.errors import InputError


@dataclass(frozen=True)
class Overlay:
    """Draw the arm's outline at a result's pose over the pictures of a capture."""

    capture: Positional[Path]
    """Folder of the capture."""

    result: Positional[Path]
    """The result.json whose pose is drawn."""

    out: Path = Path("overlays")
    """Folder for the pictures."""

    def run(self, command_line: str) -> int:
        """Draw every view that has a picture."""
        from easyhecpp.capture import Capture
        from easyhecpp.capture.decode import check_decodable
        from easyhecpp.formats.result_file import ResultFile
        from easyhecpp.report.overlay import write_overlays
        from easyhecpp.session.refinement import as_refined

        result = ResultFile.read(self.result)
        if result.T_mount_cam is None:
            raise InputError(
                "The result holds no pose", where=self.result, expected="one that did not fail"
            )
        capture = Capture.load(self.capture)
        check_decodable(capture)
        capture = as_refined(capture, result)
        written = write_overlays(self.out, capture, result.T_mount_cam.array)
        say(f"{len(written)} pictures written to {self.out}/")
        return 0
