"""Pictures of an arm over a textured wall, drawn with exact coverage and mixed in linear light."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from easyhecpp.camera import Camera
from easyhecpp.geometry import inverse
from easyhecpp.render import SilhouetteRenderer
from easyhecpp.rig import Rig

F64 = NDArray[np.float64]


@dataclass(frozen=True)
class Look:
    """How the pictures look; colours are linear light 0..1."""

    arm: tuple[float, float, float] = (0.65, 0.65, 0.62)
    wall: tuple[float, float, float] = (0.22, 0.25, 0.28)
    texture: float = 0.5
    rim: float = 0.3
    noise: float = 1.5
    blur_px: float = 0.6
    exposures: Sequence[float] = (1.0,)


def wall(camera: Camera, look: Look, rng: np.random.Generator) -> F64:
    """A wall with patches of many sizes, ``(H, W, 3)`` linear light."""
    shape = (camera.height, camera.width)
    pattern = np.zeros((*shape, 3))
    for cells in (4, 9, 23, 60):
        small = rng.normal(size=(cells * shape[0] // shape[1] + 2, cells + 2, 3))
        pattern += cv2.resize(small, shape[::-1], interpolation=cv2.INTER_NEAREST) / 2.0
    return np.clip(np.array(look.wall) * np.exp(look.texture * pattern), 0.0, 1.0)


def photograph(
    rig: Rig,
    camera: Camera,
    T_mount_cam: F64,
    joints: Sequence[F64],
    rng: np.random.Generator,
    look: Look | None = None,
    add: Callable[[F64, int], None] | None = None,
) -> tuple[list[NDArray[np.uint8]], list[NDArray[np.bool_]]]:
    """Pictures and exact masks of all views; ``add`` may draw more into the linear picture."""
    look = look or Look()
    renderer = SilhouetteRenderer(rig.robot.meshes, camera)
    behind = wall(camera, look, rng)
    albedo = np.array(look.arm) * rng.uniform(0.75, 1.1, (len(rig.robot.link_names), 1))
    images, masks = [], []
    for view, q in enumerate(joints):
        Ts = inverse(T_mount_cam) @ rig.Ts_mount_link(q)
        alpha = renderer.coverage(Ts).astype(np.float64)
        links = renderer.visible_links(Ts)
        known = (links >= 0).astype(np.uint8)
        paint = albedo[np.maximum(links, 0)]
        paint = np.where(known[..., None] > 0, paint, np.array(look.arm))
        depth = cv2.distanceTransform(known, cv2.DIST_L2, 5)
        paint = paint * (1.0 - look.rim * np.exp(-depth / 6.0))[..., None]
        scene = behind.copy()
        if add is not None:
            add(scene, view)
        light = (1.0 - alpha[..., None]) * scene + alpha[..., None] * paint
        light = cv2.GaussianBlur(light, (0, 0), look.blur_px)
        light = light * look.exposures[view % len(look.exposures)]
        value = 255.0 * encode(np.clip(light, 0.0, 1.0)) + rng.normal(0, look.noise, light.shape)
        images.append(np.clip(np.round(value), 0, 255).astype(np.uint8))
        masks.append(alpha > 0.5)
    return images, masks


def encode(light: F64) -> F64:
    """Linear light to sRGB."""
    return np.where(
        light <= 0.0031308, 12.92 * light, 1.055 * np.maximum(light, 1e-9) ** (1 / 2.4) - 0.055
    )
