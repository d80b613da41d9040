"""`calibrate` with parameters to refine, from masks to the result file."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from easyhecpp import Capture, calibrate
from easyhecpp.bench.trust_scenes import build_case
from easyhecpp.capture import View
from easyhecpp.errors import InputError
from easyhecpp.session import CalibrationConfig

OFF = 1.02


@pytest.fixture(scope="module")
def capture() -> Capture:
    """Five views of the xArm7 whose focal length is stated two per cent too long."""
    case = build_case("five good views", np.random.default_rng([44, 0]), 640)
    camera = replace(case.camera, fx=OFF * case.camera.fx, fy=OFF * case.camera.fy)
    views = tuple(View(o.id, o.joints, mask=o.mask > 0.5) for o in case.observations)
    return Capture("cell", None, "eye-to-hand", case.rig.robot, camera, views)


def rightly_stated(capture: Capture) -> Capture:
    camera = capture.camera
    camera = replace(camera, fx=camera.fx / OFF, fy=camera.fy / OFF)
    return Capture("cell", None, "eye-to-hand", capture.robot, camera, capture.views)


def run(capture: Capture, *words: str):
    return calibrate(capture, CalibrationConfig(segmenter="given", refine=words))


def test_the_result_holds_the_refined_camera_and_the_corrections(capture: Capture) -> None:
    plain, refined = run(capture), run(capture, "focal")
    (focal,) = refined.result.refined
    assert plain.result.refined == ()
    assert (focal.name, focal.unit) == ("focal", "relative")
    assert abs(focal.correction - (1.0 / OFF - 1.0)) < 3.0 * focal.sigma
    assert refined.result.camera.fx == pytest.approx(capture.camera.fx * (1 + focal.correction))
    assert refined.capture.camera.fx == refined.result.camera.fx
    # Not to know the focal length is to know the distance less well than one who does.
    known = run(rightly_stated(capture))
    assert known.result.sigma is not None
    assert refined.result.sigma is not None
    assert refined.result.sigma.position_mm > known.result.sigma.position_mm


def test_what_cannot_be_known_is_not_refined_and_said(capture: Capture) -> None:
    first = capture.robot.joint_names[0]
    found = run(capture, first)
    assert found.result.refined == ()
    assert found.result.verdict != "ok"
    assert any(f"cannot tell {first} from" in reason for reason in found.result.reasons)


def test_a_misspelt_parameter_is_refused_before_any_work(capture: Capture) -> None:
    with pytest.raises(InputError, match="'focus' cannot be refined"):
        run(capture, "focus")
