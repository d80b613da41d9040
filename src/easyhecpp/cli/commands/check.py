"""``easyhecpp check-capture``."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path

from tyro.conf import Positional

from easyhecpp.cli.output import say, say_json

BAD_INPUT = 2


@dataclass(frozen=True)
class CheckCapture:
    """Say everything that is wrong with a capture, at once."""

    capture: Positional[Path]
    """Folder of the capture."""

    json: bool = False
    """Print the findings as JSON."""

    def run(self, command_line: str) -> int:
        """Check and list; 2 when the capture cannot be used."""
        from easyhecpp.capture import check_capture

        problems = check_capture(self.capture)
        errors = [p for p in problems if p.severity == "error"]
        if self.json:
            say_json([asdict(p) for p in problems])
        else:
            for problem in problems:
                say(f"{problem.severity}: {problem}")
            say(
                f"{len(errors)} errors, {len(problems) - len(errors)} remarks"
                if problems
                else "nothing to remark: the capture is ready to be calibrated"
            )
        return BAD_INPUT if errors else 0
