"""A small arm whose camera is known as far as two noisy views tell."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray
from small_arm import scene

from easyhecpp.explore import Knowledge
from easyhecpp.rig import Rig
from easyhecpp.sim.masks import Degradation, degrade_masks
from easyhecpp.sim.scenes import SimScene
from easyhecpp.solve import Observation, PoseEstimate, solve_pose

F64 = NDArray[np.float64]


def estimate(scene: SimScene, views: list[int], seed: int) -> PoseEstimate:
    """The pose from some views of a scene, with masks of IoU 0.982."""
    truths = [scene.coverage(v) for v in views]
    masks = degrade_masks(truths, np.random.default_rng(seed), Degradation(0.982)).masks
    seen = [Observation(scene.joints[v], m) for v, m in zip(views, masks, strict=True)]
    return solve_pose(Rig(scene.robot), scene.camera, seen, scene.T_base_cam)


@cache
def known(seed: int = 3) -> tuple[SimScene, Rig, Knowledge]:
    s = scene(seed)
    return s, Rig(s.robot), Knowledge.of(estimate(s, [0, 1], 0), s.joints[:2])
