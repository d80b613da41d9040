"""``truth.json``: where the camera of a capture really is, beside the capture's other files.

One of these stands in it, as row-major 4 x 4 matrices in metres:

- ``T_mount_cam``: pose of the camera's optical frame in its mount (the robot's base for
  eye-to-hand), as a bare matrix or as ``{"matrix": ...}``; ``T_base_cam`` is understood too;
- ``stereo``: ``{"other": "../left", "T_other_cam": ...}``: pose of this camera in the frame of the
  camera of another capture of the same arm, as a stereo camera's factory states it.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from easyhecpp.errors import InputError

F64 = NDArray[np.float64]

TRUTH = "truth.json"


@dataclass(frozen=True)
class TruthFile:
    """What is known about a capture's camera; one of the two.

    Attributes:
        T_mount_cam: (4, 4) its pose.
        other: folder of the capture taken by the other camera of a stereo pair.
        T_other_cam: (4, 4) pose of this camera in that other camera's frame.
    """

    T_mount_cam: F64 | None = None
    other: Path | None = None
    T_other_cam: F64 | None = None


def read_truth(folder: Path) -> TruthFile:
    """Read the truth of a capture folder.

    Raises:
        InputError: There is no such file, or it does not hold a pose.
    """
    path = folder / TRUTH
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise _refused(path, "There is no such file") from error
    except (OSError, ValueError) as error:
        raise _refused(path, f"Cannot be read: {error}") from error
    if not isinstance(content, dict):
        raise _refused(path, "Holds no object")
    for key in ("T_mount_cam", "T_base_cam"):
        if key in content:
            return TruthFile(T_mount_cam=_pose(content[key], path, key))
    stereo = content.get("stereo")
    if isinstance(stereo, dict) and isinstance(stereo.get("other"), str):
        T_other_cam = _pose(stereo.get("T_other_cam"), path, "stereo.T_other_cam")
        return TruthFile(other=(folder / stereo["other"]).resolve(), T_other_cam=T_other_cam)
    raise _refused(path, "Names no pose")


def _pose(value: Any, path: Path, key: str) -> F64:
    if isinstance(value, dict):
        value = value.get("matrix")
    try:
        T = np.asarray(value, np.float64)
    except (TypeError, ValueError):
        T = np.empty(0)
    rigid = (
        T.shape == (4, 4)
        and np.allclose(T[3], (0.0, 0.0, 0.0, 1.0))
        and np.allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-4)
        and np.linalg.det(T[:3, :3]) > 0.0
    )
    if not rigid:
        raise _refused(path, f"{key} is not a rigid transform")
    return T


def _refused(path: Path, what: str) -> InputError:
    return InputError(
        what,
        where=path,
        expected='"T_mount_cam" or "T_base_cam": 4 x 4 numbers, or "stereo": {"other": folder, '
        '"T_other_cam": 4 x 4 numbers}',
        fix="docs/benchmarks.md describes the file",
    )
