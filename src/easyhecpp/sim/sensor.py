"""From light to numbers: exposure, white balance, blur, noise, tone curve, eight bits."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

F32 = NDArray[np.float32]

_KNEE = 0.72


@dataclass(frozen=True)
class Sensor:
    """A colour camera's electronics.

    Attributes:
        exposure: factor on the metered exposure.
        balance: (r, g, b) gains of a white balance that is a little off.
        blur_px: standard deviation of the lens's blur.
        full_well: electrons at white; fewer make more shot noise.
        read_noise: standard deviation in the dark, share of white.
        flicker: standard deviation of the log exposure from view to view.
    """

    exposure: float = 1.0
    balance: tuple[float, float, float] = (1.0, 1.0, 1.0)
    blur_px: float = 0.35
    full_well: float = 6000.0
    read_noise: float = 0.002
    flicker: float = 0.0

    def develop(self, light: F32, gain: float, rng: np.random.Generator) -> NDArray[np.uint8]:
        """Turn radiance into a picture.

        Args:
            light: (H, W, 3) float32 linear radiance.
            gain: metered exposure: radiance times gain is 1 at white.
            rng: source of noise.

        Returns:
            (H, W, 3) uint8 sRGB.
        """
        flicker = float(np.exp(self.flicker * rng.standard_normal()))
        level = light * np.asarray(self.balance, np.float32) * (gain * self.exposure * flicker)
        if self.blur_px > 0:
            level = cv2.GaussianBlur(level, (0, 0), self.blur_px)
        grain = rng.standard_normal(level.shape, dtype=np.float32)
        level += grain * np.sqrt(np.maximum(level, 0.0) / self.full_well + self.read_noise**2)
        return to_srgb(level)


def to_srgb(level: F32) -> NDArray[np.uint8]:
    """Linear (1 is white) to 8-bit sRGB; highlights roll off smoothly above 72 %."""
    over = np.maximum(level - _KNEE, 0.0) / (1.0 - _KNEE)
    level = np.where(level > _KNEE, _KNEE + (1.0 - _KNEE) * (1.0 - np.exp(-over)), level)
    level = np.clip(level, 0.0, 1.0)
    curve = np.where(level <= 0.0031308, 12.92 * level, 1.055 * level ** (1 / 2.4) - 0.055)
    return np.round(255.0 * curve).astype(np.uint8)


def metered_gain(light: F32, on_arm: NDArray[np.bool_]) -> float:
    """Exposure at which neither the arm nor the room is blown out.

    Args:
        light: (H, W, 3) linear radiance of a small picture.
        on_arm: (H, W) where the arm is.
    """
    brightest = light.max(axis=-1)
    arm = brightest[on_arm] if on_arm.any() else brightest
    gains = (0.70 / np.percentile(arm, 93), 0.80 / np.percentile(brightest, 90))
    return float(min(gains))


def random_sensor(rng: np.random.Generator, *, noise: float, flicker: float) -> Sensor:
    """A camera of ordinary quality.

    Args:
        rng: source of randomness.
        noise: 0 for none, 1 for an indoor webcam.
        flicker: standard deviation of the log exposure from view to view.
    """
    red, blue = rng.normal(1.0, 0.04, 2)
    return Sensor(
        exposure=float(np.exp(rng.normal(-0.05, 0.15))),
        balance=(float(red), 1.0, float(blue)),
        blur_px=float(rng.uniform(0.3, 0.6)),
        full_well=float(rng.uniform(2500, 9000) / max(noise, 1e-3) ** 2),
        read_noise=float(rng.uniform(0.001, 0.004) * noise),
        flicker=flicker,
    )
