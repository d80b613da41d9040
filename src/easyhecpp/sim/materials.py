"""How surfaces of the simulated cell scatter light, apart from any renderer's types."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True, eq=False)
class Material:
    """A surface finish.

    Attributes:
        colour: sRGB 0-1 base colour; ignored where there is a texture.
        roughness: 0 mirror-like to 1 matt.
        metallic: 0 for plastic, paint and wood; 1 for bare metal.
        coat: strength of a clear varnish, 0 to 1.
        texture: (n, m, 3) uint8 sRGB picture, or None for an even colour.
        repeat: how often the texture repeats along u and v.
    """

    colour: tuple[float, float, float] = (0.8, 0.8, 0.8)
    roughness: float = 0.5
    metallic: float = 0.0
    coat: float = 0.0
    texture: np.ndarray | None = None
    repeat: tuple[float, float] = (1.0, 1.0)


def plastic(colour: tuple[float, float, float], roughness: float = 0.3) -> Material:
    """Moulded or painted plastic with a soft highlight."""
    return Material(colour=colour, roughness=roughness, coat=0.3)


def metal(colour: tuple[float, float, float] = (0.72, 0.72, 0.73), roughness: float = 0.3):
    """Machined or cast metal."""
    return Material(colour=colour, roughness=roughness, metallic=1.0)


def textured(
    texture: np.ndarray,
    *,
    roughness: float = 0.7,
    coat: float = 0.0,
    repeat: tuple[float, float] = (1.0, 1.0),
) -> Material:
    """A surface that carries a picture."""
    return Material(roughness=roughness, coat=coat, texture=texture, repeat=repeat)


def shaded(material: Material, factor: float) -> Material:
    """The same finish, its even colour brighter or darker by ``factor``."""
    r, g, b = (float(np.clip(c * factor, 0.0, 1.0)) for c in material.colour)
    return replace(material, colour=(r, g, b))


def random_colour(
    rng: np.random.Generator, *, saturation: float = 0.6, value: tuple[float, float] = (0.2, 0.9)
) -> tuple[float, float, float]:
    """A colour of random hue, sRGB 0-1.

    Args:
        rng: source of randomness.
        saturation: largest saturation.
        value: range of the brightest channel.
    """
    hue, chroma, top = rng.random(), saturation * rng.random(), rng.uniform(*value)
    r, g, b = (
        float(top * (1 - chroma * np.clip(abs((hue * 6 + k) % 6 - 3) - 1, 0, 1))) for k in (0, 4, 2)
    )
    return r, g, b
