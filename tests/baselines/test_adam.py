"""Eq. 1, its gradient, and Adam on it."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest
from baseline_scenes import observe, off_by, scene

from easyhecpp.baselines.adam import AdamConfig, calibrate_with_adam
from easyhecpp.baselines.eq1 import eq1_views
from easyhecpp.errors import InputError, MissingExtraError
from easyhecpp.geometry import exp_se3, inverse, log_se3, perturb_about, pose_error
from easyhecpp.render import reference_coverage
from easyhecpp.rig import Rig
from easyhecpp.sim.scenes import SimScene
from easyhecpp.solve import Observation

F64 = np.ndarray

torch = pytest.importorskip("torch", reason="the extra 'models' is not installed")


@pytest.fixture(scope="module")
def small() -> SimScene:
    return scene(1, n_views=3, width=160, height=120)


def loss_by_hand(scene: SimScene, T_cam_base: F64, combine: str = "union") -> float:
    """Eq. 1 in plain numpy, on the readable renderer."""
    losses = []
    for q, mask in zip(scene.joints, scene.masks, strict=True):
        Ts = T_cam_base @ scene.robot.link_poses(q)
        meshes = scene.robot.meshes
        if combine == "union":
            picture = reference_coverage(meshes, scene.camera, Ts, 9)
        else:
            alone = [
                reference_coverage([mesh], scene.camera, T[None], 9)
                for mesh, T in zip(meshes, Ts, strict=True)
            ]
            picture = np.minimum(1.0, np.sum(alone, axis=0))
        losses.append(((picture.astype(np.float64) - mask) ** 2).sum())
    return float(np.mean(losses))


@pytest.mark.parametrize("combine", ["union", "sum"])
def test_first_loss_is_that_of_the_paper(small: SimScene, combine: str) -> None:
    start = off_by(small, 3.0)
    _, history = calibrate_with_adam(
        Rig(small.robot), small.camera, observe(small), start,
        AdamConfig(steps=1, combine=combine),  # type: ignore[arg-type]
    )  # fmt: skip
    by_hand = loss_by_hand(small, inverse(start), combine)
    assert history.losses[0] == pytest.approx(by_hand, rel=0.01)
    np.testing.assert_allclose(history.Ts_mount_cam[0], start, atol=1e-9)


@pytest.mark.parametrize("combine", ["union", "sum"])
def test_gradient_against_finite_differences(small: SimScene, combine: str) -> None:
    from easyhecpp.baselines.torch_eq1 import eq1_loss

    big = scene(1, n_views=2, width=480, height=360)
    views = eq1_views(Rig(big.robot), big.camera, observe(big), combine)  # type: ignore[arg-type]
    start = log_se3(inverse(off_by(big, 3.0)))
    xi = torch.tensor(start, requires_grad=True)
    eq1_loss(xi, views).backward()
    step = 1e-3

    def loss(tangent: F64) -> float:
        return float(np.mean([view(exp_se3(tangent))[0] for view in views]))

    numeric = [(loss(start + step * e) - loss(start - step * e)) / (2.0 * step) for e in np.eye(6)]
    assert xi.grad is not None
    apart = np.linalg.norm(xi.grad.numpy() - numeric) / np.linalg.norm(numeric)
    assert apart < 0.03


def test_derivative_of_one_view_is_by_the_motion_of_the_arm() -> None:
    """numpy alone: `delta` about the camera's own centre."""
    big = scene(1, n_views=1, width=480, height=360)
    (view,) = eq1_views(Rig(big.robot), big.camera, observe(big), "union")
    T, step = inverse(off_by(big, 3.0)), 5e-4
    numeric = []
    for delta in step * np.eye(6):
        plus, minus = (view(perturb_about(T, np.zeros(3), d))[0] for d in (delta, -delta))
        numeric.append((plus - minus) / (2.0 * step))
    apart = np.linalg.norm(view(T)[1] - numeric) / np.linalg.norm(numeric)
    assert apart < 0.05


