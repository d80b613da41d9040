"""The pose optimisation on small simulated scenes with known truth."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray
from small_arm import observe, scene, shifted, small_arm

from easyhecpp.camera import Camera
from easyhecpp.errors import CalibrationError, InputError
from easyhecpp.geometry import exp_se3, inverse, log_se3, pose_error
from easyhecpp.render.reference_compiled import reference_coverage_compiled
from easyhecpp.rig import Rig
from easyhecpp.sim.faults import add_blob, remove_link
from easyhecpp.sim.masks import Degradation, degrade_masks
from easyhecpp.sim.scenes import SimScene
from easyhecpp.solve import Observation, PoseEstimate, SolveConfig, solve_pose
from easyhecpp.solve.descend import Level, descend
from easyhecpp.solve.problem import PoseProblem

F64 = NDArray[np.float64]

OFF = exp_se3([0.03, -0.02, 0.05, 0.03, 0.03, -0.04])
"""A start 6 cm and 3.3 deg beside the truth: some 20 px on these pictures."""

SEEDS = (0, 3, 4)


def solve(view: SimScene, observations: list[Observation], **config: float) -> PoseEstimate:
    settings = SolveConfig(**config)  # type: ignore[arg-type]
    return solve_pose(Rig(view.robot), view.camera, observations, view.T_base_cam @ OFF, settings)


def error(estimate: PoseEstimate, view: SimScene) -> tuple[float, float]:
    """Millimetres and degrees."""
    metres, radians = pose_error(estimate.T_mount_cam, view.T_base_cam)
    return 1e3 * metres, float(np.degrees(radians))


def noisy(view: SimScene, seed: int = 1, iou: float = 0.97, bias_px: float = 0.0):
    truths = list(view.coverages)
    return degrade_masks(
        truths, np.random.default_rng(seed), Degradation(iou, bias_px=bias_px)
    ).masks


# Accuracy


@pytest.mark.parametrize("seed", SEEDS)
def test_exact_masks_give_the_exact_pose(seed: int) -> None:
    view = scene(seed)
    estimate = solve(view, observe(view))
    millimetres, degrees = error(estimate, view)
    assert millimetres < 1.0
    assert degrees < 0.05
    assert estimate.status == "converged"
    assert abs(estimate.dilation_px) < 0.05
    assert all(v.iou > 0.97 and v.rms_px < 0.3 and v.outliers < 0.1 for v in estimate.views)


def test_wandering_masks_give_a_pose_within_its_own_uncertainty() -> None:
    position, chi_squares = [], []
    for seed in SEEDS:
        view = scene(seed)
        estimate = solve(view, observe(view, noisy(view)))
        millimetres, degrees = error(estimate, view)
        assert millimetres < 15.0
        assert degrees < 0.7
        position.append(millimetres)
        delta = log_se3(inverse(estimate.T_mount_cam) @ view.T_base_cam)
        chi_squares.append(delta @ np.linalg.solve(estimate.covariance, delta))
    assert np.median(position) < 6.0
    # 6 degrees of freedom: 95 % lie below 12.6.
    assert np.median(chi_squares) < 14.0


def test_error_bars_hold_the_truth_when_joints_are_off() -> None:
    """Errors of 5 mrad, fresh for every joint in every view."""
    chi_squares = []
    for seed in range(12):
        view = scene(seed)
        errors = 5e-3 * np.random.default_rng(seed).normal(size=view.joints.shape)
        seen = [
            replace(o, joints=o.joints + e)
            for o, e in zip(observe(view, noisy(view)), errors, strict=True)
        ]
        estimate = solve(view, seen)
        delta = log_se3(inverse(estimate.T_mount_cam) @ view.T_base_cam)
        chi_squares.append(delta @ np.linalg.solve(estimate.covariance, delta))
    # 5.35 is the median of chi-square with six degrees of freedom, 12.6 its 95th percentile.
    assert np.median(chi_squares) < 6.5
    assert np.mean(np.array(chi_squares) < 12.6) > 0.8


def test_bent_lens() -> None:
    view = scene(0)
    lens = replace(
        view.camera, distortion_model="plumb_bob", distortion=(-0.25, 0.08, 0.002, -0.001, 0.0)
    )
    bent = SimScene(view.robot, lens, view.T_base_cam, view.joints)
    millimetres, degrees = error(solve(bent, observe(bent)), bent)
    assert millimetres < 1.2
    assert degrees < 0.06


def test_one_view_is_enough_when_its_mask_is_exact() -> None:
    view = scene(3)
    estimate = solve(view, observe(view)[:1])
    millimetres, degrees = error(estimate, view)
    assert millimetres < 2.5
    assert degrees < 0.1
    more = solve(view, observe(view))
    assert np.trace(estimate.covariance) > np.trace(more.covariance)


# Conventions


def test_integer_coordinates_are_pixel_centres() -> None:
    """Masks of a camera that counts from the image's edge: the pose is off by half a pixel."""
    view = scene(3)
    estimate = solve(view, observe(view))
    half = SimScene(view.robot, shifted(view.camera, 0.5, 0.5), view.T_base_cam, view.joints)
    assert error(estimate, view)[0] < 1.0
    other = solve_pose(
        Rig(view.robot), half.camera, observe(view), view.T_base_cam @ OFF, SolveConfig()
    )
    # Half a pixel of 432 px focal length turns the camera by 0.5 / 432 rad both ways.
    metres, radians = pose_error(other.T_mount_cam, view.T_base_cam)
    moved = metres / np.linalg.norm(view.T_base_cam[:3, 3]) + radians
    assert moved > 0.8 * np.hypot(0.5, 0.5) / view.camera.fx


