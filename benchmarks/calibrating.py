"""How long first pose and optimisation take, on five simulated views of the xArm 7."""

from __future__ import annotations

import numpy as np
from timing import Seconds, measure

from easyhecpp.bench.table import Table
from easyhecpp.initialise import sample_initial_pose
from easyhecpp.rig import Rig
from easyhecpp.sim.masks import Degradation, degrade_masks
from easyhecpp.sim.robots import load_robot
from easyhecpp.sim.scenes import random_scene
from easyhecpp.solve import Observation, solve_pose

SCENES = 4


def run(seed: int, budget_s: float) -> Table:
    """Time both stages, warm, over several scenes with masks of IoU 0.982."""
    robot = load_robot("xarm7")
    rig = Rig(robot)
    scenes, views = [], []
    for number in range(SCENES):
        rng = np.random.default_rng([seed, number])
        scene = random_scene(robot, rng, n_views=5)
        masks = degrade_masks(list(scene.coverages), rng, Degradation()).masks
        scenes.append(scene)
        views.append([Observation(q, m) for q, m in zip(scene.joints, masks, strict=True)])

    def first(i: int) -> object:
        scene = scenes[i % SCENES]
        return sample_initial_pose(rig, scene.camera, views[i % SCENES])

    starts = [
        sample_initial_pose(rig, s.camera, v).T_mount_cam
        for s, v in zip(scenes, views, strict=True)
    ]

    def solve(i: int) -> object:
        i %= SCENES
        return solve_pose(rig, scenes[i].camera, views[i], starts[i])

    return Table(
        title="Five views of 1280x720, xArm 7, warm",
        columns=("stage", "faces", "s median", "s 95 %", "s processor", "calls"),
        rows=(
            _row("first pose, no initial guess", robot.n_faces, measure(first, budget_s=budget_s)),
            _row("pose and covariance", robot.n_faces, measure(solve, budget_s=budget_s)),
        ),
        notes=("Masks of IoU 0.982, on all cores; the meshes' simplification is cached.",),
    )


def _row(name: str, faces: int, s: Seconds) -> tuple[str, int, float, float, float, int]:
    return name, faces, s.median, s.p95, s.cpu, s.calls
