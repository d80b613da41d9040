"""How joints move links in the camera frame."""

from __future__ import annotations

import numpy as np

from easyhecpp.geometry import inverse, perturb_about
from easyhecpp.rig import Rig
from easyhecpp.sim.robots import load_robot
from easyhecpp.solve.joint_twists import joint_twists


def test_twists_move_the_links_as_the_joints_do() -> None:
    rig = Rig(load_robot("xarm7"))
    rng = np.random.default_rng(0)
    joints = rng.uniform(-0.8, 0.8, (3, rig.robot.n_joints))
    T = inverse(rig.Ts_mount_link(rng.uniform(-0.8, 0.8, rig.robot.n_joints))[5])
    T[2, 3] += 1.2
    centre = np.array([0.1, -0.2, 1.0])
    twists = joint_twists(rig, joints, T, centre)
    assert twists.shape == (3, rig.robot.n_joints, len(rig.robot.link_names), 6)
    step = 1e-3
    for joint in range(rig.robot.n_joints):
        moved = joints[1].copy()
        moved[joint] += step
        for link in range(len(rig.robot.link_names)):
            np.testing.assert_allclose(
                perturb_about(
                    T @ rig.Ts_mount_link(joints[1])[link], centre, step * twists[1, joint, link]
                ),
                T @ rig.Ts_mount_link(moved)[link],
                atol=2e-6,
            )
