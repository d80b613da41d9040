"""A lens that is not as stated is told from the outlines, and from a wrong focal length."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from easyhecpp.camera import Camera
from easyhecpp.geometry import inverse
from easyhecpp.render import SilhouetteRenderer
from easyhecpp.rig import Rig
from easyhecpp.sim.masks import Degradation, degrade_masks
from easyhecpp.sim.robots import load_robot
from easyhecpp.sim.scenes import SimScene, random_scene
from easyhecpp.solve import Observation, solve_pose
from easyhecpp.solve.all_unknowns import intrinsic_columns
from easyhecpp.solve.lens import LensStrain, bent
from easyhecpp.solve.nuisance import read_priors, refine_nuisances
from easyhecpp.solve.problem import PoseProblem
from easyhecpp.solve.strains import strains

LENS = np.array([0.12, -0.2])


@pytest.fixture(scope="module")
def scene() -> SimScene:
    rng = np.random.default_rng([71, 0])
    return random_scene(
        load_robot("xarm7"), rng, n_views=8, width=960, height=540, focal=675.0
    )  # fmt: skip


def seen(scene: SimScene, true: Camera) -> list[Observation]:
    """Masks like a segmenter's, of pictures through a lens."""
    rig, renderer = Rig(scene.robot), SilhouetteRenderer(scene.robot.meshes, true)
    T_cam_base = inverse(scene.T_base_cam)
    covers = [renderer.coverage(T_cam_base @ rig.Ts_mount_link(q)) for q in scene.joints]
    masks = degrade_masks(covers, np.random.default_rng(5), Degradation()).masks
    pairs = enumerate(zip(scene.joints, masks, strict=True))
    return [Observation(q, m, id=str(i)) for i, (q, m) in pairs]


def asked(
    scene: SimScene, stated: Camera, views: list[Observation]
) -> tuple[LensStrain, np.ndarray]:
    rig = Rig(scene.robot)
    T = solve_pose(rig, stated, views, scene.T_base_cam).T_mount_cam
    return strains(PoseProblem(rig, stated, views), inverse(T)).lens, T


def test_an_unstated_lens_is_asked_for_and_refined(scene: SimScene) -> None:
    true = bent(scene.camera, LENS)
    views = seen(scene, true)
    strain, T = asked(scene, scene.camera, views)
    assert strain.asked
    found = refine_nuisances(
        Rig(scene.robot), scene.camera, views, T, read_priors(("lens",), scene.robot.joint_names)
    )
    for correction, k in zip(found.corrections, LENS, strict=True):
        assert abs(correction.value - k) < 3.0 * correction.sigma
        assert correction.sigma < 0.5 * abs(k)
    assert found.camera.distortion_model == "plumb_bob"
    assert np.linalg.eigvalsh(found.pose_covariance).min() > -1e-12


def test_two_views_are_too_few_to_doubt_the_lens(scene: SimScene) -> None:
    views = seen(scene, bent(scene.camera, 2.0 * LENS))
    strain, _ = asked(scene, scene.camera, views[:2])
    assert strain.n_views == 2
    assert not strain.asked


def test_the_stated_lens_is_left_alone(scene: SimScene) -> None:
    for stated in (scene.camera, bent(scene.camera, LENS)):
        strain, _ = asked(scene, stated, seen(scene, stated))
        assert not strain.asked
        assert strain.k @ np.linalg.solve(strain.covariance, strain.k) < 4.0


def test_a_wrong_focal_length_is_not_taken_for_a_lens(scene: SimScene) -> None:
    camera = scene.camera
    for factor in (0.96, 1.04):
        wrong = replace(camera, fx=factor * camera.fx, fy=factor * camera.fy)
        strain, _ = asked(scene, wrong, seen(scene, camera))
        assert strain.by_focal > 4.0
        assert not strain.asked


@pytest.mark.parametrize(
    ("model", "before"),
    [
        ("none", ()),
        ("plumb_bob", (0.05, -0.1, 1e-3, 2e-3)),
        ("rational_polynomial", (0.1, 0.2, 1e-3, 0.0, 0.1, 0.05, 0.1, 0.02)),
        ("equidistant", (0.02, -0.01, 0.0, 0.0)),
    ],
)
def test_columns_are_the_displacement_by_each_intrinsic(
    model: str, before: tuple[float, ...]
) -> None:
    camera = Camera(640, 480, 500.0, 500.0, 310.0, 250.0, model, before)
    rng = np.random.default_rng(1)
    points = rng.uniform((20, 20), (620, 460), (50, 2))
    angle = rng.uniform(0.0, 2.0 * np.pi, 50)
    normals = np.column_stack([np.cos(angle), np.sin(angle)])
    columns = intrinsic_columns(camera, points, normals)
    rays, step = camera.unproject(points), 1e-5
    others = [
        replace(camera, fx=camera.fx * (1 + step), fy=camera.fy * (1 + step)),
        replace(camera, cx=camera.cx + step),
        replace(camera, cy=camera.cy + step),
        bent(camera, np.array([step, 0.0])),
        bent(camera, np.array([0.0, step])),
    ]
    for column, other in zip(columns.T, others, strict=True):
        moved = np.einsum("ni,ni->n", normals, other.project(rays) - points) / step
        np.testing.assert_allclose(column, moved, rtol=1e-3, atol=1e-2)
