"""Hand-eye calibration from poses of a marker: OpenCV's closed-form solvers.

A board is fixed to some link, the holder: the last link when the camera stands beside the arm, the
base when the camera rides on it. With the words of `easyhecpp.rig`, both set-ups are

    T_cam_board = inv(T_mount_cam) @ T_mount_holder(q) @ T_holder_board

in which `T_mount_cam` and `T_holder_board` are unknown. Pairs of views eliminate the board's place
on its holder and leave AX = XB (five solvers); AX = YB keeps it (two solvers).
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from easyhecpp.baselines.types import BaselineResult
from easyhecpp.errors import InputError
from easyhecpp.geometry import inverse, make_transform

F64 = NDArray[np.float64]
Solver = Callable[[F64, F64], F64]

MIN_VIEWS = 3
"""Two motions about axes that differ: three views."""


def solve_hand_eye(Ts_mount_holder: F64, Ts_cam_board: F64, method: str) -> BaselineResult:
    """Find the camera from what the arm's encoders and the marker's pictures say.

    Args:
        Ts_mount_holder: ``(N, 4, 4)`` poses of the link that holds the board.
        Ts_cam_board: ``(N, 4, 4)`` poses of the board in the camera, view by view.
        method: One of `SOLVERS`.

    Returns:
        The pose; status ``failed`` where the solver finds none, for instance because all views
        turn about the same axis.

    Raises:
        InputError: Unknown method, too few views, or numbers of views that differ.
    """
    if method not in SOLVERS:
        raise InputError(
            f"Unknown hand-eye solver {method!r}", expected=f"one of {', '.join(SOLVERS)}"
        )
    holder, board = np.asarray(Ts_mount_holder, float), np.asarray(Ts_cam_board, float)
    if holder.shape != board.shape or holder.shape[1:] != (4, 4) or len(holder) < MIN_VIEWS:
        raise InputError(
            f"Hand-eye calibration was given poses of shapes {holder.shape} and {board.shape}",
            expected=f"(N, 4, 4) twice, with N at least {MIN_VIEWS}",
        )
    clock = time.perf_counter()
    try:
        T, why = SOLVERS[method](holder, board), "The solver returned no rigid transform."
    except cv2.error as error:
        T, why = np.full((4, 4), np.nan), f"The solver gave up: {error.err}."
    seconds = time.perf_counter() - clock
    if not _is_rigid(T):
        return BaselineResult(None, method, seconds, len(holder), "failed", why)
    return BaselineResult(T, method, seconds, len(holder), "done", f"From {len(holder)} views.")


def _ax_xb(flag: int) -> Solver:
    def solve(Ts_mount_holder: F64, Ts_cam_board: F64) -> F64:
        # OpenCV's words are those of a camera on the gripper and a board in the base.
        Ts_holder_mount = inverse(Ts_mount_holder)
        R, t = cv2.calibrateHandEye(
            *_parts(Ts_holder_mount), *_parts(Ts_cam_board), method=flag
        )  # fmt: skip
        return make_transform(R, np.ravel(t))

    return solve


def _ax_yb(flag: int) -> Solver:
    def solve(Ts_mount_holder: F64, Ts_cam_board: F64) -> F64:
        # Its "world" is our board, its "base" the holder, its "gripper" the mount.
        *_, R, t = cv2.calibrateRobotWorldHandEye(
            *_parts(Ts_cam_board), *_parts(Ts_mount_holder), method=flag
        )
        return inverse(make_transform(R, np.ravel(t)))

    return solve


SOLVERS: dict[str, Solver] = {
    "Tsai-Lenz": _ax_xb(cv2.CALIB_HAND_EYE_TSAI),
    "Park": _ax_xb(cv2.CALIB_HAND_EYE_PARK),
    "Horaud": _ax_xb(cv2.CALIB_HAND_EYE_HORAUD),
    "Andreff": _ax_xb(cv2.CALIB_HAND_EYE_ANDREFF),
    "Daniilidis": _ax_xb(cv2.CALIB_HAND_EYE_DANIILIDIS),
    "Shah": _ax_yb(cv2.CALIB_ROBOT_WORLD_HAND_EYE_SHAH),
    "Li": _ax_yb(cv2.CALIB_ROBOT_WORLD_HAND_EYE_LI),
}
"""Solvers by name: five of AX = XB, then two of AX = YB."""


def _parts(Ts: F64) -> tuple[list[Any], list[Any]]:
    """Rotations and translations, as OpenCV wants them."""
    return [T[:3, :3].copy() for T in Ts], [T[:3, 3].copy() for T in Ts]


def _is_rigid(T: F64) -> bool:
    R = T[:3, :3]
    return bool(
        np.isfinite(T).all() and np.abs(R @ R.T - np.eye(3)).max() < 1e-6 and np.linalg.det(R) > 0.0
    )
