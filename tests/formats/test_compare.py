from __future__ import annotations

import numpy as np
import pytest
from format_cases import CAMERA, COVARIANCE, make_result, poses
from scipy import stats
from scipy.spatial.transform import Rotation

from easyhecpp.camera import Camera
from easyhecpp.errors import InputError
from easyhecpp.formats.compare import chi_square, compare, joint_covariance, p_value
from easyhecpp.formats.result_file import ResultFile, RobotBlock
from easyhecpp.geometry import exp_se3, inverse, log_se3


def two(step: np.ndarray, **changes: object) -> tuple[ResultFile, ResultFile]:
    T = poses()[2]
    return make_result(T), make_result(T @ exp_se3(step), **changes)


def test_difference_in_millimetres_and_degrees_agrees_with_scipy() -> None:
    Ta, Tb = poses()[4], poses()[5]
    found = compare(make_result(Ta), make_result(Tb))
    turned = Rotation.from_matrix(Ta[:3, :3]).inv() * Rotation.from_matrix(Tb[:3, :3])
    assert found.difference_mm == pytest.approx(1e3 * np.linalg.norm(Ta[:3, 3] - Tb[:3, 3]))
    assert found.rotation_deg == pytest.approx(np.degrees(turned.magnitude()))
    np.testing.assert_allclose(Ta @ exp_se3(np.array(found.delta)), Tb, atol=1e-12)


def test_workspace_difference_is_that_of_a_point_seen_by_both() -> None:
    step = np.array([0.002, -0.001, 0.003, 0.004, -0.002, 0.001])
    a, b = two(step)
    point = np.array([0.4, 0.0, 0.2, 1.0])
    assert a.T_mount_cam is not None
    assert b.T_mount_cam is not None
    seen = np.linalg.inv(a.T_mount_cam.array) @ point
    moved = b.T_mount_cam.array @ seen
    assert compare(a, b).workspace_mm == pytest.approx(1e3 * np.linalg.norm((moved - point)[:3]))


def test_same_result_agrees() -> None:
    found = compare(*two(np.zeros(6)))
    assert found.difference_mm == pytest.approx(0.0, abs=1e-9)
    assert found.p_value == pytest.approx(1.0)
    assert "agree within their uncertainty" in found.sentence


def test_p_value_is_the_tail_of_chi_square_with_six_degrees_of_freedom() -> None:
    for chi in (0.0, 0.3, 5.348, 12.592, 40.0, 700.0):
        assert p_value(chi) == pytest.approx(stats.chi2.sf(chi, 6), rel=1e-10)
    assert p_value(1e9) == 0.0


@pytest.mark.parametrize("apart", [0, 1])
def test_chi_square_is_calibrated(apart: int) -> None:
    """Poses drawn with their stated covariances differ by what the joint covariance says.

    The two results may be of unlike precision, and the lever arm between frames must be carried
    over, which a difference taken in the wrong frame would get wrong.
    """
    rng = np.random.default_rng(1)
    truth = poses()[3]
    other = np.diag([9e-6, 1e-8, 4e-8, 1e-9, 1e-6, 1e-7])
    turn = np.linalg.qr(rng.normal(size=(6, 6)))[0]
    covariances = (COVARIANCE, turn @ other @ turn.T if apart else COVARIANCE * 0.1)
    values = []
    for _ in range(400):
        Ta, Tb = (truth @ exp_se3(rng.multivariate_normal(np.zeros(6), C)) for C in covariances)
        joint = joint_covariance(Ta, covariances[0], Tb, covariances[1])
        values.append(chi_square(log_se3(inverse(Ta) @ Tb), joint))
    assert stats.kstest(values, stats.chi2(6).cdf).pvalue > 0.01


@pytest.mark.parametrize(
    ("sigmas", "words"),
    [(1.0, "agree within their uncertainty"), (3.7, "barely"), (8.0, "contradict each other")],
)
def test_sentence_follows_the_p_value(sigmas: float, words: str) -> None:
    step = np.zeros(6)
    step[2] = sigmas * np.sqrt(2.0 * COVARIANCE[2, 2])
    found = compare(*two(step))
    assert found.chi_square == pytest.approx(sigmas**2, rel=1e-6)
    assert words in found.sentence
    assert f"{1e3 * step[2]:.3g} mm" in found.sentence


def test_expected_size_is_the_joint_standard_deviation() -> None:
    found = compare(*two(np.zeros(6)))
    assert found.sigma_mm == pytest.approx(1e3 * np.sqrt(2 * np.trace(COVARIANCE[:3, :3])))
    assert found.sigma_deg == pytest.approx(np.degrees(np.sqrt(2 * np.trace(COVARIANCE[3:, 3:]))))


def test_without_covariance_nothing_is_judged() -> None:
    found = compare(*two(np.full(6, 1e-3), covariance=None))
    assert found.p_value is None
    assert found.sigma_mm is None
    assert "no covariance" in found.sentence


def test_covariance_without_a_direction_does_not_break_it() -> None:
    along = np.array([1e-3, 0.0, 0.0, 0.0, 0.0, 1e-4])
    T = poses()[2]
    singular = {"covariance": np.outer(along, along)}
    a = make_result(T, **singular)
    assert compare(a, make_result(T @ exp_se3(along), **singular)).chi_square == pytest.approx(
        0.5, rel=1e-3
    )
    off = np.array([0.0, 1e-3, 0.0, 0.0, 0.0, 0.0])
    assert "contradict" in compare(a, make_result(T @ exp_se3(off), **singular)).sentence


def test_different_parents_are_refused() -> None:
    other = make_result(robot=RobotBlock(name="arm", base_link="world"))
    with pytest.raises(InputError, match=r"'link_base' and 'world'"):
        compare(make_result(), other)
    with pytest.raises(InputError, match="'link_base' and 'link_eef'"):
        compare(make_result(), make_result(setup="eye-in-hand"))


def test_result_without_a_pose_is_refused() -> None:
    failed = ResultFile.build(
        setup="eye-to-hand",
        robot=RobotBlock(name="arm", base_link="link_base"),
        camera=CAMERA,
        verdict="failed",
        T_mount_cam=None,
    )
    with pytest.raises(InputError, match="The second result has no pose"):
        compare(make_result(), failed)


def test_notes_say_what_limits_the_comparison() -> None:
    other = Camera(1280, 720, 900.0, 900.0, 640.0, 360.0, frame="left_optical_frame")
    _, b = two(np.zeros(6), verdict="doubtful", camera=other)
    text = " ".join(compare(make_result(poses()[2]), b).notes)
    assert "second result's verdict is doubtful" in text
    assert "'left_optical_frame'" in text
    assert "different intrinsics" in text
    assert compare(*two(np.zeros(6))).notes == ()
