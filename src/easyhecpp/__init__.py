"""Find where a camera is, relative to a robot arm, from pictures of the arm itself.

The names below are imported on first use, so that ``import easyhecpp`` stays cheap and loads no
numerical library that the caller does not need.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from easyhecpp.camera import Camera
    from easyhecpp.capture import Capture
    from easyhecpp.robot import Robot
    from easyhecpp.session import calibrate

__version__ = "0.1.0"

__all__ = ["Camera", "Capture", "Robot", "__version__", "calibrate"]

_HOME_OF = {
    "Camera": "easyhecpp.camera",
    "Capture": "easyhecpp.capture",
    "Robot": "easyhecpp.robot",
    "calibrate": "easyhecpp.session",
}


def __getattr__(name: str) -> Any:
    """Import a public name from its module on first use (PEP 562)."""
    if name not in _HOME_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(_HOME_OF[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
