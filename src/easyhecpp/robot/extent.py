"""How far a robot's surface can get from its base."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from easyhecpp import geometry as se3

if TYPE_CHECKING:
    from easyhecpp.robot.robot import Robot

_SAMPLES, _DIRECTIONS, _STARTS, _ROUNDS, _STEPS = 256, 64, 4, 3, 17


def sampled_reach(robot: Robot, lower: np.ndarray, upper: np.ndarray) -> float:
    """Largest distance in metres between the base's origin and a surface point.

    Random poses (a fixed seed, so the answer never changes), the best of which are improved one
    joint at a time. What is found is reached for sure; a little more may be possible.
    """
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(_DIRECTIONS, 3))
    # Few points carry the extent of a mesh: the farthest ones along many directions.
    tips = np.stack([m.vertices[np.argmax(m.vertices @ directions.T, 0)] for m in robot.meshes])

    def distances(q: np.ndarray) -> np.ndarray:
        points = se3.transform_points(robot.link_poses(q), tips)
        return np.linalg.norm(points, axis=-1).max(axis=(-2, -1))

    poses = rng.uniform(lower, upper, size=(_SAMPLES, robot.n_joints))
    poses = np.concatenate([poses, [robot.neutral]])
    best = poses[np.argsort(distances(poses))[-_STARTS:]]
    for _ in range(_ROUNDS):
        for joint in range(robot.n_joints):
            trial = np.repeat(best[:, None], _STEPS + 1, axis=1)
            trial[:, :_STEPS, joint] = np.linspace(lower[joint], upper[joint], _STEPS)
            best = trial[np.arange(_STARTS), np.argmax(distances(trial), axis=1)]
    return float(distances(best).max())
