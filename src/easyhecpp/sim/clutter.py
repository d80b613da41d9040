"""Small things that lie about on the table of the simulated cell."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from easyhecpp.sim import textures
from easyhecpp.sim.materials import Material, metal, plastic, random_colour, textured
from easyhecpp.sim.shapes import Surface, box, lathe, merged, moved, panel, sphere, tube


@dataclass(frozen=True, eq=False)
class Prop:
    """A thing that does not move.

    Attributes:
        name: what it is.
        surface: its triangles in the base frame.
        material: its finish.
    """

    name: str
    surface: Surface
    material: Material


def upright(x: float, y: float, z: float, turn: float) -> np.ndarray:
    """(4, 4) pose of a thing that stands at a point, turned about the vertical by ``turn`` rad."""
    T = np.eye(4)
    c, s = np.cos(turn), np.sin(turn)
    T[:3, :3] = [[c, -s, 0], [s, c, 0], [0, 0, 1]]
    T[:3, 3] = x, y, z
    return T


def parcel(rng: np.random.Generator, size: float) -> tuple[Surface, Material]:
    """A box: cardboard, patterned, or plain plastic."""
    w, d, h = size * rng.uniform([0.5, 0.5, 0.25], [1.2, 1.2, 1.0])
    kind = rng.random()
    if kind < 0.45:
        material = textured(textures.cardboard(rng, 384), roughness=0.8)
    elif kind < 0.75:
        material = textured(textures.spots(rng), roughness=float(rng.uniform(0.25, 0.8)))
    else:
        material = plastic(random_colour(rng, saturation=0.9), float(rng.uniform(0.2, 0.6)))
    return moved(box((w, d, h)), upright(0, 0, h / 2, 0)), material


def instrument(rng: np.random.Generator, size: float) -> tuple[Surface, Material]:
    """A controller or power supply: a flat grey case with a front panel."""
    w, d, h = size * rng.uniform([1.0, 0.8, 0.3], [1.5, 1.2, 0.55])
    picture = textures.screen(rng, 256)
    picture[:] = picture // 3 + (rng.uniform(0.15, 0.6, 3) * 170).astype(np.uint8)
    return moved(box((w, d, h)), upright(0, 0, h / 2, 0)), textured(picture, roughness=0.45)


def ball(rng: np.random.Generator, size: float) -> tuple[Surface, Material]:
    """A ball, plain or patterned."""
    radius = size * rng.uniform(0.2, 0.45)
    if rng.random() < 0.5:
        material = textured(textures.spots(rng), roughness=0.3)
    else:
        material = plastic(random_colour(rng, saturation=0.95), float(rng.uniform(0.1, 0.6)))
    return moved(sphere(radius), upright(0, 0, radius, 0)), material


def bottle(rng: np.random.Generator, size: float) -> tuple[Surface, Material]:
    """A bottle or can."""
    r, h = size * rng.uniform(0.14, 0.25), size * rng.uniform(0.5, 1.2)
    neck = rng.uniform(0.3, 0.95)
    profile = [[0, 0], [r, 0], [r, 0.68 * h], [r * neck, 0.82 * h], [r * neck, h], [0, h]]
    if rng.random() < 0.35:
        material = metal(roughness=float(rng.uniform(0.15, 0.4)))
    elif rng.random() < 0.5:
        material = textured(textures.poster(rng, 256), roughness=0.3, coat=0.5)
    else:
        material = plastic(random_colour(rng, saturation=0.9), 0.15)
    return lathe(np.array(profile)), material


def mug(rng: np.random.Generator, size: float) -> tuple[Surface, Material]:
    """A mug without its handle."""
    r, h = size * rng.uniform(0.2, 0.28), size * rng.uniform(0.4, 0.6)
    inner = 0.9 * r
    profile = [[0, 0], [r, 0], [r, h], [inner, h], [inner, 0.1 * h], [0, 0.1 * h]]
    return lathe(np.array(profile)), plastic(random_colour(rng, saturation=0.8), 0.12)


def cable(rng: np.random.Generator, size: float) -> tuple[Surface, Material]:
    """A loosely coiled cable lying flat."""
    turns = rng.uniform(0.4, 3.0)
    t = np.linspace(0, 1, int(60 + 60 * turns))
    radius = size * (0.7 + 0.5 * np.sin(2 * np.pi * (t + rng.random())) * rng.uniform(0.1, 0.5))
    angle = 2 * np.pi * turns * t
    thickness = size * rng.uniform(0.02, 0.045)
    height = thickness + 0.5 * thickness * (1 + np.sin(9 * angle + rng.random()))
    path = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), height])
    path[:, :2] += np.outer(t, size * rng.uniform(-1.5, 1.5, 2))
    bright = rng.random() < 0.4
    colour = random_colour(rng, saturation=0.95, value=(0.5, 0.9)) if bright else (0.04, 0.04, 0.04)
    return tube(path, thickness), plastic(colour, 0.5)


def laptop(rng: np.random.Generator, size: float) -> list[tuple[Surface, Material]]:
    """An open laptop whose screen looks towards -y: a case and a picture."""
    w, d, t = 1.45 * size, size, 0.06 * size
    tilt = np.radians(rng.uniform(5, 30))
    lid = np.eye(4)
    lid[:3, 1] = 0.0, np.sin(tilt), np.cos(tilt)
    lid[:3, 2] = 0.0, -np.cos(tilt), np.sin(tilt)
    lid[:3, 3] = np.array([0, d / 2, t]) + lid[:3, 1] * d / 2
    glass = lid.copy()
    glass[:3, 3] += lid[:3, 2] * 0.021 * size
    case = merged(
        moved(box((w, d, t)), upright(0, 0, t / 2, 0)), moved(box((w, d, 0.04 * size)), lid)
    )
    shade = random_colour(rng, saturation=0.1, value=(0.06, 0.6))
    return [
        (case, plastic(shade, 0.4)),
        (
            moved(panel(0.93 * w, 0.9 * d), glass),
            textured(textures.screen(rng, 384), roughness=0.2),
        ),
    ]


_ITEMS = (parcel, instrument, ball, bottle, mug, cable)
_SHARES = (0.36, 0.12, 0.10, 0.16, 0.10, 0.16)


def random_item(rng: np.random.Generator, size: float) -> list[tuple[Surface, Material]]:
    """A thing standing on z = 0 around the origin, as surfaces with finishes.

    Args:
        rng: source of randomness.
        size: rough edge length in metres.
    """
    if rng.random() < 0.05:
        return laptop(rng, 1.3 * size)
    return [_ITEMS[int(rng.choice(len(_ITEMS), p=_SHARES))](rng, size)]
