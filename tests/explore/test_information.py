"""Predicted information against the optimiser's own, and against true errors."""

from __future__ import annotations

import numpy as np
import pytest
from known_arm import estimate, known
from small_arm import scene

from easyhecpp.errors import InputError
from easyhecpp.explore import Knowledge, draw_candidates
from easyhecpp.explore.forecast import Forecast
from easyhecpp.explore.information import ViewPredictor
from easyhecpp.geometry import inverse, pose_error, transform_points
from easyhecpp.rig import Rig
from easyhecpp.solve.joint_noise import JointNoise


def test_predicted_information_is_what_the_optimiser_then_states(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # The forecast takes the joints at their word, the optimiser estimates their errors.
    monkeypatch.setattr(JointNoise, "fitted", lambda *_: JointNoise(1e-12))
    s = scene(3)
    found = estimate(s, [0, 1, 2, 3], 0)
    centre = transform_points(found.T_mount_cam, found.centre_cam)
    predictor = ViewPredictor(Rig(s.robot), s.camera)
    predicted = predictor.information(found.T_mount_cam[None], s.joints, centre)[:, 0]
    # Standard deviations along all directions, after the masks' general quality is taken out.
    ratios = np.sqrt(
        [
            np.linalg.eigvals(np.linalg.solve(own, new)).real
            for own, new in zip(found.information, predicted, strict=True)
        ]
    )
    ratios /= np.median(ratios)
    assert ratios.min() > 0.6
    assert ratios.max() < 1.6


def test_predicted_errors_are_the_true_ones() -> None:
    """From two views, predict what a third and fourth would leave; then take them, many times."""
    s, rig, knowledge = known()
    forecast = Forecast.of(rig, s.camera, knowledge, 1, np.random.default_rng(0))
    for view in (2, 3):
        forecast = forecast.with_view(s.joints[view])
    position, rotation = forecast.present()
    # The optimiser states covariances larger than the spread over noise draws on purpose.
    position, rotation = (
        position / np.sqrt(forecast.inflation),
        rotation / np.sqrt(forecast.inflation),
    )
    # The ratio is 1.8 to 1.9; of twelve draws it varies by a tenth from machine to machine.
    errors = np.array(
        [
            pose_error(estimate(s, [0, 1, 2, 3], seed).T_mount_cam, s.T_base_cam)
            for seed in range(24)
        ]
    )
    mm = 1e3 * np.sqrt(np.mean(errors[:, 0] ** 2))
    deg = np.rad2deg(np.sqrt(np.mean(errors[:, 1] ** 2)))
    assert 0.5 < mm / position < 2.0
    assert 0.5 < deg / rotation < 2.0


def test_nothing_in_view_tells_nothing() -> None:
    s = scene(3)
    away = s.T_base_cam @ np.diag([-1.0, 1.0, -1.0, 1.0])
    predictor = ViewPredictor(Rig(s.robot), s.camera)
    assert np.all(predictor.information(away[None], s.joints, np.zeros(3)) == 0.0)


def test_a_nearer_camera_knows_itself_better() -> None:
    s = scene(3)
    predictor = ViewPredictor(Rig(s.robot), s.camera)
    centre = s.robot.centre(s.joints).mean(axis=0)
    farther = s.T_base_cam.copy()
    farther[:3, 3] += 0.5 * (s.T_base_cam[:3, 3] - centre)
    I_near, I_far = predictor.information(np.stack([s.T_base_cam, farther]), s.joints[:1], centre)[
        0
    ]
    # Sideways motion of the arm in the picture.
    assert np.linalg.inv(I_near)[0, 0] < np.linalg.inv(I_far)[0, 0]


def test_each_view_adds_and_the_present_state_is_the_stated_one() -> None:
    s, rig, knowledge = known()
    forecast = Forecast.of(rig, s.camera, knowledge, 2, np.random.default_rng(0))
    position, rotation = forecast.present()
    stated = np.diag(knowledge.covariance)
    assert position == pytest.approx(1e3 * np.sqrt(stated[:3].sum()), rel=1e-6)
    assert rotation == pytest.approx(np.rad2deg(np.sqrt(stated[3:].sum())), rel=0.05)
    predicted, _ = forecast.expected(s.joints[2])
    assert predicted < position
    # Exactly so where one hypothesis is taken; the mean of covariances is not that of means.
    one = Forecast.of(rig, s.camera, knowledge, 1, np.random.default_rng(0))
    assert one.with_view(s.joints[2]).present()[0] == pytest.approx(
        one.expected(s.joints[2])[0], rel=1e-9
    )


def test_the_covariance_alone_serves_too() -> None:
    s, rig, knowledge = known()
    bare = Knowledge(knowledge.T_mount_cam, knowledge.covariance, knowledge.joints)
    q = draw_candidates(s.robot, 30, np.random.default_rng(1))
    with_all = Forecast.of(rig, s.camera, knowledge, 1, np.random.default_rng(0))
    with_less = Forecast.of(rig, s.camera, bare, 1, np.random.default_rng(0))
    assert with_less.present()[0] == pytest.approx(with_all.present()[0], rel=1e-6)
    a, b = with_all.mean_squares(q), with_less.mean_squares(q)
    assert np.corrcoef(np.log(a), np.log(b))[0, 1] > 0.95


def test_hypotheses_are_drawn_from_the_covariance() -> None:
    _, _, knowledge = known()
    Ts = knowledge.hypotheses(3000, np.random.default_rng(0))
    moved = Ts[:, :3, 3] - knowledge.T_mount_cam[:3, 3]
    R = knowledge.T_mount_cam[:3, :3]
    wanted = R @ knowledge.covariance[:3, :3] @ R.T
    assert np.abs(np.cov(moved.T) - wanted).max() < 0.1 * wanted.max()
    assert np.allclose(inverse(Ts) @ Ts, np.eye(4), atol=1e-9)


def test_knowledge_must_be_whole() -> None:
    _, _, k = known()
    with pytest.raises(InputError, match="no covariance"):
        Knowledge(k.T_mount_cam, np.zeros((6, 6)), k.joints)
    with pytest.raises(InputError, match="belong together"):
        Knowledge(k.T_mount_cam, k.covariance, k.joints, information=k.information)
