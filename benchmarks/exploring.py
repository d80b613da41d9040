"""How long the choice of the next joint pose takes, and how well the fast score ranks."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.stats import spearmanr
from timing import Seconds, measure

from easyhecpp.bench.table import Table
from easyhecpp.explore import (
    EASYHEC,
    ConsistencyConfig,
    ExploreConfig,
    Knowledge,
    choose_next,
    consistency_scores,
    draw_candidates,
    first_joint_poses,
)
from easyhecpp.geometry import inverse
from easyhecpp.render.reference_compiled import reference_coverage_compiled
from easyhecpp.rig import Rig
from easyhecpp.sim.masks import Degradation, degrade_masks
from easyhecpp.sim.robots import load_robot
from easyhecpp.sim.scenes import SimScene, random_scene
from easyhecpp.solve import Observation, solve_pose

F64 = NDArray[np.float64]

RANKED_POSES, RANKED_HYPOTHESES = 60, 10


def run(seed: int, budget_s: float) -> Table:
    """Time the ways of choosing, warm, after two views of a simulated xArm 7."""
    robot = load_robot("xarm7")
    rig, rng = Rig(robot), np.random.default_rng(seed)
    scene = random_scene(robot, rng, n_views=2)
    masks = degrade_masks(list(scene.coverages), rng, Degradation()).masks
    views = [Observation(q, m) for q, m in zip(scene.joints, masks, strict=True)]
    estimate = solve_pose(rig, scene.camera, views, scene.T_base_cam)
    known = Knowledge.of(estimate, scene.joints)

    def informed(_: int) -> object:
        return choose_next(rig, scene.camera, known, ExploreConfig(), rng)

    def scored(config: ConsistencyConfig) -> Seconds:
        joints = draw_candidates(robot, config.joint_poses, rng)
        Ts = known.hypotheses(config.hypotheses, rng)
        return measure(
            lambda _: consistency_scores(rig, scene.camera, Ts, joints, config), budget_s=budget_s
        )

    def blind(_: int) -> object:
        return first_joint_poses(robot, scene.camera, 1, rng)

    paper = ConsistencyConfig()
    return Table(
        title="The next joint pose, xArm 7, 1280x720, warm",
        columns=("way", "joint poses", "hypotheses", "s median", "s 95 %", "s processor", "calls"),
        rows=(
            _row("expected information", 300, 3, measure(informed, budget_s=budget_s)),
            _row("the paper's score", paper.joint_poses, paper.hypotheses, scored(paper)),
            _row("... EasyHeC's counts", EASYHEC.joint_poses, EASYHEC.hypotheses, scored(EASYHEC)),
            _row("a first joint pose", 240, 24, measure(blind, budget_s=budget_s)),
        ),
        notes=(
            f"Rank correlation of the paper's score with that of hard masks of 1280x720 and the "
            f"full mesh: {_correlation(rig, scene, known, rng):.3f} over {RANKED_POSES} joint "
            f"poses and {RANKED_HYPOTHESES} hypotheses.",
        ),
    )


def _correlation(rig: Rig, scene: SimScene, known: Knowledge, rng: np.random.Generator) -> float:
    joints = draw_candidates(rig.robot, RANKED_POSES, rng)
    Ts = known.hypotheses(RANKED_HYPOTHESES, rng)
    full = [_by_pixels(scene, Ts, q) for q in joints]
    return float(spearmanr(full, consistency_scores(rig, scene.camera, Ts, joints))[0])


def _by_pixels(scene: SimScene, Ts_base_cam: F64, joints: F64) -> float:
    """Sum over pixels of the unbiased variance of hard masks."""
    Ts_base_link = scene.robot.link_poses(joints)
    masks = [
        reference_coverage_compiled(scene.robot.meshes, scene.camera, inverse(T) @ Ts_base_link, 3)
        > 0.5
        for T in Ts_base_cam
    ]
    return float(np.var(np.stack(masks), axis=0, ddof=1).sum())


def _row(
    name: str, poses: int, hypotheses: int, s: Seconds
) -> tuple[str, int, int, float, float, float, int]:
    return name, poses, hypotheses, s.median, s.p95, s.cpu, s.calls
