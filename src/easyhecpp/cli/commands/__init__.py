"""The commands, one typed dataclass each; help texts are their docstrings."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Protocol

import tyro

from easyhecpp.cli.commands.bench import Bench
from easyhecpp.cli.commands.calibrate import Calibrate
from easyhecpp.cli.commands.check import CheckCapture
from easyhecpp.cli.commands.compare import Compare
from easyhecpp.cli.commands.demo import Demo
from easyhecpp.cli.commands.explore import Explore
from easyhecpp.cli.commands.export import Export
from easyhecpp.cli.commands.info import Info
from easyhecpp.cli.commands.overlay import Overlay
from easyhecpp.cli.commands.segment import Segment
from easyhecpp.cli.commands.view import View
from easyhecpp.errors import InputError


class Command(Protocol):
    """A parsed command."""

    def run(self, command_line: str) -> int:
        """Do it; returns the exit code. ``command_line`` is what the user typed."""
        ...


def parse(words: Sequence[str]) -> Command:
    """Parse the words after the program's name; exits with 2 and a usage line when they are off.

    Raises:
        InputError: A negative seed.
    """
    kind = (
        Annotated[Calibrate, tyro.conf.subcommand("calibrate")]
        | Annotated[CheckCapture, tyro.conf.subcommand("check-capture")]
        | Annotated[Info, tyro.conf.subcommand("info")]
        | Annotated[Segment, tyro.conf.subcommand("segment")]
        | Annotated[Overlay, tyro.conf.subcommand("overlay")]
        | Annotated[View, tyro.conf.subcommand("view")]
        | Annotated[Export, tyro.conf.subcommand("export")]
        | Annotated[Compare, tyro.conf.subcommand("compare")]
        | Annotated[Explore, tyro.conf.subcommand("explore")]
        | Annotated[Bench, tyro.conf.subcommand("bench")]
        | Annotated[Demo, tyro.conf.subcommand("demo")]
    )
    command = tyro.cli(  # type: ignore[no-any-return, call-overload]
        kind,
        args=list(words),
        prog="easyhecpp",
        description="Finds where a camera is, relative to a robot arm, from pictures of the arm.",
        config=(tyro.conf.OmitSubcommandPrefixes, tyro.conf.FlagCreatePairsOff),
    )
    _check_seed(command)
    return command


def _check_seed(command: Command) -> None:
    """Whatever command has one: generators of random numbers take no negative seed."""
    seed = getattr(command.table if isinstance(command, Bench) else command, "seed", 0)
    if seed < 0:
        raise InputError(f"The seed is {seed}", where="--seed", expected="0 or more")
