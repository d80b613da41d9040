"""A picture of the whole set-up: the arm, where the camera is, where it looks."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape

import cv2
import numpy as np
from numpy.typing import NDArray

from easyhecpp.camera import Camera
from easyhecpp.capture import Capture
from easyhecpp.geometry import inverse, look_at, transform_points
from easyhecpp.render import SilhouetteRenderer
from easyhecpp.report.pictures import as_uri
from easyhecpp.report.uncertainty import SIGMAS_95

F64 = NDArray[np.float64]

_WIDTH, _HEIGHT = 560, 330
_OVERSAMPLE = 2
_FOCAL_PX = 900.0
_MARGINS_PX = (66.0, 30.0)
_GRAZE_DEG, _TURN_DEG = 24.0, 62.0
_LEVELS = 24
_FLOOR_STEP = 0.25


@dataclass(frozen=True)
class _Stage:
    """A bystander's camera that sees everything, and the frame of the picture."""

    camera: Camera
    T_view_mount: F64

    def pixels(self, points_mount: F64) -> F64:
        return self.camera.project(transform_points(self.T_view_mount, points_mount))


def scene_svg(
    capture: Capture, joints: F64, T_mount_cam: F64, position_covariance: F64 | None = None
) -> tuple[str, str]:
    """Draw the arm at one view's joints, its base, the camera with its field of view.

    Args:
        capture: Robot, camera and set-up.
        joints: ``(n,)``.
        T_mount_cam: ``(4, 4)``.
        position_covariance: ``(3, 3)`` of the camera's centre along its own axes, square metres;
            drawn as the 95 % ellipsoid, enlarged by a round factor.

    Returns:
        The SVG, and a sentence on the scale of what it shows.
    """
    rig = capture.rig
    Ts_mount_link = rig.Ts_mount_link(joints)
    meshes = capture.robot.meshes
    T_mount_base = inverse(capture.robot.frame_pose(joints, rig.mount))
    arm = np.concatenate(
        [transform_points(T, m.vertices) for T, m in zip(Ts_mount_link, meshes, strict=True)]
    )
    distance = float(np.linalg.norm(T_mount_cam[:3, 3] - arm.mean(axis=0)))
    frustum = transform_points(T_mount_cam, _frustum(capture.camera, 0.22 * distance))
    stage = _stage(arm, frustum, T_mount_base[:3, 2], T_mount_base[:3, 3])
    renderer = SilhouetteRenderer(meshes, stage.camera.scaled(_OVERSAMPLE))
    parts = [
        f'<svg class="plot scene" viewBox="0 0 {_WIDTH} {_HEIGHT}" role="img" '
        'aria-label="Arm and camera">',
        *_floor(stage, T_mount_base, np.vstack([arm, frustum])),
        _arm(renderer, stage.T_view_mount @ Ts_mount_link),
        *_axes(stage, T_mount_base, 0.16 * distance),
    ]
    note = f"One square of the floor is {_FLOOR_STEP:g} m."
    if position_covariance is not None:
        factor = _enlargement(position_covariance, 0.09 * distance)
        parts += _ellipsoid(stage, T_mount_cam, factor**2 * position_covariance)
        note += f" The camera's 95 % ellipsoid is drawn {factor:,g} times enlarged."
    parts += _camera(stage, frustum)
    parts += _axes(stage, T_mount_cam, 0.13 * distance)
    parts += _camera_label(stage, frustum)
    parts += _label(stage, T_mount_base[:3, 3], capture.robot.base_link)
    if rig.mount != capture.robot.base_link:
        parts += _label(stage, np.zeros(3), rig.mount)
    return "".join([*parts, "</svg>"]), note


def _frustum(camera: Camera, depth: float) -> F64:
    """The camera's centre and the four corners of its picture at a depth, camera frame."""
    w, h = camera.width - 0.5, camera.height - 0.5
    corners = np.array([[-0.5, -0.5], [w, -0.5], [w, h], [-0.5, h]])
    return np.vstack([np.zeros(3), depth * camera.unproject(corners)])


