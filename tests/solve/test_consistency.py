"""Views that do not belong are found and named; what is left gives the right pose."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from easyhecpp.bench.metrics import PoseError, chi_square
from easyhecpp.bench.trust_scenes import build_case
from easyhecpp.geometry import exp_se3, inverse
from easyhecpp.render import SilhouetteRenderer
from easyhecpp.session.verdict import judge
from easyhecpp.solve.consistency import Findings, retested, solve_consistent
from easyhecpp.solve.joint_twists import by_joints, joint_twists
from easyhecpp.solve.problem import PoseProblem
from easyhecpp.solve.reasons import FEW_CONTOUR
from easyhecpp.solve.strains import strains
from easyhecpp.solve.types import PoseEstimate
from easyhecpp.solve.workspace import point_sigma_mm

START = np.array([0.01, -0.01, 0.01, 0.008, -0.006, 0.005])


@pytest.fixture(scope="module")
def good():
    return build_case("five good views", np.random.default_rng([42, 0]), 480)


@pytest.fixture(scope="module")
def good_answer(good) -> tuple[PoseEstimate, Findings]:
    start = good.T_mount_cam @ exp_se3(START)
    return solve_consistent(good.rig, good.camera, good.observations, start)


def test_good_views_are_all_kept_and_the_verdict_is_ok(good, good_answer):
    estimate, findings = good_answer
    assert findings.inconsistent == ()
    assert not findings.searched
    assert judge(estimate, findings, good.rig, good.camera).verdict == "ok"
    assert PoseError.between(estimate.T_mount_cam, good.T_mount_cam).position_mm < 10.0
    assert chi_square(estimate.T_mount_cam, estimate.covariance, good.T_mount_cam) < 25.0


def test_every_view_is_predicted_by_the_others(good_answer):
    for view in good_answer[0].views:
        assert view.prediction_px is not None
        assert view.rms_px * 0.9 < view.prediction_px < view.rms_px + 1.0


def test_a_wrong_row_is_named_and_left_out(good):
    views = list(good.observations)
    views[2] = replace(views[2], joints=good.observations[0].joints)
    start = good.T_mount_cam @ exp_se3(START)
    estimate, findings = solve_consistent(good.rig, good.camera, views, start)
    assert findings.inconsistent == ("2",)
    assert "View 2" in findings.views[2].sentence
    assert estimate.views[2].weight == 0.0
    assert estimate.views[2].flags == findings.views[2].flags != ()
    assert PoseError.between(estimate.T_mount_cam, good.T_mount_cam).position_mm < 10.0


def test_a_joint_that_moved_is_told_from_a_wrong_mask(good):
    moved, masked = list(good.observations), list(good.observations)
    moved[1] = replace(moved[1], joints=moved[1].joints + 0.06)
    mask = masked[1].mask.copy()
    mask[:40, :200] = True
    masked[1] = replace(masked[1], mask=mask)
    start = good.T_mount_cam @ exp_se3(START)
    flags = [
        solve_consistent(good.rig, good.camera, views, start)[1].views[1].flags
        for views in (moved, masked)
    ]
    assert flags == [("moving",), ("mask",)]


def test_the_two_still_views_are_found_among_lagging_ones():
    case = build_case("lagging", np.random.default_rng([42, 1]), 320)
    assert case.start_near is not None
    start = case.T_mount_cam @ exp_se3(case.start_near)
    estimate, findings = solve_consistent(case.rig, case.camera, case.observations, start)
    assert findings.searched
    assert judge(estimate, findings, case.rig, case.camera).verdict != "ok"
    assert chi_square(estimate.T_mount_cam, estimate.covariance, case.T_mount_cam) < 25.0


def test_one_view_alone_is_never_ok(good):
    start = good.T_mount_cam @ exp_se3(START)
    estimate, findings = solve_consistent(good.rig, good.camera, good.observations[:1], start)
    verdict = judge(estimate, findings, good.rig, good.camera)
    assert verdict.verdict != "ok"
    assert any("single view" in reason for reason in verdict.reasons)


@pytest.mark.parametrize(("n_hardly", "verdict"), [(2, "ok"), (4, "doubtful")])
def test_views_that_hardly_show_the_arm_do_not_fail_a_pose(good, good_answer, n_hardly, verdict):
    """Where the arm is out of the picture, its empty masks overlap with nothing."""
    estimate, findings = good_answer
    estimate = replace(
        estimate,
        views=tuple(
            replace(v, iou=0.0, outliers=1.0) if i < n_hardly else v
            for i, v in enumerate(estimate.views)
        ),
    )
    findings = replace(
        findings,
        views=tuple(
            replace(f, flags=(FEW_CONTOUR,)) if i < n_hardly else f
            for i, f in enumerate(findings.views)
        ),
    )
    found = judge(estimate, findings, good.rig, good.camera)
    assert found.verdict == verdict
    assert any("single view" in reason for reason in found.reasons) == (verdict == "doubtful")


def test_displacements_by_joints_agree_with_finite_differences_of_the_projection(good):
    joints = good.observations[0].joints
    T_cam_mount = inverse(good.T_mount_cam)
    renderer = SilhouetteRenderer(good.rig.robot.meshes, good.camera)
    Ts = T_cam_mount @ good.rig.Ts_mount_link(joints)
    centre = np.array([0.0, 0.0, 1.0])
    contour, _ = renderer.contour(Ts, centre, spacing=20.0)
    twists = joint_twists(good.rig, joints, T_cam_mount, centre)
    J = by_joints(contour.jacobians, contour.links, twists)
    step = 1e-4
    for k in range(len(joints)):
        there = joints.copy()
        there[k] += step
        moved = T_cam_mount @ good.rig.Ts_mount_link(there)
        for i in range(0, len(contour), 7):
            link = contour.links[i]
            point = moved[link] @ inverse(Ts[link]) @ np.append(contour.points_cam[i], 1.0)
            shift = good.camera.project(point[:3]) - contour.points[i]
            assert J[i, k] * step == pytest.approx(
                contour.normals[i] @ shift, abs=2e-3 * 480 * step
            )


def test_wrong_focal_length_strains_the_residuals(good, good_answer):
    right = strains(
        PoseProblem(good.rig, good.camera, good.observations),
        inverse(good_answer[0].T_mount_cam),
    ).parameters
    assert abs(right[0].z) < 3.7
    wrong = replace(good.camera, fx=1.05 * good.camera.fx, fy=1.05 * good.camera.fy)
    estimate, findings = solve_consistent(
        good.rig, wrong, good.observations, good.T_mount_cam @ exp_se3(START)
    )
    verdict = judge(estimate, findings, good.rig, wrong)
    assert verdict.verdict != "ok"
    assert any("intrinsics" in reason for reason in verdict.reasons)


def test_a_better_camera_takes_the_strain_away_and_leaves_the_views_as_they_were(good, good_answer):
    estimate, findings = good_answer
    wrong = replace(good.camera, fx=good.camera.fx * 1.05, fy=good.camera.fy * 1.05)
    start = good.T_mount_cam @ exp_se3(START)
    _, strained = solve_consistent(good.rig, wrong, good.observations, start)
    assert abs(strained.strains[0].z) > 3.0
    T = estimate.T_mount_cam
    mended = retested(strained, good.rig, good.camera, good.observations, T)
    assert mended.views == strained.views
    assert mended.strains == findings.strains


def test_views_left_out_are_not_tested(good, good_answer):
    estimate, findings = good_answer
    without = replace(findings.views[1], consistent=False)
    fewer = replace(findings, views=(findings.views[0], without, *findings.views[2:]))
    T = estimate.T_mount_cam
    found = retested(fewer, good.rig, good.camera, good.observations, T)
    rest = [o for i, o in enumerate(good.observations) if i != 1]
    expected = strains(PoseProblem(good.rig, good.camera, rest), inverse(T))
    assert found.strains == expected.parameters


def test_point_sigma_agrees_with_sampling():
    rng = np.random.default_rng(0)
    root = rng.normal(0.0, 1e-3, (6, 6))
    covariance = root @ root.T
    point = np.array([0.1, -0.2, 1.1])
    draws = rng.multivariate_normal(np.zeros(6), covariance, 20000)
    moved = (exp_se3(draws) @ np.append(point, 1.0))[:, :3] - point
    expected = 1e3 * np.sqrt(np.sum(np.var(moved, axis=0)))
    assert point_sigma_mm(covariance, point) == pytest.approx(expected, rel=0.03)
