"""Small simulated scenes of a lopsided arm, and starts that are off by a known angle."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from easyhecpp.geometry import inverse, perturb_about, transform_points
from easyhecpp.robot import Robot
from easyhecpp.sim.scenes import SimScene, random_scene
from easyhecpp.solve import Observation

F64 = NDArray[np.float64]

# No two sides of it look alike: a symmetric arm could be seen from two places.
URDF = """<?xml version="1.0"?>
<robot name="crooked">
  <link name="base"><visual><origin xyz="0.03 0 0.05"/>
    <geometry><box size="0.24 0.18 0.1"/></geometry></visual></link>
  <link name="upper">
    <visual><origin xyz="0 0.02 0.2"/><geometry><box size="0.09 0.07 0.44"/></geometry></visual>
    <visual><origin xyz="0 0.1 0.1"/><geometry><box size="0.06 0.1 0.06"/></geometry></visual>
  </link>
  <link name="fore"><visual><origin xyz="0.17 -0.03 0"/>
    <geometry><box size="0.34 0.06 0.05"/></geometry></visual></link>
  <link name="hand">
    <visual><origin xyz="0 0.02 0.03"/><geometry><box size="0.05 0.16 0.06"/></geometry></visual>
  </link>
  <link name="tool"/>
  <joint name="yaw" type="revolute"><parent link="base"/><child link="upper"/>
    <origin xyz="0 0 0.12"/><axis xyz="0 0 1"/>
    <limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="fore"/>
    <origin xyz="0 0 0.42"/><axis xyz="0 1 0"/>
    <limit lower="-1.5" upper="1.5" effort="1" velocity="1"/></joint>
  <joint name="wrist" type="revolute"><parent link="fore"/><child link="hand"/>
    <origin xyz="0.35 -0.02 0" rpy="0 1.2 0"/><axis xyz="1 0.3 0.2"/>
    <limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
  <joint name="flange" type="fixed"><parent link="hand"/><child link="tool"/>
    <origin xyz="0 0 0.04"/></joint>
</robot>
"""


@cache
def crooked_arm() -> Robot:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "crooked.urdf"
        path.write_text(URDF)
        return Robot.from_urdf(path)


@cache
def scene(seed: int, *, n_views: int, width: int, height: int) -> SimScene:
    """The same scene for the same arguments; the focal length fits the width."""
    return random_scene(
        crooked_arm(),
        np.random.default_rng([seed, 8]),
        n_views=n_views,
        width=width,
        height=height,
        focal=0.9 * width,
    )


def observe(scene: SimScene) -> list[Observation]:
    return [Observation(q, m) for q, m in zip(scene.joints, scene.masks, strict=True)]


def off_by(scene: SimScene, degrees: float) -> F64:
    """T_base_cam at which the arm is turned about its own middle, on a slanted axis."""
    T_cam_base = inverse(scene.T_base_cam)
    middle = transform_points(T_cam_base, scene.robot.centre(scene.joints).mean(axis=0))
    axis = np.array([0.6, -0.48, 0.64])
    delta = np.concatenate([np.zeros(3), np.deg2rad(degrees) * axis])
    return inverse(perturb_about(T_cam_base, middle, delta))
