"""Pictures of views that are not taken yet: how the arm is to stand."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from easyhecpp.camera import Camera
from easyhecpp.geometry import inverse, look_at
from easyhecpp.render import SilhouetteRenderer
from easyhecpp.report.outline import outline
from easyhecpp.report.overlay import ARM, draw_lines
from easyhecpp.robot import Robot

F64 = NDArray[np.float64]
Picture = NDArray[np.uint8]

_GROUND = (34, 36, 42)
_LINKS = np.array([[196, 200, 208], [150, 172, 205]], np.float64)
_WIDTH_PX = 960


def draw_predicted_view(robot: Robot, camera: Camera, Ts_cam_link: F64) -> Picture:
    """The arm as the camera will see it, nearer parts brighter, on a dark ground.

    Args:
        robot: The arm.
        camera: Intrinsics.
        Ts_cam_link: ``(L, 4, 4)``.

    Returns:
        ``(H, W, 3)`` RGB, at most 960 pixels wide.
    """
    renderer = SilhouetteRenderer(robot.meshes, camera.scaled(min(1.0, _WIDTH_PX / camera.width)))
    links, depth = renderer.visible_links(Ts_cam_link), renderer.depth(Ts_cam_link)
    picture = np.empty((*links.shape, 3), np.uint8)
    picture[:] = _GROUND
    shown = links >= 0
    if shown.any():
        near, far = depth[shown].min(), depth[shown].max()
        light = 1.0 - 0.55 * (depth[shown] - near) / max(float(far - near), 1e-9)
        picture[shown] = (_LINKS[links[shown] % len(_LINKS)] * light[:, None]).astype(np.uint8)
    draw_lines(picture, outline(renderer.coverage(Ts_cam_link)), ARM)
    return picture


def draw_from_four_sides(robot: Robot, joints: F64) -> Picture:
    """The arm in a joint pose ``(n,)`` from four sides, when no camera is known."""
    camera = Camera(480, 360, 440.0, 440.0, 239.5, 179.5)
    Ts_base_link = robot.link_poses(joints)
    middle = np.array([0.0, 0.0, robot.centre(joints)[2]])
    tiles: list[Picture] = []
    for azimuth in np.deg2rad([45.0, 135.0, 225.0, 315.0]):
        direction = np.array([np.cos(azimuth), np.sin(azimuth), 0.45])
        T_base_cam = look_at(middle + 1.3 * robot.reach * direction, middle)
        tiles.append(draw_predicted_view(robot, camera, inverse(T_base_cam) @ Ts_base_link))
    return np.vstack([np.hstack(tiles[:2]), np.hstack(tiles[2:])])
