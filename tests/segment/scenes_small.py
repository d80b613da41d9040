"""Pictures of the small arm with the truth, made once per test run."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from composites import Look, photograph
from numpy.typing import NDArray
from small_arm import scene, small_arm

from easyhecpp.camera import Camera
from easyhecpp.rig import Rig

F64 = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Photographed:
    rig: Rig
    camera: Camera
    T_mount_cam: F64
    joints: list[F64]
    images: list[NDArray[np.uint8]]
    masks: list[NDArray[np.bool_]]


@cache
def photographed(
    seed: int,
    n_views: int = 5,
    width: int = 480,
    height: int = 360,
    exposures: tuple[float, ...] = (1.0,),
    lens: tuple[float, ...] = (),
) -> Photographed:
    truth = scene(seed, n_views=n_views, width=width, height=height)
    rig = Rig(small_arm())
    camera = truth.camera
    if lens:
        camera = replace(camera, distortion_model="plumb_bob", distortion=lens)
    images, masks = photograph(
        rig, camera, truth.T_base_cam, list(truth.joints), np.random.default_rng(seed),
        Look(exposures=exposures),
    )  # fmt: skip
    return Photographed(rig, camera, truth.T_base_cam, list(truth.joints), images, masks)