def _stage(arm: F64, frustum: F64, up: F64, base: F64) -> _Stage:
    """Place the bystander beside the line from arm to camera, a little above, all in view."""
    points = np.vstack([arm[:: max(1, len(arm) // 2000)], frustum, base[None]])
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    away = frustum[0] - arm.mean(axis=0)
    away = away - up * (away @ up)
    if np.linalg.norm(away) < 1e-6:
        away = np.cross(up, (0.3, 0.5, 0.8))
    away = away / np.linalg.norm(away)
    turn, graze = np.radians(_TURN_DEG), np.radians(_GRAZE_DEG)
    side = np.cos(turn) * away + np.sin(turn) * np.cross(up, away)
    direction = np.cos(graze) * side + np.sin(graze) * up
    radius = float(np.linalg.norm(points - middle, axis=1).max())
    eye = middle + direction * radius * 4.0
    T_view_mount = inverse(look_at(eye, middle, up))
    unit = Camera(_WIDTH, _HEIGHT, _FOCAL_PX, _FOCAL_PX, 0.0, 0.0).project(
        transform_points(T_view_mount, points)
    )
    low, high = unit.min(axis=0), unit.max(axis=0)
    room = np.array([_WIDTH, _HEIGHT]) - 2 * np.array(_MARGINS_PX)
    zoom = float((room / (high - low)).min())
    centre = np.array([_WIDTH, _HEIGHT]) / 2 - zoom * 0.5 * (low + high)
    f = _FOCAL_PX * zoom
    return _Stage(Camera(_WIDTH, _HEIGHT, f, f, float(centre[0]), float(centre[1])), T_view_mount)


def _arm(renderer: SilhouetteRenderer, Ts_view_link: F64) -> str:
    """The arm as a shaded picture, cut to its box."""
    depth = renderer.depth(Ts_view_link)
    alpha = renderer.coverage(Ts_view_link)
    rows = np.flatnonzero(alpha.any(axis=1))
    columns = np.flatnonzero(alpha.any(axis=0))
    if len(rows) == 0:
        return ""
    box = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    shade = _shade(depth[box], renderer.camera.fx, alpha[box])
    picture = np.dstack([shade * c for c in (250.0, 240.0, 232.0)] + [255.0 * alpha[box]])
    _, data = cv2.imencode(".png", picture.astype(np.uint8))
    k = 1.0 / _OVERSAMPLE
    return (
        f'<image x="{columns[0] * k:g}" y="{rows[0] * k:g}" width="{shade.shape[1] * k:g}" '
        f'height="{shade.shape[0] * k:g}" href="{as_uri(data, "image/png")}"/>'
    )


def _shade(depth: NDArray[np.float32], focal_px: float, alpha: NDArray[np.float32]) -> F64:
    """Light from the upper left; creases and borders between links come out dark by themselves."""
    seen = np.isfinite(depth)
    z = np.where(seen, depth, np.max(depth[seen], initial=1.0))
    slope_y, slope_x = np.gradient(z)
    metres_per_px = z / focal_px
    normal = np.dstack([slope_x / metres_per_px, slope_y / metres_per_px, -np.ones_like(z)])
    normal /= np.linalg.norm(normal, axis=2, keepdims=True)
    light = np.array([-0.45, -0.6, -0.66])
    shade = 0.38 + 0.62 * np.clip(normal @ light, 0.0, 1.0)
    # Few levels compress well, and look no worse at this size.
    return np.where(alpha > 0, np.rint(shade * _LEVELS) / _LEVELS, 0.0)


def _floor(stage: _Stage, T_mount_base: F64, points: F64) -> list[str]:
    """A grid through the base's origin."""
    flat = transform_points(inverse(T_mount_base), points)[:, :2]
    step = _FLOOR_STEP
    low = np.floor(flat.min(axis=0) / step) * step
    high = np.ceil(flat.max(axis=0) / step) * step
    if float((high - low).max()) > 40 * step:
        return []
    lines: list[F64] = []
    for x in np.arange(low[0], high[0] + step / 2, step):
        lines.append(np.array([[x, low[1], 0.0], [x, high[1], 0.0]]))
    for y in np.arange(low[1], high[1] + step / 2, step):
        lines.append(np.array([[low[0], y, 0.0], [high[0], y, 0.0]]))
    d = "".join(_line(stage.pixels(transform_points(T_mount_base, line))) for line in lines)
    return [f'<path class="grid" d="{d}"/>']


def _axes(stage: _Stage, T_mount_x: F64, length: float) -> list[str]:
    ends = transform_points(T_mount_x, np.vstack([np.zeros(3), length * np.eye(3)]))
    pixels = stage.pixels(ends)
    return [
        f'<path class="axis-{name}" d="{_line(pixels[[0, i + 1]])}"/>'
        for i, name in enumerate("xyz")
    ]


def _camera(stage: _Stage, frustum: F64) -> list[str]:
    px = stage.pixels(frustum)
    rays = "".join(_line(px[[0, i]]) for i in range(1, 5))
    return [
        f'<path class="frustum face" d="{_line(px[1:])}Z"/>',
        f'<path class="frustum" d="{rays}"/>',
    ]


def _enlargement(covariance: F64, size: float) -> float:
    """The round factor that brings the 95 % ellipsoid closest to a size without exceeding it."""
    longest = SIGMAS_95 * float(np.sqrt(max(np.linalg.eigvalsh(covariance)[-1], 1e-18)))
    wanted = size / longest
    if wanted < 2.0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(max(f for f in (1, 2, 5) if f * power <= wanted) * power)


def _ellipsoid(stage: _Stage, T_mount_cam: F64, covariance: F64) -> list[str]:
    T_view_cam = stage.T_view_mount @ T_mount_cam
    _, J = stage.camera.project_with_jacobian(T_view_cam[:3, 3])
    A = SIGMAS_95 * J @ T_view_cam[:3, :3]
    squares, vectors = np.linalg.eigh(A @ covariance @ A.T)
    radii = np.sqrt(np.maximum(squares, 0.25))
    angle = float(np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1])))
    x, y = stage.camera.project(T_view_cam[:3, 3]).tolist()
    return [
        f'<ellipse class="camera" rx="{radii[1]:.1f}" ry="{radii[0]:.1f}" '
        f'transform="translate({x:.1f} {y:.1f}) rotate({angle:.1f})"/>'
    ]


def _camera_label(stage: _Stage, frustum: F64) -> list[str]:
    """Behind the camera, where its field of view does not hide the word."""
    px = stage.pixels(frustum)
    away = px[0] - px[1:].mean(axis=0)
    away = away / max(float(np.linalg.norm(away)), 1e-9)
    return [_text(px[0] + away * (44.0, 24.0) + (0.0, 4.0), "camera")]


def _label(stage: _Stage, point: F64, name: str) -> list[str]:
    return [_text(stage.pixels(point[None])[0] + (0.0, 30.0), name)]


def _text(at: F64, name: str) -> str:
    half = 4.0 * len(name)
    x = float(np.clip(at[0], half + 2.0, _WIDTH - half - 2.0))
    y = float(np.clip(at[1], 12.0, _HEIGHT - 4.0))
    return f'<text class="label" x="{x:.1f}" y="{y:.1f}" text-anchor="middle">{escape(name)}</text>'


def _line(pixels: F64) -> str:
    return "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in pixels.tolist())
