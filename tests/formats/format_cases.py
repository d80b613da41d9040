"""Poses and results that the tests of this folder share."""

from __future__ import annotations

from datetime import datetime, timezone

import numpy as np
from scipy.spatial.transform import Rotation

from easyhecpp.camera import Camera
from easyhecpp.formats.result_file import ResultFile, RobotBlock, ViewResult

# A camera with unequal focal lengths and the principal point well off the middle, so that a mix-up
# of axes, signs or half pixels cannot cancel out.
CAMERA = Camera(1280, 720, 908.3, 911.7, 655.25, 341.5, frame="camera_color_optical_frame")


def pose(rotation: Rotation, xyz: tuple[float, float, float]) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3] = rotation.as_matrix()
    T[:3, 3] = xyz
    return T


def poses() -> list[np.ndarray]:
    """Random poses, and those at which Euler angles and quaternions are delicate."""
    rng = np.random.default_rng(7)
    found = [
        pose(rotation, tuple(rng.uniform(-2.0, 2.0, 3)))
        for rotation in Rotation.random(12, random_state=rng)
    ]
    delicate = [
        Rotation.identity(),
        Rotation.from_euler("xyz", [180.0, 0.0, 0.0], degrees=True),
        Rotation.from_euler("xyz", [-90.0, 0.0, -90.0], degrees=True),
    ]
    # Pitch at and near a right angle, where roll and yaw lose their meaning one by one.
    for off in (0.0, 1e-12, 1e-9, 1e-7, 1e-4):
        delicate += [
            Rotation.from_euler("xyz", [0.4, sign * (np.pi / 2 - off), -1.1]) for sign in (1, -1)
        ]
    found += [pose(rotation, (1e-9, -0.12345678901234567, 2.0)) for rotation in delicate]
    return found


COVARIANCE = np.array(
    [
        [4.0e-7, 1.0e-8, 0.0, 0.0, 2.0e-8, 0.0],
        [1.0e-8, 3.0e-7, 0.0, -1.5e-8, 0.0, 0.0],
        [0.0, 0.0, 9.0e-7, 0.0, 0.0, 0.0],
        [0.0, -1.5e-8, 0.0, 4.0e-8, 0.0, 0.0],
        [2.0e-8, 0.0, 0.0, 0.0, 5.0e-8, 0.0],
        [0.0, 0.0, 0.0, 0.0, 0.0, 6.0e-8],
    ]
)


def make_result(T_mount_cam: np.ndarray | None = None, **changes: object) -> ResultFile:
    values: dict[str, object] = {
        "setup": "eye-to-hand",
        "robot": RobotBlock(name="arm", base_link="link_base", ee_link="link_eef"),
        "camera": CAMERA,
        "verdict": "ok",
        "T_mount_cam": poses()[0] if T_mount_cam is None else T_mount_cam,
        "covariance": COVARIANCE,
        "workspace_point": (0.4, 0.0, 0.2),
        "reasons": ["Five views agree."],
        "views": [
            ViewResult(id="0007", weight=1.0, rms_px=0.4, iou=0.98, prediction_px=0.5),
            ViewResult(id="0008", weight=0.0, flags=("moved while photographed",)),
        ],
        "segmenter": "given",
        "command": "easyhecpp calibrate captures/a 'with space'",
        "timings_s": {"segment": 0.5, "solve": 1.25},
        "config": {"levels": (8, 4, 2, 1), "prior": float("inf")},
        "created": datetime(2026, 3, 4, 5, 6, 7, tzinfo=timezone.utc),
    }
    return ResultFile.build(**(values | changes))  # type: ignore[arg-type]
