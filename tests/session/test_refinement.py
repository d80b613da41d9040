"""`calibrate` with parameters to refine, from masks to the result file."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scenes_small import photographed

from easyhecpp import Capture, calibrate
from easyhecpp.bench.metrics import PoseError
from easyhecpp.bench.trust_scenes import build_case
from easyhecpp.capture import View
from easyhecpp.errors import InputError
from easyhecpp.geometry import inverse, log_se3
from easyhecpp.render import SilhouetteRenderer
from easyhecpp.rig import Rig
from easyhecpp.session import CalibrationConfig
from easyhecpp.session.refinement import add_corrections, as_refined, joint_offset_notes
from easyhecpp.sim.robots import load_robot
from easyhecpp.sim.scenes import random_scene
from easyhecpp.solve.lens import bent
from easyhecpp.solve.strains import Strain

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


def test_a_lens_that_nobody_stated_is_refined_unasked_and_told() -> None:
    rng = np.random.default_rng([45, 0])
    scene = random_scene(load_robot("xarm7"), rng, n_views=6, width=640, height=360, focal=450.0)
    true = bent(scene.camera, np.array([0.15, -0.25]))
    renderer = SilhouetteRenderer(scene.robot.meshes, true)
    T_cam_base = inverse(scene.T_base_cam)
    views = tuple(
        View(
            str(i), q, mask=renderer.coverage(T_cam_base @ Rig(scene.robot).Ts_mount_link(q)) > 0.5
        )
        for i, q in enumerate(scene.joints)
    )
    capture = Capture("cell", None, "eye-to-hand", scene.robot, scene.camera, views)
    found = run(capture)
    assert [p.name for p in found.result.refined] == ["k1", "k2"]
    assert found.result.camera.distortion[:2] == pytest.approx((0.15, -0.25), abs=0.04)
    (note,) = [note for note in found.notes if note.startswith("lens:")]
    assert "camera_info states no distortion" in note
    assert "px where the arm is seen" in note
    # Whoever states the lens is told nothing, and gets the same pose with a smaller error bar.
    told = run(replace(capture, camera=true))
    assert told.result.refined == ()
    assert not any(note.startswith("lens:") for note in told.notes)
    apart = PoseError.between(found.T_mount_cam, told.T_mount_cam)
    assert apart.position_mm < 3.0 * found.result.sigma.position_mm
    assert told.result.sigma.position_mm < found.result.sigma.position_mm


def test_an_arm_that_sags_is_refined_unasked_from_masks_and_told() -> None:
    rng, give = np.random.default_rng([49, 0]), 0.012
    scene = random_scene(load_robot("xarm7"), rng, n_views=6, width=640, height=360, focal=450.0)
    renderer = SilhouetteRenderer(scene.robot.meshes, scene.camera)
    T_cam_base, rig = inverse(scene.T_base_cam), Rig(scene.robot)
    masks = [renderer.coverage(T_cam_base @ rig.Ts_mount_link(q)) > 0.5 for q in scene.joints]
    pairs = enumerate(zip(scene.joints, masks, strict=True))
    views = tuple(View(str(i), q, mask=m) for i, (q, m) in pairs)
    stands = Capture("cell", None, "eye-to-hand", scene.robot, scene.camera, views)
    recorded = [q - give * scene.robot.sag(q) for q in scene.joints]
    sags = replace(
        stands, views=tuple(v.with_joints(q) for v, q in zip(stands.views, recorded, strict=True))
    )
    found = run(sags)
    assert [p.name for p in found.result.refined] == ["sag"]
    (sag,) = found.result.refined
    assert sag.correction == pytest.approx(give, abs=3.0 * sag.sigma)
    assert sag.sigma < 0.3 * give
    assert any(note.startswith("sag: the outlines show") for note in found.notes)
    assert PoseError.between(found.T_mount_cam, scene.T_base_cam).position_mm < 2.0
    # An arm that stands as recorded is left alone.
    assert run(stands).result.refined == ()


def test_joint_zeros_are_refined_unasked_from_pictures_and_told() -> None:
    case = photographed(2, n_views=8)
    off = np.deg2rad([0.0, -0.3, -0.3, -0.3])
    views = tuple(
        View(f"{i}", q - off, image=image)
        for i, (q, image) in enumerate(zip(case.joints, case.images, strict=True))
    )
    capture = Capture("cell", None, "eye-to-hand", case.rig.robot, case.camera, views)
    found = calibrate(capture, CalibrationConfig(segmenter="classical"))
    names = list(case.rig.robot.joint_names[1:])
    assert [p.name for p in found.result.refined] == names
    for refined, true in zip(found.result.refined, off[1:], strict=True):
        assert refined.correction == pytest.approx(true, abs=3.5 * refined.sigma)
    # What is drawn and written later is the arm as it stood.
    moved = found.capture.views[3].joints - capture.views[3].joints
    assert moved == pytest.approx([0.0, *(p.correction for p in found.result.refined)], abs=1e-9)
    (note,) = [note for note in found.notes if note.startswith("joints: the outlines ask")]
    assert f"{names[1]} -0." in note
    assert "the tip is off by as much" in note
    step = log_se3(inverse(found.T_mount_cam) @ case.T_mount_cam)
    assert step @ np.linalg.solve(found.estimate.covariance, step) < 22.5


def test_sag_is_refined_unasked_from_pictures_told_and_drawn() -> None:
    case = photographed(2, n_views=8)
    give = 7e-3
    hangs = give * case.rig.robot.sag(np.stack(case.joints))
    views = tuple(
        View(f"{i}", q - low, image=image)
        for i, (q, low, image) in enumerate(zip(case.joints, hangs, case.images, strict=True))
    )
    capture = Capture("cell", None, "eye-to-hand", case.rig.robot, case.camera, views)
    found = calibrate(capture, CalibrationConfig(segmenter="classical"))
    (sag,) = found.result.refined
    assert (sag.name, sag.unit) == ("sag", "rad or m")
    assert sag.correction == pytest.approx(give, abs=3.5 * sag.sigma)
    (note,) = [note for note in found.notes if note.startswith("sag:")]
    assert "gives way under its weight, by +0." in note
    step = log_se3(inverse(found.T_mount_cam) @ case.T_mount_cam)
    assert step @ np.linalg.solve(found.estimate.covariance, step) < 22.5
    # What is drawn, now or later from the result, is the arm as it hung, in each view its own way.
    stood = np.array([view.joints for view in found.capture.views])
    assert stood == pytest.approx(np.stack(case.joints), abs=4.0 * sag.sigma)
    later = as_refined(capture, found.result)
    assert np.array([view.joints for view in later.views]) == pytest.approx(stood, abs=2e-5)


def test_a_correction_on_top_of_another_is_their_sum() -> None:
    both = add_corrections((Strain("joint4", 0.01, 0.001),), (Strain("joint4", 0.002, 0.003),))
    assert both == (Strain("joint4", 0.012, 0.003),)


def test_zeros_that_were_asked_for_or_are_not_sure_are_no_news() -> None:
    unsure, sure = Strain("joint2", 0.002, 0.001), Strain("joint4", -0.007, 0.0016)
    lens = Strain("k1", 0.1, 0.01)
    assert joint_offset_notes((unsure, lens), ()) == ()
    assert joint_offset_notes((sure,), ("joint4=0.01",)) == ()
    (note,) = joint_offset_notes((unsure, sure, lens), ("joint2",))
    assert "ask for other zeros: joint4 -0.40 deg (sigma 0.09)." in note


def test_what_cannot_be_known_is_not_refined_and_said(capture: Capture) -> None:
    first = capture.robot.joint_names[0]
    found = run(capture, first)
    assert found.result.refined == ()
    assert found.result.verdict != "ok"
    assert any(f"cannot tell {first} from" in reason for reason in found.result.reasons)


def test_a_misspelt_parameter_is_refused_before_any_work(capture: Capture) -> None:
    with pytest.raises(InputError, match="'focus' cannot be refined"):
        run(capture, "focus")
