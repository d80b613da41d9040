"""A small lopsided arm of primitives, and simulated scenes of it, for quick tests."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from easyhecpp.camera import Camera
from easyhecpp.robot import Robot
from easyhecpp.sim.scenes import SimScene, random_scene
from easyhecpp.solve import Observation

# No two sides of it look alike: a symmetric arm could be seen from two places.
URDF = """<?xml version="1.0"?>
<robot name="lopsided">
  <link name="base"><visual><origin xyz="0.04 0.01 0.06"/>
    <geometry><box size="0.26 0.2 0.12"/></geometry></visual></link>
  <link name="shoulder">
    <visual><geometry><cylinder radius="0.06" length="0.22"/></geometry></visual>
    <visual><origin xyz="0 0.09 0.04"/><geometry><box size="0.1 0.08 0.08"/></geometry></visual>
  </link>
  <link name="upper"><visual><origin xyz="0.02 0.05 0.17"/>
    <geometry><box size="0.09 0.06 0.38"/></geometry></visual></link>
  <link name="fore"><visual><origin xyz="0.15 -0.04 0"/>
    <geometry><box size="0.32 0.07 0.05"/></geometry></visual></link>
  <link name="hand">
    <visual><origin xyz="0.02 0.03 0"/><geometry><box size="0.04 0.18 0.06"/></geometry></visual>
    <visual><origin xyz="0.07 0.1 0"/><geometry><box size="0.1 0.03 0.03"/></geometry></visual>
  </link>
  <joint name="yaw" type="revolute"><parent link="base"/><child link="shoulder"/>
    <origin xyz="0 0 0.22"/><axis xyz="0 0 1"/>
    <limit lower="-2.8" upper="2.8" effort="1" velocity="1"/></joint>
  <joint name="pitch" type="revolute"><parent link="shoulder"/><child link="upper"/>
    <origin xyz="0 0 0.08"/><axis xyz="0 1 0"/>
    <limit lower="-1.2" upper="1.2" effort="1" velocity="1"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="fore"/>
    <origin xyz="0 0 0.36"/><axis xyz="0 1 0"/>
    <limit lower="-1.5" upper="1.5" effort="1" velocity="1"/></joint>
  <joint name="wrist" type="revolute"><parent link="fore"/><child link="hand"/>
    <origin xyz="0.31 -0.02 0"/><axis xyz="1 0 0"/>
    <limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
</robot>
"""


def write_urdf(folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "robot.urdf"
    path.write_text(URDF)
    return path


@cache
def small_arm() -> Robot:
    with TemporaryDirectory() as folder:
        return Robot.from_urdf(write_urdf(Path(folder)))


@cache
def scene(
    seed: int, n_views: int = 4, width: int = 480, height: int = 360, **options: object
) -> SimScene:
    """The same scene for the same arguments; the focal length fits the width."""
    return random_scene(
        small_arm(),
        np.random.default_rng([seed, 5]),
        n_views=n_views,
        width=width,
        height=height,
        focal=0.9 * width,
        **options,  # type: ignore[arg-type]
    )


def observe(scene: SimScene, masks: NDArray[np.bool_] | None = None) -> list[Observation]:
    masks = scene.masks if masks is None else masks
    return [
        Observation(q, mask, id=str(i))
        for i, (q, mask) in enumerate(zip(scene.joints, masks, strict=True))
    ]


def shifted(camera: Camera, dx: float, dy: float) -> Camera:
    """The camera of a picture whose origin lies elsewhere."""
    return Camera(camera.width, camera.height, camera.fx, camera.fy, camera.cx + dx, camera.cy + dy)
