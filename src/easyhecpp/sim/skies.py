"""Procedural environment maps: what surrounds the simulated cell and lights it from far away.

A sky is an equirectangular picture of linear radiance, ``(n, 2n, 3) float32``: the first row is
straight up, the last straight down, columns go once around. A picture 2 m behind the last wall
of a real laboratory is out of focus too, so 256 rows are plenty.
"""

from __future__ import annotations

import cv2
import numpy as np

from easyhecpp.sim.textures import fractal_noise

ROWS = 256


def _grid() -> tuple[np.ndarray, np.ndarray]:
    """Elevation (ROWS, 1) and azimuth (1, 2 ROWS) of the pixel centres in degrees."""
    elevation = 90.0 - (np.arange(ROWS) + 0.5) * 180.0 / ROWS
    azimuth = (np.arange(2 * ROWS) + 0.5) * 180.0 / ROWS
    return elevation[:, None], azimuth[None]


def _box(
    azimuth_deg: float, elevation_deg: float, width_deg: float, height_deg: float
) -> np.ndarray:
    """(ROWS, 2 ROWS) bool: an upright rectangle seen from the middle of the room."""
    elevation, azimuth = _grid()
    turn = (azimuth - azimuth_deg + 180.0) % 360.0 - 180.0
    return (np.abs(turn) < width_deg / 2) & (np.abs(elevation - elevation_deg) < height_deg / 2)


def _finish(sky: np.ndarray, blur_px: float) -> np.ndarray:
    wide = np.concatenate([sky[:, -16:], sky, sky[:, :16]], axis=1).astype(np.float32)
    soft = cv2.GaussianBlur(wide, (0, 0), blur_px)[:, 16:-16]
    return np.ascontiguousarray(np.maximum(soft, 0.0), dtype=np.float32)


def _room(rng: np.random.Generator, wall: np.ndarray, level: float) -> np.ndarray:
    """Ceiling, walls and floor without lights, furniture as blocks of colour."""
    elevation, _ = _grid()
    sky = np.empty((ROWS, 2 * ROWS, 3))
    ceiling, floor = np.array([0.80, 0.80, 0.78]), rng.uniform(0.12, 0.4, 3)
    rows = elevation[:, 0]
    sky[:] = wall
    sky[rows > 34.0] = ceiling * 0.9
    sky[rows < -22.0] = floor
    for _ in range(int(rng.integers(8, 20))):
        height = rng.uniform(8, 40)
        block = _box(rng.uniform(0, 360), -22 + height / 2, rng.uniform(6, 40), height)
        sky[block] = rng.uniform(0.03, 0.75, 3)
    for _ in range(int(rng.integers(2, 9))):
        picture = _box(
            rng.uniform(0, 360), rng.uniform(0, 22), rng.uniform(4, 14), rng.uniform(5, 14)
        )
        sky[picture] = rng.uniform(0.05, 0.9, 3)
    shade = 1.0 + 0.10 * fractal_noise((ROWS, 2 * ROWS), rng, slope=1.4)
    return sky * shade[..., None] * level


def office(rng: np.random.Generator) -> np.ndarray:
    """A bright room with rows of ceiling panels."""
    sky = _room(rng, rng.uniform(0.6, 0.85) * np.array([1.0, 0.99, 0.96]), 0.55)
    warmth = np.array([1.0, rng.uniform(0.92, 1.0), rng.uniform(0.8, 1.0)])
    for turn in np.arange(0, 360, rng.choice([60, 72, 90])) + rng.uniform(0, 60):
        for elevation in (42.0, 66.0):
            if rng.random() < 0.8:
                sky[_box(turn, elevation, 26 if elevation > 60 else 17, 8)] = 2.4 * warmth
    return _finish(sky, 1.6)


def window(rng: np.random.Generator) -> np.ndarray:
    """A dim room with one wall of windows."""
    sky = _room(rng, rng.uniform(0.4, 0.8, 3), 0.35)
    middle = rng.uniform(0, 360)
    daylight = np.array([0.86, 0.95, 1.08]) * rng.uniform(1.5, 2.6)
    for i in range(int(rng.integers(2, 5))):
        pane = _box(middle + 24 * i, 14, 20, rng.uniform(26, 40))
        sky[pane] = daylight * (1.0 + 0.2 * rng.standard_normal())
    return _finish(sky, 1.6)


def overcast(rng: np.random.Generator) -> np.ndarray:
    """Outdoors under clouds, with a skyline of blocks."""
    elevation, _ = _grid()
    cloud = fractal_noise((ROWS, 2 * ROWS), rng, slope=1.5)
    up = np.clip(elevation / 90.0, 0.0, 1.0)
    sky = (0.8 + 1.0 * up + 0.18 * cloud)[..., None] * np.array([0.93, 0.98, 1.05])
    sky[elevation[:, 0] < 0.0] = rng.uniform(0.15, 0.45, 3)
    for _ in range(int(rng.integers(10, 30))):
        height = rng.uniform(3, 16)
        sky[_box(rng.uniform(0, 360), height / 2, rng.uniform(3, 20), height)] = rng.uniform(
            0.1, 0.7, 3
        )
    return _finish(sky, 1.2)


def sunny(rng: np.random.Generator) -> np.ndarray:
    """A clear sky with a low or high sun: one hard-edged shadow."""
    elevation, azimuth = _grid()
    up = np.clip(elevation / 90.0, 0.0, 1.0) + 0.0 * azimuth
    sky = (1.0 - 0.6 * up)[..., None] * np.array([0.75, 0.88, 1.15]) * 0.8
    sky[elevation[:, 0] < 0.0] = rng.uniform(0.15, 0.4, 3)
    sun = _box(rng.uniform(0, 360), rng.uniform(30, 65), 7.0, 5.0)
    sky[sun] = np.array([1.0, 0.93, 0.82]) * 160.0
    return _finish(sky, 1.4)


def hall(rng: np.random.Generator) -> np.ndarray:
    """A dark workshop with a few lamps high up."""
    sky = _room(rng, rng.uniform(0.15, 0.45, 3), 0.25)
    for _ in range(int(rng.integers(3, 7))):
        warmth = np.array([1.0, rng.uniform(0.8, 1.0), rng.uniform(0.6, 1.0)])
        lamp = _box(rng.uniform(0, 360), rng.uniform(35, 75), rng.uniform(8, 20), 6)
        sky[lamp] = 3.0 * warmth
    return _finish(sky, 1.6)


SKIES = {
    "office": office,
    "window": window,
    "overcast": overcast,
    "sunny": sunny,
    "hall": hall,
}


def random_sky(rng: np.random.Generator) -> tuple[str, np.ndarray]:
    """A sky of a random kind; rooms are more common than the open air.

    Returns:
        (name of the kind, (ROWS, 2 ROWS, 3) float32 linear radiance).
    """
    names = list(SKIES)
    name = names[int(rng.choice(len(names), p=[0.4, 0.2, 0.12, 0.1, 0.18]))]
    return name, SKIES[name](rng)
