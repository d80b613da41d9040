"""Joints that do not fit the pictures are found, and said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from small_arm import observe, scene

from easyhecpp.rig import Rig
from easyhecpp.session.outcome import joint_notes
from easyhecpp.solve import PoseEstimate, solve_pose


def estimate(off: float, seed: int) -> PoseEstimate:
    """From exact masks, recorded joints off by so much (standard deviation, rad) in every view."""
    made = scene(seed, n_views=6)
    rng = np.random.default_rng(seed)
    observations = [
        replace(o, joints=o.joints + off * rng.normal(size=o.joints.shape)) for o in observe(made)
    ]
    return solve_pose(Rig(made.robot), made.camera, observations, made.T_base_cam)


@pytest.mark.parametrize("seed", [1, 2])
def test_joint_errors_are_found_and_widen_the_error_bar(seed: int) -> None:
    right, wrong = estimate(0.0, seed), estimate(6e-3, seed)
    assert right.joint_noise < 1e-3
    assert joint_notes(right) == ()
    assert 3e-3 <= wrong.joint_noise <= 1e-2
    (note,) = joint_notes(wrong)
    assert note.startswith("joints: the arm stands about 0.")
    assert "Wait longer after each motion" in note
    assert np.trace(wrong.covariance) > 4.0 * np.trace(right.covariance)


def test_few_views_say_nothing_about_the_joints() -> None:
    found = estimate(6e-3, 1)
    few = replace(found, views=found.views[:3])
    assert joint_notes(few) == ()
