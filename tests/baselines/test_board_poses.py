"""A board on an arm: where it sits, and the poses that show it."""

from __future__ import annotations

import numpy as np
import pytest
from baseline_scenes import crooked_arm, scene

from easyhecpp.baselines.board_poses import GAP, MAX_SLANT, BoardOnArm
from easyhecpp.baselines.boards import Chessboard
from easyhecpp.baselines.hand_eye import SOLVERS, solve_hand_eye
from easyhecpp.errors import InputError
from easyhecpp.geometry import inverse, look_at, pose_error, transform_points


@pytest.fixture(scope="module")
def board_on_arm() -> BoardOnArm:
    sim = scene(1, n_views=1, width=640, height=480)
    return BoardOnArm(crooked_arm(), "hand", Chessboard(square=0.02), sim.camera, sim.T_base_cam)


def test_the_print_faces_along_the_links_axis_beyond_the_link(board_on_arm: BoardOnArm) -> None:
    board, T = board_on_arm.board, board_on_arm.T_link_board
    middle = transform_points(T, board.square * np.array([board.columns, board.rows, 0]) / 2)
    # The hand's box ends 60 mm up its z axis.
    np.testing.assert_allclose(middle, [0.0, 0.0, 0.06 + GAP], atol=1e-9)
    np.testing.assert_allclose(T[:3, 2], [0.0, 0.0, -1.0])
    # Without geometry of its own, at 40 mm: the board sits right before the link.
    tool = BoardOnArm(crooked_arm(), "tool", board, board_on_arm.camera, board_on_arm.T_base_cam)
    middle = transform_points(
        tool.T_link_board, board.square * np.array([board.columns, board.rows, 0]) / 2
    )
    np.testing.assert_allclose(middle, [0.0, 0.0, GAP], atol=1e-9)


def test_pictures_show_the_board_and_their_poses_calibrate(board_on_arm: BoardOnArm) -> None:
    shots = board_on_arm.take_pictures(8, np.random.default_rng(2))
    assert len(shots) == 8 <= shots.pictures
    assert 0.0 < shots.in_view < 0.5
    robot, camera = board_on_arm.robot, board_on_arm.camera
    T_cam_base = inverse(board_on_arm.T_base_cam)
    expected = T_cam_base @ robot.frame_pose(shots.joints, "hand") @ board_on_arm.T_link_board
    np.testing.assert_allclose(shots.Ts_cam_board_true, expected, atol=1e-12)
    assert (shots.joints >= robot.lower).all()
    assert (shots.joints <= robot.upper).all()
    for T, T_true in zip(shots.Ts_cam_board, shots.Ts_cam_board_true, strict=True):
        px = camera.project(transform_points(T_true, board_on_arm.board.corners))
        assert ((px > 0) & (px < [camera.width - 1, camera.height - 1])).all()
        sight = T_true[:3, 3] / np.linalg.norm(T_true[:3, 3])
        assert sight @ T_true[:3, 2] > np.cos(MAX_SLANT + 0.2)
        metres, radians = pose_error(inverse(T), inverse(T_true))
        assert metres < 0.03
        assert radians < 0.06
    for method in SOLVERS:
        result = solve_hand_eye(robot.frame_pose(shots.joints, "hand"), shots.Ts_cam_board, method)
        assert result.T_mount_cam is not None
        metres, radians = pose_error(result.T_mount_cam, board_on_arm.T_base_cam)
        assert metres < 0.03
        assert np.rad2deg(radians) < 1.5


def test_the_same_seed_takes_the_same_pictures(board_on_arm: BoardOnArm) -> None:
    one, two = (board_on_arm.take_pictures(2, np.random.default_rng(5)) for _ in range(2))
    np.testing.assert_array_equal(one.joints, two.joints)
    np.testing.assert_array_equal(one.Ts_cam_board, two.Ts_cam_board)


def test_a_camera_that_looks_away_sees_no_board(board_on_arm: BoardOnArm) -> None:
    away = BoardOnArm(
        board_on_arm.robot, "hand", board_on_arm.board, board_on_arm.camera,
        look_at((2.0, 0.0, 0.5), (4.0, 0.0, 0.5)),
    )  # fmt: skip
    shots = away.take_pictures(2, np.random.default_rng(0))
    assert len(shots) == 0
    assert shots.in_view == 0.0
    assert shots.Ts_cam_board.shape == (0, 4, 4)


def test_an_unknown_link_is_named(board_on_arm: BoardOnArm) -> None:
    with pytest.raises(InputError, match=r"'flange9'.*base, upper, fore, hand, tool"):
        BoardOnArm(crooked_arm(), "flange9", board_on_arm.board, board_on_arm.camera, np.eye(4))