def test_pixels_to_ignore_do_not_count(small: SimScene) -> None:
    rig, T = Rig(small.robot), inverse(off_by(small, 2.0))
    observation = observe(small)[0]
    left = np.zeros(observation.mask.shape, np.bool_)
    left[:, :80] = True
    halves = [
        replace(observation, ignore=ignore, mask=observation.mask | ignore)
        for ignore in (left, ~left)
    ]
    whole = eq1_views(rig, small.camera, [observation], "union")[0](T)
    parts = [view(T) for view in eq1_views(rig, small.camera, halves, "union")]
    assert sum(loss for loss, _ in parts) == pytest.approx(whole[0], rel=1e-5)
    np.testing.assert_allclose(sum(d for _, d in parts), whole[1], rtol=1e-5)


@pytest.mark.parametrize("seed", [1, 2])
def test_converges_from_three_degrees(seed: int) -> None:
    sim = scene(seed, n_views=4, width=240, height=180)
    start = off_by(sim, 3.0)
    result, history = calibrate_with_adam(
        Rig(sim.robot), sim.camera, observe(sim), start, AdamConfig(steps=250)
    )
    assert (result.status, result.views_used) == ("done", 4)
    assert result.T_mount_cam is not None
    metres, radians = pose_error(result.T_mount_cam, sim.T_base_cam)
    assert np.rad2deg(pose_error(start, sim.T_base_cam)[1]) == pytest.approx(3.0)
    # A pixel is 5 mm of the arm here.
    assert metres < 4e-3
    assert np.rad2deg(radians) < 0.15
    assert history.losses[-1] < 0.2 * history.losses[0]
    assert len(history.Ts_mount_cam) == len(history.seconds) == 251
    assert (np.diff(history.seconds) > 0.0).all()
    np.testing.assert_array_equal(result.T_mount_cam, history.Ts_mount_cam[-1])


def test_first_step_has_the_length_of_the_learning_rate(small: SimScene) -> None:
    """What Adam does: the first step is the rate times the gradient's signs."""
    start = off_by(small, 3.0)
    _, history = calibrate_with_adam(
        Rig(small.robot), small.camera, observe(small), start, AdamConfig(steps=1)
    )
    before, after = (log_se3(inverse(T)) for T in history.Ts_mount_cam)
    np.testing.assert_allclose(np.abs(after - before), 3e-3, rtol=1e-6)


def test_best_iterate_is_the_one_with_the_least_loss(small: SimScene) -> None:
    result, history = calibrate_with_adam(
        Rig(small.robot), small.camera, observe(small), off_by(small, 1.0),
        AdamConfig(steps=40, learning_rate=2e-2, iterate="best"),
    )  # fmt: skip
    best = int(history.losses.argmin())
    assert 0 < best < 39
    np.testing.assert_array_equal(result.T_mount_cam, history.Ts_mount_cam[best])


def test_half_pixel_bias_is_half_a_pixel() -> None:
    """The published projection on masks of a real camera: the same as masks shifted by half."""
    sim = scene(1, n_views=1, width=160, height=120)
    moved = replace(sim.camera, cx=sim.camera.cx - 0.5, cy=sim.camera.cy - 0.5)
    rig, start = Rig(sim.robot), off_by(sim, 1.0)
    histories = [
        calibrate_with_adam(rig, camera, observe(sim), start, config)[1]
        for camera, config in (
            (sim.camera, AdamConfig(steps=3, half_pixel_bias=True)),
            (moved, AdamConfig(steps=3)),
        )
    ]
    np.testing.assert_array_equal(histories[0].losses, histories[1].losses)
    assert AdamConfig().half_pixel_bias is False


def test_bad_input(small: SimScene) -> None:
    rig = Rig(small.robot)
    with pytest.raises(InputError, match="no view"):
        calibrate_with_adam(rig, small.camera, [], small.T_base_cam)
    wrong = Observation(small.joints[0], np.zeros((10, 12), np.bool_), id="0007")
    with pytest.raises(InputError, match=r"view 0007 has the shape \(10, 12\).*\(120, 160\)"):
        calibrate_with_adam(rig, small.camera, [wrong], small.T_base_cam)
    with pytest.raises(InputError, match="0 steps"):
        AdamConfig(steps=0)
    with pytest.raises(InputError, match="last or best"):
        AdamConfig(iterate="first")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="union or sum"):
        eq1_views(rig, small.camera, observe(small), "mean")  # type: ignore[arg-type]


def test_says_which_extra_is_missing(small: SimScene, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(MissingExtraError, match=r'pip install "easyhecpp\[models\]"'):
        calibrate_with_adam(Rig(small.robot), small.camera, observe(small), small.T_base_cam)
