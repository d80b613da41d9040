"""Chessboard and ChArUco board: their print, their corners, and finding them in a picture.

A board's frame has its origin in the top left corner of the print, x to the right, y down and z
into the board. Corners are the inner ones, where four squares meet, counted along rows.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from easyhecpp.camera import Camera
from easyhecpp.geometry import exp_so3, make_transform

F64 = NDArray[np.float64]
Gray = NDArray[np.uint8]

MIN_CORNERS = 6
"""Fewer corners are not taken for a sighting."""


@dataclass(frozen=True)
class BoardCorners:
    """A board in a picture.

    Attributes:
        ids: ``(N,)`` which of the board's corners.
        pixels: ``(N, 2)`` where they are seen.
    """

    ids: NDArray[np.int64]
    pixels: F64


class Board(Protocol):
    """A flat board with known corners."""

    @property
    def columns(self) -> int:
        """Squares from left to right."""
        ...

    @property
    def rows(self) -> int:
        """Squares from top to bottom."""
        ...

    @property
    def square(self) -> float:
        """Side of a square, metres."""
        ...

    @property
    def corners(self) -> F64:
        """``(N, 3)`` inner corners in the board's frame, metres."""
        ...

    def texture(self, px_per_square: int) -> Gray:
        """The print, without its white margin, one pixel being ``square / px_per_square``."""
        ...

    def detect(self, picture: Gray) -> BoardCorners | None:
        """Find the board in a grey picture ``(H, W)``; None where it is not seen."""
        ...


@dataclass(frozen=True)
class Chessboard:
    """A chessboard; found whole or not at all.

    Attributes:
        columns: Squares from left to right.
        rows: Squares from top to bottom; one of the two numbers should be odd, else the board looks
            the same upside down.
        square: Side of a square, metres.
    """

    columns: int = 8
    rows: int = 7
    square: float = 0.025

    @property
    def corners(self) -> F64:
        """``(N, 3)`` inner corners."""
        return _inner_corners(self.columns, self.rows, self.square)

    def texture(self, px_per_square: int) -> Gray:
        """The print; the square in the top left corner is black."""
        dark = (np.add.outer(np.arange(self.rows), np.arange(self.columns)) % 2) == 0
        squares = np.where(dark, 0, 255).astype(np.uint8)
        return np.kron(squares, np.ones((px_per_square, px_per_square), np.uint8))

    def detect(self, picture: Gray) -> BoardCorners | None:
        """OpenCV's finder and `cornerSubPix`, both at their customary settings."""
        size = (self.columns - 1, self.rows - 1)
        found, corners = cv2.findChessboardCorners(
            picture, size, flags=cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
        )
        if not found:
            return None
        grid = np.asarray(corners, np.float32).reshape(size[1], size[0], 2)
        # A window that reaches beyond the neighbouring corners would be drawn to them.
        steps = [np.linalg.norm(np.diff(grid, axis=axis), axis=-1).min() for axis in (0, 1)]
        half = int(np.clip(0.4 * min(steps), 2, 11))
        cv2.cornerSubPix(
            picture, grid.reshape(-1, 1, 2), (half, half), (-1, -1),
            (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 40, 1e-3),
        )  # fmt: skip
        pixels = self._upright(grid.astype(np.float64), picture).reshape(-1, 2)
        return BoardCorners(np.arange(len(pixels)), pixels)

    def _upright(self, grid: F64, picture: Gray) -> F64:
        """The finder does not say which end is the top: the colours of the squares do."""
        if self._darkness(grid[::-1, ::-1], picture) > self._darkness(grid, picture):
            return grid[::-1, ::-1]
        return grid

    def _darkness(self, grid: F64, picture: Gray) -> float:
        """How much darker the squares are that should be black; by order of the inner ones."""
        middles = (grid[:-1, :-1] + grid[1:, :-1] + grid[:-1, 1:] + grid[1:, 1:]) / 4.0
        at = np.round(middles).astype(int)
        height, width = picture.shape
        seen = picture[np.clip(at[..., 1], 0, height - 1), np.clip(at[..., 0], 0, width - 1)]
        # The first inner square stands diagonally below the black one in the corner.
        black = (np.add.outer(*map(np.arange, seen.shape)) % 2) == 0
        return float(seen[~black].mean() - seen[black].mean())


@dataclass(frozen=True)
class CharucoBoard:
    """A chessboard with an ArUco marker in every white square; seen in parts, too.

    Attributes:
        columns: Squares from left to right.
        rows: Squares from top to bottom.
        square: Side of a square, metres.
        marker: Side of a marker, metres.
    """

    columns: int = 8
    rows: int = 7
    square: float = 0.025
    marker: float = 0.019

    @property
    def corners(self) -> F64:
        """``(N, 3)`` inner corners."""
        return _inner_corners(self.columns, self.rows, self.square)

    def texture(self, px_per_square: int) -> Gray:
        """The print as OpenCV draws it."""
        size = (self.columns * px_per_square, self.rows * px_per_square)
        return np.asarray(self._cv.generateImage(size, marginSize=0, borderBits=1), np.uint8)

    def detect(self, picture: Gray) -> BoardCorners | None:
        """OpenCV's `CharucoDetector` with its defaults."""
        found: tuple[Any, ...] = cv2.aruco.CharucoDetector(self._cv).detectBoard(picture)
        pixels, ids = found[:2]
        if ids is None or len(ids) < MIN_CORNERS:
            return None
        return BoardCorners(ids.ravel().astype(np.int64), pixels.reshape(-1, 2).astype(np.float64))

    @cached_property
    def _cv(self) -> Any:
        aruco = cv2.aruco
        return aruco.CharucoBoard(
            (self.columns, self.rows),
            self.square,
            self.marker,
            aruco.getPredefinedDictionary(aruco.DICT_4X4_50),
        )


def board_pose(board: Board, camera: Camera, seen: BoardCorners) -> F64 | None:
    """Pose of a board from its corners.

    Args:
        board: What was found.
        camera: Intrinsics; the lens is honoured exactly.
        seen: The corners.

    Returns:
        ``(4, 4)`` T_cam_board, or None where the corners allow no pose (all on one line).
    """
    rays = np.ascontiguousarray(camera.unproject(seen.pixels)[:, :2])
    points = board.corners[seen.ids]
    if not np.isfinite(rays).all() or np.linalg.matrix_rank(points[:, :2] - points[0, :2]) < 2:
        return None
    # The two poses of a plane that look alike, the better one first, refined.
    count, turns, moves, _ = cv2.solvePnPGeneric(
        points, rays, np.eye(3), None, flags=cv2.SOLVEPNP_IPPE
    )
    if not count:
        return None
    turn, move = cv2.solvePnPRefineLM(points, rays, np.eye(3), None, turns[0], moves[0])
    T_cam_board = make_transform(exp_so3(np.ravel(turn)), np.ravel(move))
    return T_cam_board if np.isfinite(T_cam_board).all() and T_cam_board[2, 3] > 0.0 else None


def _inner_corners(columns: int, rows: int, square: float) -> F64:
    y, x = np.mgrid[1:rows, 1:columns]
    return square * np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3).astype(np.float64)
