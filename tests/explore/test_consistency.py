"""The paper's score against masks rendered pixel by pixel."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import spearmanr
from small_arm import scene

from easyhecpp.errors import InputError
from easyhecpp.explore import EASYHEC, ConsistencyConfig, consistency_scores, draw_candidates
from easyhecpp.geometry import exp_se3, inverse
from easyhecpp.render.reference_compiled import reference_coverage_compiled
from easyhecpp.rig import Rig
from easyhecpp.sim.scenes import SimScene

F64 = NDArray[np.float64]


def hypotheses(s: SimScene, count: int) -> F64:
    sigma = np.array([4e-3] * 3 + [3e-3] * 3)
    drawn = np.random.default_rng(0).normal(size=(count, 6)) * sigma
    return s.T_base_cam @ exp_se3(drawn)


def by_pixels(s: SimScene, Ts: F64, q: F64) -> float:
    """Sum over pixels of the unbiased variance of full-size hard masks."""
    masks = [
        reference_coverage_compiled(s.robot.meshes, s.camera, inverse(T) @ s.robot.link_poses(q), 3)
        > 0.5
        for T in Ts
    ]
    return float(np.var(np.stack(masks), axis=0, ddof=1).sum())


def test_it_is_the_sum_over_pixels_and_ranks_alike() -> None:
    s = scene(3)
    Ts = hypotheses(s, 8)
    joints = draw_candidates(s.robot, 30, np.random.default_rng(1))
    full = np.array([by_pixels(s, Ts, q) for q in joints])
    fast = consistency_scores(Rig(s.robot), s.camera, Ts, joints)
    assert spearmanr(full, fast)[0] >= 0.95
    assert np.median(fast / full) == pytest.approx(1.0, abs=0.03)


def test_hypotheses_that_agree_score_nothing() -> None:
    s = scene(3)
    Ts = np.repeat(s.T_base_cam[None], 5, axis=0)
    assert np.all(consistency_scores(Rig(s.robot), s.camera, Ts, s.joints) == 0.0)


def test_an_arm_out_of_view_scores_nothing() -> None:
    s = scene(3)
    Ts = hypotheses(s, 4) @ np.diag([-1.0, 1.0, -1.0, 1.0])
    assert np.all(consistency_scores(Rig(s.robot), s.camera, Ts, s.joints) == 0.0)


def test_two_hypotheses_score_half_of_where_they_differ() -> None:
    s = scene(3)
    Ts = hypotheses(s, 2)
    fine = ConsistencyConfig(lines=4 * s.camera.height, simplified=1e-4)
    score = consistency_scores(Rig(s.robot), s.camera, Ts, s.joints[:1], fine)[0]
    a, b = (
        reference_coverage_compiled(
            s.robot.meshes, s.camera, inverse(T) @ s.robot.link_poses(s.joints[0]), 5
        )
        > 0.5
        for T in Ts
    )
    assert score == pytest.approx(0.5 * np.count_nonzero(a ^ b), rel=0.03)


def test_easyhecs_counts_can_be_had() -> None:
    assert (EASYHEC.joint_poses, EASYHEC.hypotheses) == (1000, 10)
    assert (ConsistencyConfig().joint_poses, ConsistencyConfig().hypotheses) == (2000, 50)


def test_one_hypothesis_has_no_variance() -> None:
    s = scene(3)
    with pytest.raises(InputError, match="at least two hypotheses"):
        consistency_scores(Rig(s.robot), s.camera, s.T_base_cam[None], s.joints)
    with pytest.raises(InputError, match="1 hypotheses"):
        ConsistencyConfig(hypotheses=1)
