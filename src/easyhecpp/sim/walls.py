"""Walls, ceiling, pictures and furniture in the background of the simulated cell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from easyhecpp.sim import textures
from easyhecpp.sim.clutter import upright
from easyhecpp.sim.materials import random_colour
from easyhecpp.sim.panels import Lamp, PaintedPanel, painted

HEIGHT = 2.9
_CEILING_ABOVE_LAMPS = 0.1


@dataclass(frozen=True, eq=False)
class _Light:
    lamps: Sequence[Lamp]
    ambient: np.ndarray


def wall_pose(azimuth: float, distance: float, z: float) -> np.ndarray:
    """(4, 4) pose of a panel that stands upright at a distance and faces the base.

    Its x runs to the right as seen from the base, its y up, its z towards the base.
    """
    c, s = np.cos(azimuth), np.sin(azimuth)
    T = np.eye(4)
    T[:3, 0], T[:3, 1], T[:3, 2] = [s, -c, 0], [0, 0, 1], [-c, -s, 0]
    T[:3, 3] = distance * c, distance * s, z
    return T


def random_walls(
    rng: np.random.Generator,
    *,
    reach: float,
    floor_z: float,
    camera_azimuth: float,
    camera_distance: float,
    n_furniture: int,
    n_pictures: int,
    lamps: Sequence[Lamp],
    ambient: np.ndarray,
) -> tuple[list[PaintedPanel], str]:
    """A back wall, perhaps a side wall and a ceiling, with pictures and furniture.

    Args:
        rng: source of randomness.
        reach: of the arm, metres; nothing here comes nearer to the base.
        floor_z: height of the floor in the base frame.
        camera_azimuth: direction from the base towards the camera; the back wall is opposite.
        camera_distance: horizontal, metres; no wall comes between camera and arm.
        n_furniture: largest number of pieces of furniture.
        n_pictures: largest number of pictures on the back wall.
        lamps: that light all this.
        ambient: (3,) radiance.

    Returns:
        The panels, and the name of the wall's look.
    """
    light = _Light(lamps, ambient)
    back = camera_azimuth + np.pi + rng.normal(0, 0.25)
    distance = reach * rng.uniform(1.35, 2.3) + 0.3
    middle = floor_z + HEIGHT / 2
    picture, name = _wall_picture(rng)
    walls = [(back, distance)]
    if rng.random() < 0.6:
        turn = float(rng.choice([-1.0, 1.0]) * np.pi / 2)
        # Far enough aside that the camera, which may stand up to there, is inside the room.
        beside = camera_distance * max(np.cos(camera_azimuth - back - turn), 0.0)
        walls.append((back + turn, max(reach * rng.uniform(1.4, 2.6), beside) + 0.5))
    panels = [
        painted(
            "wall",
            wall_pose(azimuth, d, middle),
            (9.0, HEIGHT),
            picture,
            light.lamps,
            light.ambient,
            corner_shade=0.45,
        )
        for azimuth, d in walls
    ]
    if rng.random() < 0.5:
        panels.append(_ceiling(rng, floor_z, back, light))
    panels += _pictures(rng, n_pictures, floor_z, back, distance, light)
    panels += _furniture(rng, n_furniture, reach, floor_z, back, distance, light)
    return panels, name


def _wall_picture(rng: np.random.Generator) -> tuple[np.ndarray, str]:
    pale = random_colour(rng, saturation=0.12, value=(0.7, 0.92))
    kind = int(rng.choice(5, p=[0.5, 0.14, 0.12, 0.12, 0.12]))
    if kind == 0:
        picture, name = np.tile(textures.paint(rng, pale), (1, 3, 1)), "pale"
    elif kind == 1:
        strong = random_colour(rng, saturation=0.4, value=(0.25, 0.7))
        picture, name = np.tile(textures.paint(rng, strong), (1, 3, 1)), "coloured"
    elif kind == 2:
        picture, name = np.tile(textures.bricks(rng, (0.56, 0.30, 0.23)), (2, 5, 1)), "brick"
    elif kind == 3:
        grey = textures.concrete(rng, (0.56, 0.56, 0.55))
        picture, name = np.tile(grey, (1, 3, 1)), "concrete"
    else:
        picture, name = np.tile(textures.tiles(rng, pale), (2, 6, 1)), "tiled"
    picture = cv2.resize(picture, (1536, 512), interpolation=cv2.INTER_AREA)
    if rng.random() < 0.6:
        skirting = (np.asarray(random_colour(rng, saturation=0.2)) * 255).astype(np.uint8)
        picture[-18:] = skirting
    if rng.random() < 0.5:
        _draw_door(picture, rng)
    return picture, name


def _draw_door(wall: np.ndarray, rng: np.random.Generator) -> None:
    """A door with its frame, handle and perhaps a sign; the wall is 9 m by 2.9 m."""
    rows, columns = wall.shape[:2]
    high, wide = int(rows * 2.05 / HEIGHT), int(columns * rng.uniform(0.9, 1.7) / 9.0)
    x = int(rng.integers(columns // 5, 4 * columns // 5 - wide))
    frame = [int(v) for v in rng.uniform(40, 180, 3)]
    leaf = [int(255 * c) for c in random_colour(rng, saturation=0.25, value=(0.35, 0.9))]
    cv2.rectangle(wall, (x - 8, rows - high - 8), (x + wide + 8, rows), frame, -1)
    cv2.rectangle(wall, (x, rows - high), (x + wide, rows), leaf, -1)
    handle = x + (wide // 10 if rng.random() < 0.5 else 9 * wide // 10)
    cv2.line(wall, (handle, rows - high // 2 - 14), (handle, rows - high // 2 + 14), (50,) * 3, 4)
    if rng.random() < 0.6:
        sign = cv2.resize(textures.poster(rng, 128), (wide // 3, wide // 3))
        top = rows - int(0.75 * high)
        wall[top : top + wide // 3, x + wide // 3 : x + wide // 3 + wide // 3] = sign


def _ceiling(rng: np.random.Generator, floor_z: float, turn: float, light: _Light) -> PaintedPanel:
    picture = np.tile(textures.tiles(rng, (0.86, 0.86, 0.85)), (2, 2, 1))
    # Lamps hang below the ceiling, and above the camera: one that stands high is still in the room.
    above = max(lamp.T_base_lamp[2, 3] for lamp in light.lamps) + _CEILING_ABOVE_LAMPS
    T = upright(0, 0, max(floor_z + HEIGHT, above), turn) @ np.diag([1.0, -1, -1, 1])
    return painted("ceiling", T, (10.0, 10.0), picture, (), 1.4 * light.ambient)


def _pictures(
    rng: np.random.Generator,
    count: int,
    floor_z: float,
    azimuth: float,
    distance: float,
    light: _Light,
) -> list[PaintedPanel]:
    """Posters and notices a few millimetres in front of the back wall."""
    panels = []
    for _ in range(int(rng.integers(0, count + 1))):
        width = float(rng.uniform(0.2, 0.9))
        size = (width, width * float(rng.uniform(0.6, 1.4)))
        T = wall_pose(azimuth, distance, floor_z + rng.uniform(0.9, 2.1)) @ upright(
            rng.uniform(-2.0, 2.0), 0, rng.uniform(0.004, 0.02), 0
        )
        panels.append(painted("poster", T, size, textures.poster(rng), light.lamps, light.ambient))
    return panels


def _furniture(
    rng: np.random.Generator,
    count: int,
    reach: float,
    floor_z: float,
    azimuth: float,
    distance: float,
    light: _Light,
) -> list[PaintedPanel]:
    """Cabinets, shelves, stacked boxes and screens along the back wall, beyond the reach."""
    panels = []
    for _ in range(int(rng.integers(0, count + 1))):
        width, deep, high = rng.uniform([0.4, 0.3, 0.5], [1.3, 0.55, 2.0])
        deep = min(deep, distance - 1.15 * reach)
        colour = random_colour(rng, saturation=0.3, value=(0.25, 0.85))
        kind = rng.random()
        if kind < 0.45:
            front = textures.cabinet(rng, colour)
        elif kind < 0.75:
            front = textures.bookshelf(rng)
        elif kind < 0.9:
            front = textures.cardboard(rng)
        else:
            front = textures.screen(rng)
        T = wall_pose(azimuth, distance - deep / 2, floor_z + high / 2) @ upright(
            rng.uniform(-2.2, 2.2), 0, 0, 0
        )
        panels += _painted_box(rng, T, (width, high, deep), front, colour, light)
    return panels


def _painted_box(
    rng: np.random.Generator,
    T_base_box: np.ndarray,
    size: tuple[float, float, float],
    front: np.ndarray,
    colour: Sequence[float],
    light: _Light,
) -> list[PaintedPanel]:
    """Front, two sides and top of a box whose front looks along its z, y up."""
    width, high, deep = size
    plain = textures.paint(rng, colour, 128)
    turn_y = np.array([[0, 0, 1, 0], [0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 0, 1]], float)
    turn_x = np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]], float)
    sides = [
        (upright(0, 0, deep / 2, 0), (width, high), front),
        (upright(width / 2, 0, 0, 0) @ turn_y, (deep, high), plain),
        (upright(-width / 2, 0, 0, 0) @ turn_y.T, (deep, high), plain),
        (upright(0, high / 2, 0, 0) @ turn_x, (width, deep), plain),
    ]
    return [
        painted("furniture", T_base_box @ T, side, picture, light.lamps, light.ambient)
        for T, side, picture in sides
    ]