def test_contours_and_information_belong_to_the_returned_pose() -> None:
    view = scene(0)
    estimate = solve(view, observe(view, noisy(view)))
    assert len(estimate.contours) == len(estimate.views) == len(view)
    for i, contour in enumerate(estimate.contours):
        n = len(contour.points)
        assert n == len(contour.residuals) == len(contour.weights) == len(contour.jacobians)
        covered = reference_coverage_compiled(
            view.robot.meshes, view.camera,
            inverse(estimate.T_mount_cam) @ view.robot.link_poses(view.joints[i]), 3,
        )  # fmt: skip
        x, y = np.rint(contour.points + 2.0 * contour.normals).astype(int).T
        assert np.mean(covered[y, x] < 0.5) > 0.95
    total = estimate.information.sum(axis=0)
    assert np.linalg.eigvalsh(total).min() > 0.0
    assert np.linalg.eigvalsh(estimate.covariance).min() > 0.0
    np.testing.assert_allclose(estimate.covariance, estimate.covariance.T, rtol=1e-6)


# Systematic errors of masks


@pytest.mark.parametrize("bias", [-0.8, 0.8])
def test_dilation_is_recovered(bias: float) -> None:
    view = scene(3)
    exact = [
        degrade_masks([c], np.random.default_rng(0), Degradation(1.0, bias_px=bias)).masks[0]
        for c in view.coverages
    ]
    estimate = solve(view, observe(view, np.stack(exact)))
    assert estimate.dilation_px == pytest.approx(bias, abs=0.25)
    assert error(estimate, view)[0] < 4.0


@pytest.mark.parametrize("fault", ["missing link", "blob", "hole", "empty", "full"])
def test_one_wrong_mask_of_four_does_little_harm(fault: str) -> None:
    """Against the same solve without the view whose mask is wrong."""
    view = scene(4)
    masks = np.stack(noisy(view))
    rng = np.random.default_rng(3)
    good = error(solve(view, observe(view, masks)[1:]), view)
    if fault == "missing link":
        masks[0] = remove_link(masks[0], view.visible_links(0), view.robot.link_names.index("fore"))
    elif fault == "blob":
        masks[0] = add_blob(masks[0], rng, 0.2)
    elif fault == "hole":
        rows = np.nonzero(masks[0])[0]
        masks[0, int(rows.mean()) - 15 : int(rows.mean()) + 15, :] = False
    else:
        masks[0] = fault == "full"
    estimate = solve(view, observe(view, masks))
    bad = error(estimate, view)
    assert np.isfinite(estimate.T_mount_cam).all()
    assert np.isfinite(estimate.covariance).all()
    assert bad[0] < 1.5 * good[0] + 3.0
    assert bad[1] < 1.5 * good[1] + 0.2
    # It shows in what is said of the view.
    assert estimate.views[0].iou < min(v.iou for v in estimate.views[1:])


def test_regions_to_ignore_are_ignored() -> None:
    """A tool that no model knows, in every view; told to look away, the solver is exact again."""
    view = scene(3)
    masks = view.masks.copy()
    ignored = np.zeros_like(masks)
    for mask, ignore, links in zip(
        masks, ignored, (view.visible_links(i) for i in range(len(view))), strict=True
    ):
        rows, columns = np.nonzero(links == view.robot.link_names.index("hand"))
        if len(rows):
            block = np.s_[
                max(rows.min() - 12, 0) : rows.max() + 12,
                max(columns.min() - 12, 0) : columns.max() + 12,
            ]
            mask[block] = ignore[block] = True
    observations = [
        replace(o, ignore=ignore) for o, ignore in zip(observe(view, masks), ignored, strict=True)
    ]
    told = error(solve(view, observations), view)
    untold = error(solve(view, observe(view, masks)), view)
    assert told[0] < 1.0
    assert told[0] < untold[0]


def test_a_view_of_weight_zero_has_no_say() -> None:
    view = scene(0)
    wrong = np.stack([np.roll(view.masks[0], 9, axis=1), *view.masks[1:]])
    without = solve(view, observe(view)[1:])
    observations = observe(view, wrong)
    observations[0] = replace(observations[0], weight=0.0)
    silent = solve(view, observations)
    metres, radians = pose_error(silent.T_mount_cam, without.T_mount_cam)
    assert metres < 1e-9
    assert radians < 1e-9
    heard = solve(view, observe(view, wrong))
    moved, turned = pose_error(heard.T_mount_cam, silent.T_mount_cam)
    assert moved > 1e-4
    assert turned > 1e-4
    assert silent.views[0].weight == 0.0
    assert not silent.information[0].any()


