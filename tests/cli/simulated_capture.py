"""A capture of a simulated scene: degraded masks, and pictures in flat grey."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from easyhecpp.capture import Capture, View
from easyhecpp.sim.masks import Degradation, degrade_masks
from easyhecpp.sim.scenes import SimScene

F64 = NDArray[np.float64]

MASK_IOU = 0.982
"""What the paper reports of AutoSAM."""


def simulated_capture(
    scene: SimScene, rng: np.random.Generator, *, name: str = "simulated"
) -> Capture:
    """A capture of a simulated scene: degraded masks, and pictures in flat grey.

    Args:
        scene: Arm, camera, joints and exact masks.
        rng: Draws the errors of the masks.
        name: The capture's name.
    """
    masks = degrade_masks(list(scene.coverages), rng, Degradation(MASK_IOU)).masks
    shade = np.linspace(60.0, 110.0, scene.camera.height)[:, None]
    views = []
    for i, (joints, mask) in enumerate(zip(scene.joints, masks, strict=True)):
        grey = shade + (190.0 - shade) * scene.coverage(i)
        image = np.repeat(grey.astype(np.uint8)[..., None], 3, axis=2)
        views.append(View(f"{i:04d}", joints, image=image, mask=mask))
    return Capture(name, None, "eye-to-hand", scene.robot, scene.camera, tuple(views))
