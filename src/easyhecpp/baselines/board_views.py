"""Pictures of a board on an arm: true perspective, smooth edges, hidden by the arm, noisy.

Rays through several points of each pixel meet the board and read its print there, so perspective
and the lens are exact and edges are averaged over the pixel. Nothing else is photo-real: the arm is
flat grey and the light even.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from easyhecpp.baselines.boards import Board
from easyhecpp.camera import Camera
from easyhecpp.geometry import transform_points
from easyhecpp.render import SilhouetteRenderer

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]

SAMPLES = 4
"""Rays per pixel and direction."""

_PX_PER_SQUARE = 48
_WALL, _ARM, _PAPER, _INK = 0.42, 0.62, 0.85, 0.06


@dataclass(frozen=True)
class Flaws:
    """What is not perfect about a board and the pictures of it; by default as good as it gets.

    Attributes:
        blur_px: Standard deviation of the lens's blur.
        noise: Standard deviation of the sensor's, share of white.
        print_scale: Size of the print over the size that it should have.
        bend: The middle of the sheet stands out by this towards the camera, as the crown of a
            parabola along x, metres; its left and right edges stay where they are.
    """

    blur_px: float = 0.5
    noise: float = 0.01
    print_scale: float = 1.0
    bend: float = 0.0

    @classmethod
    def ordinary(cls, rng: np.random.Generator) -> Flaws:
        """A sheet from an office printer, glued to cardboard, before a common camera."""
        return cls(0.8, 0.015, 1.0 + rng.uniform(-0.004, 0.004), rng.uniform(-0.002, 0.002))


@dataclass(frozen=True)
class BoardView:
    """A picture of a board and its truth.

    Attributes:
        picture: ``(H, W)`` uint8, grey.
        corners: ``(N, 2)`` pixels of the inner corners of a board without flaws.
        hidden: Share of the board's pixels in the picture that the arm hides.
    """

    picture: NDArray[np.uint8]
    corners: F64
    hidden: float


def render_board_view(
    board: Board,
    camera: Camera,
    T_cam_board: F64,
    rng: np.random.Generator,
    *,
    arm: tuple[SilhouetteRenderer, F64] | None = None,
    flaws: Flaws | None = None,
) -> BoardView:
    """Render a board, printed on one side, with a white margin one square wide.

    Args:
        board: What is fixed to the arm.
        camera: Intrinsics.
        T_cam_board: ``(4, 4)`` true pose of the board, seen from its printed side.
        rng: Source of noise.
        arm: Renderer of the arm through the same camera, and ``(L, 4, 4)`` Ts_cam_link.
        flaws: Of board and camera.
    """
    flaws = flaws or Flaws()
    level = np.full((camera.height, camera.width), _WALL, np.float32)
    in_front = np.zeros(level.shape, np.bool_)
    shown = _shown(board, camera, T_cam_board, flaws)
    if arm is not None:
        renderer, Ts_cam_link = arm
        coverage = renderer.coverage(Ts_cam_link)
        level += coverage * (_ARM - level)
        if shown is not None:
            in_front[shown.box] = renderer.depth(Ts_cam_link)[shown.box] < shown.depth
    hidden = 0.0
    if shown is not None:
        hidden = float(shown.share[in_front[shown.box]].sum() / max(shown.share.sum(), 1e-9))
        share = np.where(in_front[shown.box], 0.0, shown.share)
        level[shown.box] += share * (shown.level - level[shown.box])
    if flaws.blur_px > 0.0:
        level = cv2.GaussianBlur(level, (0, 0), flaws.blur_px)
    level = level + flaws.noise * rng.standard_normal(level.shape, dtype=np.float32)
    picture = np.round(255.0 * np.clip(level, 0.0, 1.0)).astype(np.uint8)
    return BoardView(picture, camera.project(transform_points(T_cam_board, board.corners)), hidden)


@dataclass(frozen=True)
class _Shown:
    """The part of a picture that a board falls into."""

    box: tuple[slice, slice]
    share: F32
    level: F32
    depth: F32


def _shown(board: Board, camera: Camera, T_cam_board: F64, flaws: Flaws) -> _Shown | None:
    box = _box(board, camera, T_cam_board)
    if box is None:
        return None
    rows, columns = box
    offsets = ((np.arange(SAMPLES) + 0.5) / SAMPLES - 0.5).tolist()
    texture = board.texture(_PX_PER_SQUARE).astype(np.float32) / 255.0
    shape = (rows.stop - rows.start, columns.stop - columns.start)
    share, level = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    y, x = np.mgrid[rows, columns].astype(np.float64)
    square = board.square * flaws.print_scale
    sheet = _Sheet(camera, T_cam_board, board, flaws.bend)
    for dy in offsets:
        for dx in offsets:
            at = sheet.meet(x + dx, y + dy)[..., :2] / square
            with np.errstate(invalid="ignore"):
                inside = ((at > -1.0) & (at < [board.columns + 1, board.rows + 1])).all(axis=-1)
            share += inside
            level += np.where(inside, _print_at(texture, at), 0.0)
    depth = sheet.meet(x, y)[..., 2].astype(np.float32)
    share /= SAMPLES**2
    white = level / np.maximum(share * SAMPLES**2, 1.0)
    return _Shown(box, share, (_INK + (_PAPER - _INK) * white).astype(np.float32), depth)


def _box(board: Board, camera: Camera, T_cam_board: F64) -> tuple[slice, slice] | None:
    """Rows and columns that may show the board; None where it is behind, averted or outside."""
    # The board's z axis points away from whoever sees its print.
    if T_cam_board[2, 3] <= 0.0 or T_cam_board[:3, 3] @ T_cam_board[:3, 2] <= 0.0:
        return None
    along = np.linspace(-1.0, 1.0, 9)
    x = board.square * (board.columns / 2.0 + along * (board.columns / 2.0 + 1.0))
    y = board.square * (board.rows / 2.0 + along * (board.rows / 2.0 + 1.0))
    sheet = np.stack([*np.meshgrid(x, y), np.zeros((9, 9))], axis=-1).reshape(-1, 3)
    px = camera.project(transform_points(T_cam_board, sheet))
    if not np.isfinite(px).all():
        return None
    (left, top), (right, bottom) = np.floor(px.min(axis=0)) - 1, np.ceil(px.max(axis=0)) + 2
    rows = slice(int(max(top, 0)), int(min(bottom, camera.height)))
    columns = slice(int(max(left, 0)), int(min(right, camera.width)))
    return (rows, columns) if rows.start < rows.stop and columns.start < columns.stop else None


@dataclass(frozen=True)
class _Sheet:
    """A board's surface, flat or slightly bent."""

    camera: Camera
    T_cam_board: F64
    board: Board
    bend: float

    def meet(self, x: F64, y: F64) -> F64:
        """Where rays meet it: x and y on the board, metres, and the depth in the camera."""
        rays = self.camera.unproject(np.stack([x, y], axis=-1))
        R, t = self.T_cam_board[:3, :3], self.T_cam_board[:3, 3]
        origin, along = -t @ R, rays @ R
        depth = -origin[2] / along[..., 2]
        # A bend of millimetres moves the point by little: two rounds are good to a micrometre.
        for _ in range(2 if self.bend else 0):
            x_on_board = origin[0] + depth * along[..., 0]
            depth = (self._height(x_on_board) - origin[2]) / along[..., 2]
        at = origin[:2] + depth[..., None] * along[..., :2]
        return np.concatenate([at, depth[..., None]], axis=-1)

    def _height(self, x: F64) -> F64:
        """How far the surface is behind the flat board; towards the camera is negative."""
        half = (self.board.columns / 2.0 + 1.0) * self.board.square
        from_middle = (x - self.board.columns / 2.0 * self.board.square) / half
        return -self.bend * (1.0 - from_middle**2)


def _print_at(texture: F32, at: F64) -> F32:
    """Whiteness of the print; ``at`` in squares from its corner; the margin is white."""
    # OpenCV's maps count from the centre of the first pixel.
    maps = (at * _PX_PER_SQUARE - 0.5).astype(np.float32)
    return np.asarray(
        cv2.remap(
            texture, maps[..., 0], maps[..., 1], cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_CONSTANT, borderValue=1.0,
        ),
        np.float32,
    )  # fmt: skip
