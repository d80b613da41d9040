"""Rendered boards: where their corners are seen, what hides them, and what pose they give."""

from __future__ import annotations

import numpy as np
import pytest

from easyhecpp.baselines.board_views import Flaws, render_board_view
from easyhecpp.baselines.boards import Board, BoardCorners, CharucoBoard, Chessboard, board_pose
from easyhecpp.camera import Camera
from easyhecpp.geometry import exp_so3, make_transform, pose_error, translation_matrix
from easyhecpp.render import SilhouetteRenderer
from easyhecpp.robot import LinkMesh

F64 = np.ndarray

PINHOLE = Camera(640, 480, 610.0, 605.0, 322.3, 236.8)
LENS = Camera(640, 480, 520.0, 522.0, 315.0, 244.0, "plumb_bob", (-0.21, 0.06, 1e-3, -5e-4, 0.0))
FISHEYE = Camera(640, 480, 420.0, 420.0, 320.0, 240.0, "equidistant", (0.02, -0.01, 0.0, 0.0))
CLEAR = Flaws(blur_px=0.5, noise=0.0)

chessboard_and_charuco = pytest.mark.parametrize("board", [Chessboard(), CharucoBoard()])


def facing(board: Board, turn: tuple[float, float, float], at: tuple[float, float, float]) -> F64:
    """T_cam_board of a board whose middle is at a point."""
    R = exp_so3(turn)
    middle = board.square * np.array([board.columns, board.rows, 0.0]) / 2.0
    return make_transform(R, at - R @ middle)


POSES = (
    ((0.0, 0.0, 0.0), (0.0, 0.0, 0.6)),
    ((0.5, 0.2, 0.3), (0.05, 0.02, 0.55)),
    ((-0.3, 0.6, -2.0), (-0.08, 0.04, 0.6)),
    ((0.1, -0.5, 3.0), (0.03, -0.05, 0.65)),
)


def picture(board: Board, camera: Camera, T: F64, flaws: Flaws = CLEAR, **more: object):
    return render_board_view(board, camera, T, np.random.default_rng(0), flaws=flaws, **more)


@pytest.mark.parametrize("camera", [PINHOLE, LENS, FISHEYE], ids=["pinhole", "lens", "fisheye"])
@pytest.mark.parametrize("pose", POSES)
def test_chessboard_corners_are_seen_where_they_are(
    camera: Camera, pose: tuple[tuple[float, float, float], tuple[float, float, float]]
) -> None:
    board = Chessboard()
    T = facing(board, *pose)
    view = picture(board, camera, T)
    seen = board.detect(view.picture)
    assert seen is not None
    assert (seen.ids == np.arange(42)).all()
    apart = seen.pixels - view.corners
    # Upside down or mirrored, corners would be tens of pixels apart.
    assert np.abs(apart).max() < 0.1
    assert np.abs(apart.mean(axis=0)).max() < 0.015
    estimate = board_pose(board, camera, seen)
    assert estimate is not None
    metres, radians = pose_error(estimate, T)
    assert metres < 1e-3
    # A board that is seen head-on hardly changes when it is tilted.
    assert radians < 8e-3


@pytest.mark.parametrize("pose", POSES)
def test_charuco_corners_are_seen_where_they_are(
    pose: tuple[tuple[float, float, float], tuple[float, float, float]],
) -> None:
    board = CharucoBoard()
    T = facing(board, *pose)
    view = picture(board, PINHOLE, T)
    seen = board.detect(view.picture)
    assert seen is not None
    apart = np.linalg.norm(seen.pixels - view.corners[seen.ids], axis=1)
    # OpenCV's detector, at its defaults, now and then takes the edge of a marker for a corner.
    assert np.median(apart) < 0.1
    assert np.quantile(apart, 0.9) < 0.3
    assert np.abs(np.median(seen.pixels - view.corners[seen.ids], axis=0)).max() < 0.05


@chessboard_and_charuco
def test_exact_corners_give_the_exact_pose(board: Board) -> None:
    for camera in (PINHOLE, LENS, FISHEYE):
        for pose in POSES:
            T = facing(board, *pose)
            points = board.corners @ T[:3, :3].T + T[:3, 3]
            ids = np.arange(0, len(points), 2)
            estimate = board_pose(board, camera, BoardCorners(ids, camera.project(points[ids])))
            assert estimate is not None
            np.testing.assert_allclose(estimate, T, atol=1e-6)


def test_corners_on_a_line_give_no_pose() -> None:
    board = Chessboard()
    pixels = np.stack([np.linspace(100, 300, 7), np.full(7, 200.0)], axis=1)
    assert board_pose(board, PINHOLE, BoardCorners(np.arange(7), pixels)) is None


