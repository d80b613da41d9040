"""``easyhecpp compare``."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path

from tyro.conf import Positional

from easyhecpp.cli.output import say, say_json


@dataclass(frozen=True)
class Compare:
    """Difference of two results, against what their uncertainties allow."""

    first: Positional[Path]
    """A result.json."""

    second: Positional[Path]
    """Another, with the same parent and child frames."""

    json: bool = False
    """Print as JSON."""

    def run(self, command_line: str) -> int:
        """Compare."""
        from easyhecpp.formats.compare import compare
        from easyhecpp.formats.result_file import ResultFile

        found = compare(ResultFile.read(self.first), ResultFile.read(self.second))
        if self.json:
            facts = asdict(found)
            say_json({k: v.tolist() if hasattr(v, "tolist") else v for k, v in facts.items()})
        else:
            say(found.sentence)
            for note in found.notes:
                say(f"note: {note}")
        return 0
