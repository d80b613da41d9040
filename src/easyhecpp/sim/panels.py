"""Flat things that are painted with their light already on them: walls, ceiling, furniture.

Tracing light between the arm and everything that merely stands behind it would take most of the
time and give most of the noise. Those surfaces glow instead with what they would reflect: lamps
without shadows, and the ambient light, darker towards the corners. They light the arm in turn.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from easyhecpp.sim.shapes import Surface, moved, panel


@dataclass(frozen=True, eq=False)
class Lamp:
    """A flat rectangular lamp.

    Attributes:
        T_base_lamp: (4, 4) pose; it shines along its +z.
        size: (width, height) metres.
        radiance: (3,) linear.
    """

    T_base_lamp: np.ndarray
    size: tuple[float, float]
    radiance: np.ndarray


@dataclass(frozen=True, eq=False)
class PaintedPanel:
    """A rectangle that shows a picture of light.

    Attributes:
        name: what it is.
        T_base_panel: (4, 4) pose: x to the right of the picture, y up, z towards the viewer.
        size: (width, height) metres.
        radiance: (n, m, 3) float32 linear, first row at the top.
    """

    name: str
    T_base_panel: np.ndarray
    size: tuple[float, float]
    radiance: np.ndarray

    @property
    def surface(self) -> Surface:
        """The rectangle as triangles in the base frame."""
        return moved(panel(*self.size), self.T_base_panel)


def to_linear(picture: np.ndarray) -> np.ndarray:
    """(..., 3) uint8 sRGB to float32 linear reflectance or radiance."""
    levels = np.arange(256) / 255.0
    table = np.where(levels <= 0.04045, levels / 12.92, ((levels + 0.055) / 1.055) ** 2.4)
    return table.astype(np.float32)[picture]


@dataclass(frozen=True, eq=False)
class Shade:
    """A level rectangle that keeps light from what is below it: a table top.

    Attributes:
        T_base_top: (4, 4) pose of its middle, z up.
        size: (width, depth) metres.
    """

    T_base_top: np.ndarray
    size: tuple[float, float]

    def blocks(self, start: np.ndarray, end: np.ndarray) -> np.ndarray:
        """(...) bool whether the rectangle cuts the segments between points (..., 3)."""
        R, t = self.T_base_top[:3, :3], self.T_base_top[:3, 3]
        a, b = (start - t) @ R, (end - t) @ R
        crosses = a[..., 2] * b[..., 2] < 0
        share = a[..., 2] / np.where(crosses, a[..., 2] - b[..., 2], 1.0)
        spot = a[..., :2] + share[..., None] * (b[..., :2] - a[..., :2])
        return crosses & (np.abs(spot) < np.array(self.size) / 2).all(axis=-1)


def painted(
    name: str,
    T_base_panel: np.ndarray,
    size: tuple[float, float],
    picture: np.ndarray,
    lamps: Sequence[Lamp],
    ambient: np.ndarray,
    *,
    corner_shade: float = 0.0,
    shades: Sequence[Shade] = (),
    cells: int = 24,
) -> PaintedPanel:
    """Put light on a picture.

    Args:
        name: what it is.
        T_base_panel: (4, 4) pose, see `PaintedPanel`.
        size: metres.
        picture: (n, m, 3) uint8 sRGB, how it looks in even white light.
        lamps: that shine on it.
        ambient: (3,) radiance of the rest of the room.
        corner_shade: how much darker the ambient light is at the border, 0 to 1.
        shades: what throws shadows on it.
        cells: light is worked out on a grid of this many rows and columns.
    """
    points, border = _grid(T_base_panel, size, cells)
    open_share = 1.0 - corner_shade * np.exp(-border / 0.35)
    open_share *= _open_share(points, T_base_panel[:3, :3], shades)
    light = open_share[..., None] * np.pi * ambient
    for lamp in lamps:
        light = light + _from_lamp(points, T_base_panel[:3, 2], lamp, shades)
    rows, columns = picture.shape[:2]
    light = cv2.resize(light.astype(np.float32), (columns, rows), interpolation=cv2.INTER_LINEAR)
    return PaintedPanel(
        name, T_base_panel, size, to_linear(picture) * np.maximum(light, 0.0) / np.float32(np.pi)
    )


def _grid(
    T_base_panel: np.ndarray, size: tuple[float, float], cells: int
) -> tuple[np.ndarray, np.ndarray]:
    """Points (cells, cells, 3) on a panel, and their distance (cells, cells) from its border."""
    middle = (np.arange(cells) + 0.5) / cells - 0.5
    x, y = np.meshgrid(middle * size[0], -middle * size[1])
    local = np.stack([x, y, 0 * x, 0 * x + 1], axis=-1)
    border = np.minimum(size[0] / 2 - np.abs(x), size[1] / 2 - np.abs(y))
    return (local @ T_base_panel.T)[..., :3], border


def _open_share(points: np.ndarray, R: np.ndarray, shades: Sequence[Shade]) -> np.ndarray:
    """(...) share of the hemisphere, weighted by cosine, that no shade blocks."""
    share = np.ones(points.shape[:-1])
    if not shades:
        return share
    count = 32
    k = np.arange(count) + 0.5
    radius, turn = np.sqrt(k / count), k * np.pi * (3 - np.sqrt(5))
    up = np.sqrt(1 - radius**2)
    directions = np.column_stack([radius * np.cos(turn), radius * np.sin(turn), up]) @ R.T
    for direction in directions:
        blocked = [shade.blocks(points, points + 5.0 * direction) for shade in shades]
        share -= np.any(blocked, axis=0) / count
    return share


def _from_lamp(
    points: np.ndarray, normal: np.ndarray, lamp: Lamp, shades: Sequence[Shade]
) -> np.ndarray:
    """(..., 3) irradiance at points from one lamp, taken as sixteen small ones."""
    light = np.zeros((*points.shape[:-1], 3))
    steps = (np.arange(4) + 0.5) / 4 - 0.5
    for u in steps:
        for v in steps:
            spot = (lamp.T_base_lamp @ [u * lamp.size[0], v * lamp.size[1], 0, 1])[:3]
            ray = points - spot
            distance = np.maximum(np.linalg.norm(ray, axis=-1), 0.15)
            leaving = np.maximum(ray @ lamp.T_base_lamp[:3, 2], 0) / distance
            arriving = np.maximum(-(ray @ normal), 0) / distance
            share = leaving * arriving * lamp.size[0] * lamp.size[1] / 16 / distance**2
            for shade in shades:
                share = np.where(shade.blocks(spot, points), 0.0, share)
            light += share[..., None] * lamp.radiance
    return light