@chessboard_and_charuco
def test_the_print_agrees_with_the_corners(board: Board) -> None:
    """Around every inner corner two of the four squares' near ends are white, diagonally."""
    scale = 40
    texture = board.texture(scale)
    assert texture.shape == (board.rows * scale, board.columns * scale)
    for x, y, _ in np.round(board.corners / board.square * scale).astype(int):
        quarters = [
            texture[y + dy, x + dx] > 127 for dy, dx in ((-2, -2), (-2, 1), (1, -2), (1, 1))
        ]
        assert quarters[0] == quarters[3] != quarters[1] == quarters[2]


@chessboard_and_charuco
def test_a_board_that_shows_its_back_or_lies_behind_is_not_drawn(board: Board) -> None:
    for turn, at in (((np.pi, 0.0, 0.0), (0, 0, 0.6)), ((0.0, 0.0, 0.0), (0, 0, -0.6))):
        view = picture(board, PINHOLE, facing(board, turn, at))
        assert np.ptp(view.picture) == 0
        assert board.detect(view.picture) is None


def test_what_is_in_front_of_the_board_hides_it_and_what_is_behind_does_not() -> None:
    board = Chessboard()
    T = facing(board, (0.0, 0.0, 0.0), (0.0, 0.0, 0.6))
    bar = LinkMesh.from_triangles(
        np.array([[-1.0, -0.02, 0], [1.0, -0.02, 0], [1.0, 0.02, 0], [-1.0, 0.02, 0]]),
        np.array([[0, 1, 2], [0, 2, 3]]),
    )
    renderer = SilhouetteRenderer([bar], PINHOLE)
    behind = picture(board, PINHOLE, T, arm=(renderer, translation_matrix([0, 0, 0.9])[None]))
    assert behind.hidden == 0.0
    assert board.detect(behind.picture) is not None
    front = picture(board, PINHOLE, T, arm=(renderer, translation_matrix([0, 0, 0.5])[None]))
    # 40 mm at half a metre cover 48 mm of a board that is 9 squares high with its margin.
    assert front.hidden == pytest.approx(0.048 / (9 * board.square), rel=0.02)
    row, column = round(PINHOLE.cy), round(PINHOLE.cx)
    assert front.picture[row, column] == front.picture[row, 5]
    assert (front.picture == behind.picture)[: row - 40, 100:-100].all()


def test_noise_and_blur_are_as_told() -> None:
    board = Chessboard()
    T = facing(board, (0.0, 0.0, 0.0), (0.0, 0.0, -1.0))
    noisy = picture(board, PINHOLE, T, flaws=Flaws(blur_px=0.0, noise=0.02))
    assert noisy.picture.std() == pytest.approx(0.02 * 255.0, rel=0.03)
    rng = np.random.default_rng(0)
    again = render_board_view(board, PINHOLE, T, rng, flaws=Flaws(0.0, 0.02))
    np.testing.assert_array_equal(again.picture, noisy.picture)


def test_a_print_of_another_size_looks_nearer_or_farther() -> None:
    board = Chessboard()
    T = facing(board, (0.3, 0.2, 0.1), (0.0, 0.0, 0.6))
    seen = board.detect(picture(board, PINHOLE, T, Flaws(0.5, 0.0, print_scale=1.02)).picture)
    assert seen is not None
    estimate = board_pose(board, PINHOLE, seen)
    assert estimate is not None
    # The print grows from the board's origin, which stays where it is in the picture.
    np.testing.assert_allclose(estimate[:3, 3], T[:3, 3] / 1.02, atol=1.5e-3)


def test_a_bent_sheet_stands_out_towards_the_camera() -> None:
    board, bend = Chessboard(), 0.004
    T = facing(board, (0.0, 0.0, 0.0), (0.0, 0.0, 0.5))
    seen = board.detect(picture(board, PINHOLE, T, Flaws(0.5, 0.0, bend=bend)).picture)
    assert seen is not None
    half, middle = (board.columns / 2 + 1) * board.square, board.columns / 2 * board.square
    on_sheet = board.corners.copy()
    on_sheet[:, 2] = -bend * (1.0 - ((on_sheet[:, 0] - middle) / half) ** 2)
    expected = PINHOLE.project(on_sheet @ T[:3, :3].T + T[:3, 3])
    np.testing.assert_allclose(seen.pixels, expected, atol=0.1)
    flat = PINHOLE.project(board.corners @ T[:3, :3].T + T[:3, 3])
    assert np.abs(seen.pixels - flat).max() > 0.5
