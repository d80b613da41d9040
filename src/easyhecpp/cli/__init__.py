"""The command ``easyhecpp``."""

from easyhecpp.cli.main import main

__all__ = ["main"]