def test_more_weight_pulls_more() -> None:
    view = scene(0)
    masks = np.stack([np.roll(view.masks[0], 2, axis=1), *view.masks[1:]])
    apart = {}
    for weight in (0.05, 20.0):
        observations = observe(view, masks)
        observations[0] = replace(observations[0], weight=weight)
        apart[weight] = error(solve(view, observations), view)[0]
    assert apart[0.05] < apart[20.0]


# Robustness


def test_no_level_ends_worse_than_it_was() -> None:
    view = scene(0)
    problem = PoseProblem(Rig(view.robot), view.camera, observe(view))
    T = inverse(view.T_base_cam)
    level = Level(4, scale_px=20.0)
    at_truth = descend(problem, T, level, 0)
    np.testing.assert_array_equal(at_truth.T_cam_mount, T)
    losses = [descend(problem, inverse(OFF) @ T, level, n).loss for n in range(6)]
    # Up to the slack that robust weights need.
    assert all(later <= 1.011 * earlier for earlier, later in pairwise(losses))
    assert losses[-1] < 0.3 * losses[0]
    end = descend(problem, inverse(OFF) @ T, level, 6)
    seen = problem.gather(end.T_cam_mount, 4, smoothing_px=1.5, spacing=1.0)
    assert sum(e.mismatch for e in seen) == pytest.approx(end.loss, rel=1e-6)


def test_the_step_limit_is_said() -> None:
    view = scene(0)
    estimate = solve(view, observe(view), max_iterations=1)
    assert estimate.status == "stopped"
    assert "limit" in estimate.message


def test_same_input_same_output() -> None:
    view = scene(4)
    one = solve(view, observe(view, noisy(view)))
    other = solve(view, observe(view, noisy(view)))
    np.testing.assert_array_equal(one.T_mount_cam, other.T_mount_cam)
    np.testing.assert_array_equal(one.covariance, other.covariance)


@pytest.mark.parametrize("scale", [0.0, 1e-9, 0.3, 1.0])
def test_never_not_a_number(scale: float) -> None:
    """Masks that have nothing to do with the arm: an error or a finite pose."""
    view = scene(0)
    rng = np.random.default_rng(7)
    masks = rng.random(view.masks.shape) < scale
    try:
        estimate = solve(view, observe(view, masks))
    except CalibrationError:
        return
    assert np.isfinite(estimate.T_mount_cam).all()
    assert np.isfinite(estimate.covariance).all()
    assert all(np.isfinite(v.rms_px) and np.isfinite(v.iou) for v in estimate.views)


def test_soft_masks_do_no_worse() -> None:
    view = scene(3)
    soft = solve(view, observe(view, view.coverages))  # type: ignore[arg-type]
    assert error(soft, view)[0] < 1.0


def test_fine_starts_skip_the_coarse_level() -> None:
    view = scene(0)
    near = view.T_base_cam @ exp_se3([0.003, 0, 0.004, 0.002, 0, 0.002])
    estimate = solve_pose(
        Rig(view.robot), view.camera, observe(view), near, SolveConfig(start_error_px=5.0)
    )
    assert error(estimate, view)[0] < 1.0


# Bad input


def test_no_views() -> None:
    with pytest.raises(InputError, match="no view to solve for"):
        solve_pose(Rig(small_arm()), scene(0).camera, [], np.eye(4))


def test_masks_of_another_size() -> None:
    view = scene(0)
    camera = Camera(640, 360, 500.0, 500.0, 319.5, 179.5)
    with pytest.raises(InputError, match=r"480x360 pixels, the camera 640x360 \(view 0\)"):
        solve_pose(Rig(view.robot), camera, observe(view), view.T_base_cam)


def test_regions_to_ignore_of_another_size() -> None:
    view = scene(0)
    observations = [replace(o, ignore=np.ones((20, 20), bool)) for o in observe(view)]
    with pytest.raises(InputError, match="ignore"):
        solve(view, observations)


def test_masks_that_are_not_in_the_range() -> None:
    view = scene(0)
    masks = view.masks.astype(np.uint8) * 255
    with pytest.raises(InputError, match=r"0 to 1|\[0, 1\]"):
        solve(view, observe(view, masks))  # type: ignore[arg-type]


@pytest.mark.parametrize("where", ["behind", "beside", "nan"])
def test_a_start_from_which_no_arm_is_seen(where: str) -> None:
    view = scene(0)
    T = view.T_base_cam.copy()
    if where == "behind":
        T = T @ exp_se3([0, 0, 0, 0, np.pi, 0])
    elif where == "beside":
        T = T @ exp_se3([0, 0, 0, 0, 1.2, 0])
    else:
        T[0, 3] = np.nan
    with pytest.raises((CalibrationError, InputError)):
        solve_pose(Rig(view.robot), view.camera, observe(view), T)
