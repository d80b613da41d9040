"""The one place that looks for optional packages and names the extra that brings them."""

from __future__ import annotations

import importlib
import importlib.util
from types import ModuleType

from easyhecpp.errors import MissingExtraError


def require(module: str, extra: str, feature: str) -> ModuleType:
    """Import an optional module.

    Args:
        module: Dotted name of the module, e.g. ``"transformers"``.
        extra: The extra of easyhecpp that installs it, e.g. ``"models"``.
        feature: What needs it, as the user would name it; it opens the error's sentence.

    Returns:
        The imported module.

    Raises:
        MissingExtraError: The module is absent, or present and unable to load.
    """
    package = module.partition(".")[0]
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        if error.name is not None and error.name.partition(".")[0] == package:
            raise MissingExtraError(package, extra, feature) from error
        raise MissingExtraError(package, extra, feature, reason=str(error)) from error
    except ImportError as error:
        raise MissingExtraError(package, extra, feature, reason=str(error)) from error


def available(module: str) -> bool:
    """Say whether a module is installed, without importing it (its parent packages are)."""
    try:
        return importlib.util.find_spec(module) is not None
    except (ModuleNotFoundError, ValueError):
        return False
