"""Parses the command line and turns errors into exit codes.

0: done; for a calibration also when it is doubtful. 1: a bug. 2: bad input. 3: the calibration
failed, or is doubtful under ``--strict``.
"""

from __future__ import annotations

import os
import shlex
import sys
from collections.abc import Sequence

from easyhecpp.cli.output import FAILED, complain
from easyhecpp.errors import CalibrationError, EasyHecError

BAD_INPUT = 2


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command.

    Args:
        argv: Words after the program's name; those of the process when left out.

    Returns:
        The exit code.
    """
    words = list(sys.argv[1:] if argv is None else argv)
    if words in (["--version"], ["-V"]):
        from easyhecpp import __version__
        from easyhecpp.cli.output import say

        say(f"easyhecpp {__version__}")
        return 0
    from easyhecpp.cli.commands import parse

    try:
        command = parse(words)
        return command.run(shlex.join(["easyhecpp", *words]))
    except CalibrationError as error:
        complain(f"easyhecpp: {error}")
        return FAILED
    except EasyHecError as error:
        complain(f"easyhecpp: {error}")
        return BAD_INPUT
    except KeyboardInterrupt:
        complain("easyhecpp: interrupted")
        return 130
    except BrokenPipeError:
        # The reader of our output (head, less) has gone: no news, and no second error on exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
