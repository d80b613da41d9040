"""Other ways to the camera's pose, to compare with: marker-based hand-eye, and EasyHeC's Adam."""

from easyhecpp.baselines.adam import AdamConfig, AdamHistory, calibrate_with_adam
from easyhecpp.baselines.boards import Board, BoardCorners, CharucoBoard, Chessboard, board_pose
from easyhecpp.baselines.hand_eye import SOLVERS, solve_hand_eye
from easyhecpp.baselines.types import BaselineResult

__all__ = [
    "SOLVERS",
    "AdamConfig",
    "AdamHistory",
    "BaselineResult",
    "Board",
    "BoardCorners",
    "CharucoBoard",
    "Chessboard",
    "board_pose",
    "calibrate_with_adam",
    "solve_hand_eye",
]
