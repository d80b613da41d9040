"""Every solver on exact poses, in both set-ups, and what cannot be solved."""

from __future__ import annotations

import numpy as np
import pytest

from easyhecpp.baselines.hand_eye import SOLVERS, solve_hand_eye
from easyhecpp.errors import InputError
from easyhecpp.geometry import exp_se3, exp_so3, inverse, look_at, make_transform, pose_error

F64 = np.ndarray

BOARD_ON_HOLDER = make_transform(exp_so3([0.4, -0.2, 1.1]), [0.03, -0.05, 0.11])
CAMERAS = {
    "beside the arm": look_at((1.1, -0.4, 0.7), (0.1, 0.0, 0.4)),
    "on the arm": make_transform(exp_so3([0.1, 0.2, -1.6]), [0.06, -0.02, 0.04]),
}


def exact(setup: str, count: int = 12) -> tuple[F64, F64, F64]:
    """True T_mount_cam, and what a perfect arm and a perfect detector report."""
    rng = np.random.default_rng(3)
    T_mount_cam = CAMERAS[setup]
    tangents = rng.uniform(-1, 1, (count, 6)) * [0.3, 0.3, 0.3, 1.2, 1.2, 1.2]
    Ts_base_ee = make_transform(np.eye(3), [0.3, 0.0, 0.5]) @ exp_se3(tangents)
    Ts_mount_holder = Ts_base_ee if setup == "beside the arm" else inverse(Ts_base_ee)
    return T_mount_cam, Ts_mount_holder, inverse(T_mount_cam) @ Ts_mount_holder @ BOARD_ON_HOLDER


@pytest.mark.parametrize("setup", CAMERAS)
@pytest.mark.parametrize("method", SOLVERS)
def test_exact_poses_give_the_exact_camera(method: str, setup: str) -> None:
    truth, Ts_mount_holder, Ts_cam_board = exact(setup)
    result = solve_hand_eye(Ts_mount_holder, Ts_cam_board, method)
    assert (result.status, result.method, result.views_used) == ("done", method, 12)
    assert result.T_mount_cam is not None
    metres, radians = pose_error(result.T_mount_cam, truth)
    assert metres < 1e-6
    assert radians < 1e-6


@pytest.mark.parametrize("method", SOLVERS)
def test_a_wrong_board_pose_moves_the_answer(method: str) -> None:
    truth, Ts_mount_holder, Ts_cam_board = exact("beside the arm")
    Ts_cam_board[0] = Ts_cam_board[0] @ exp_se3([0.02, 0, 0, 0, 0.05, 0])
    result = solve_hand_eye(Ts_mount_holder, Ts_cam_board, method)
    assert result.T_mount_cam is not None
    assert 1e-4 < pose_error(result.T_mount_cam, truth)[0] < 0.2


@pytest.mark.parametrize("method", SOLVERS)
def test_an_arm_that_never_turns_tells_nothing(method: str) -> None:
    truth, Ts_mount_holder, _ = exact("beside the arm")
    Ts_mount_holder[:, :3, :3] = Ts_mount_holder[0, :3, :3]
    result = solve_hand_eye(
        Ts_mount_holder, inverse(truth) @ Ts_mount_holder @ BOARD_ON_HOLDER, method
    )
    # Some solvers notice, others return anything; none returns something that is no pose.
    if result.T_mount_cam is None:
        assert result.status == "failed"
        assert result.message
    else:
        assert np.linalg.det(result.T_mount_cam[:3, :3]) == pytest.approx(1.0)


def test_bad_input() -> None:
    _, Ts_mount_holder, Ts_cam_board = exact("beside the arm")
    with pytest.raises(InputError, match=r"Unknown hand-eye solver 'Tsay'.*Tsai-Lenz, Park"):
        solve_hand_eye(Ts_mount_holder, Ts_cam_board, "Tsay")
    with pytest.raises(InputError, match="at least 3"):
        solve_hand_eye(Ts_mount_holder[:2], Ts_cam_board[:2], "Park")
    with pytest.raises(InputError, match=r"\(12, 4, 4\) and \(11, 4, 4\)"):
        solve_hand_eye(Ts_mount_holder, Ts_cam_board[1:], "Park")
