from __future__ import annotations

import os
import subprocess
import sys

import cv2
import numpy as np
import pytest
from sim_pictures import CAMERAS, shift_px

from easyhecpp.camera import Camera
from easyhecpp.geometry import inverse, look_at
from easyhecpp.render.reference_compiled import reference_coverage_compiled
from easyhecpp.sim.clutter import Prop, upright
from easyhecpp.sim.finishes import ArmLook, dress
from easyhecpp.sim.lens import plan_pinhole
from easyhecpp.sim.materials import Material, textured
from easyhecpp.sim.panels import Lamp, PaintedPanel
from easyhecpp.sim.robots import load_robot
from easyhecpp.sim.room import Surroundings
from easyhecpp.sim.shapes import panel
from easyhecpp.sim.studio import Quality, Studio, limit_threads

pytest.importorskip("mitsuba", reason="path-traced pictures need the extra sim")

T_BASE_CAM = look_at([1.1, 0.5, 0.7], [0.1, 0.0, 0.35])
JOINTS = np.array([0.3, -0.4, 0.2, 0.9, 0.1, 1.2, 0.0])
OFF_CENTRE = Camera(240, 136, 170.0, 170.0, 104.3, 79.6)


@pytest.fixture(scope="module")
def robot():
    return load_robot("xarm7")


@pytest.fixture(scope="module")
def shadow_play(robot):
    """A black arm before a white sky: the picture is one minus the coverage."""
    black = Material(colour=(0.0, 0.0, 0.0), roughness=1.0)
    look = ArmLook("black", black, black, black, 0.03)
    white = np.ones((4, 8, 3), np.float32)
    return Studio(Surroundings((), (), (), white, 0.0), (), [dress(robot, look)])


def traced_coverage(studio, robot, camera, quality, seed=1):
    plan = plan_pinhole(camera)
    poses = [robot.link_poses(JOINTS)]
    light = studio.photograph(plan.pinhole, T_BASE_CAM, poses, quality, seed)
    return 1.0 - plan.finish(light)[..., 0]


def true_coverage(robot, camera):
    Ts_cam_link = inverse(T_BASE_CAM) @ robot.link_poses(JOINTS)
    return reference_coverage_compiled(robot.meshes, camera, Ts_cam_link, 11)


def test_the_traced_arm_covers_the_pixels_that_the_reference_says(shadow_play, robot):
    traced = traced_coverage(shadow_play, robot, OFF_CENTRE, Quality(64, 1, denoise=False))
    truth = true_coverage(robot, OFF_CENTRE)
    assert np.abs(shift_px(traced, truth)).max() < 0.01
    edge = (truth > 0) & (truth < 1)
    assert np.abs((traced - truth)[edge].mean()) < 0.005
    assert np.abs(traced - truth).max() < 0.2
    assert traced[truth == 1].mean() > 0.9995
    assert traced[truth == 0].mean() < 0.0005


@pytest.mark.parametrize("name", CAMERAS)
def test_lenses_bend_the_traced_arm_as_the_projection_says(shadow_play, robot, name):
    camera = CAMERAS[name]
    traced = traced_coverage(shadow_play, robot, camera, Quality(36, 1, denoise=False))
    assert np.abs(shift_px(traced, true_coverage(robot, camera))).max() < 0.02


def test_denoising_does_not_move_edges(shadow_play, robot):
    quality = Quality(12, 1, denoise=True)
    several = [traced_coverage(shadow_play, robot, OFF_CENTRE, quality, seed) for seed in range(4)]
    traced = several[1]
    truth = true_coverage(robot, OFF_CENTRE)
    # One picture's noise moves it by a hundredth of a pixel.
    assert np.abs(np.mean([shift_px(one, truth) for one in several], axis=0)).max() < 0.015
    edge = (truth > 0) & (truth < 1)
    # Growing by a pixel would add about one for every pixel on the edge.
    assert abs((traced - truth).sum()) < 0.02 * edge.sum()


def test_the_same_seed_gives_the_same_picture_whatever_the_threads(shadow_play, robot):
    quality = Quality(2, 1, denoise=True)
    pictures = []
    try:
        for threads in (1, 2, 2):
            limit_threads(threads)
            pictures.append(traced_coverage(shadow_play, robot, OFF_CENTRE, quality))
    finally:
        limit_threads(2)
    other = traced_coverage(shadow_play, robot, OFF_CENTRE, quality, seed=2)
    assert np.array_equal(pictures[0], pictures[1])
    assert np.array_equal(pictures[1], pictures[2])
    assert not np.array_equal(pictures[0], other)


def test_a_picture_on_a_board_is_as_bright_as_its_srgb_says():
    picture = np.full((8, 8, 3), (188, 128, 60), np.uint8)
    board = Prop("board", panel(4.0, 4.0), textured(picture, roughness=0.7))
    white = np.ones((4, 8, 3), np.float32)
    studio = Studio(Surroundings((board,), (), (), white, 0.0), (), [])
    above = look_at([0.0, 0.0, 1.0], [0.0, 0.01, 0.0])
    light = studio.photograph(OFF_CENTRE, above, [], Quality(16, 2, denoise=False), 1)
    # The standard's formula: a matt thing under an even sky shows its linear reflectance.
    expected = ((np.array([188, 128, 60]) / 255 + 0.055) / 1.055) ** 2.4
    assert light.mean(axis=(0, 1)) == pytest.approx(expected, rel=0.01)


def test_a_glowing_panel_shows_its_light_whatever_else_shines():
    glow = np.full((4, 4, 3), (0.1, 0.2, 0.3), np.float32)
    lamp = Lamp(upright(0, 0, 2.0, 0) @ np.diag([1.0, -1, -1, 1]), (0.5, 0.5), np.full(3, 20.0))
    wall = PaintedPanel("wall", np.eye(4), (8.0, 8.0), glow)
    white = np.ones((4, 8, 3), np.float32)
    studio = Studio(Surroundings((), (wall,), (lamp,), white, 0.0), (), [])
    above = look_at([0.0, 0.0, 1.0], [0.0, 0.01, 0.0])
    for depth in (1, 2):
        light = studio.photograph(OFF_CENTRE, above, [], Quality(4, depth, denoise=False), 1)
        assert np.abs(light - glow[0, 0]).max() < 1e-5


def in_another_process(library: str, code: str) -> subprocess.CompletedProcess[str]:
    """Run code where the environment names an LLVM library, or none."""
    env = os.environ | {"DRJIT_LIBLLVM_PATH": library}
    return subprocess.run(
        [sys.executable, "-c", code], env=env, capture_output=True, text=True, check=False
    )


def test_a_named_library_that_is_none_is_told_in_one_sentence(tmp_path):
    code = f"""
import sys
from easyhecpp.cli import main
sys.exit(main(["bench", "photo", "--scenes", "1", "--out", {str(tmp_path / "t.md")!r}]))
"""
    run = in_another_process("/nowhere/libLLVM.so", code)
    assert run.returncode == 2
    assert "DRJIT_LIBLLVM_PATH names no LLVM library (/nowhere/libLLVM.so)" in run.stderr
    assert "apt-get install libllvm19" in run.stderr
    assert "Traceback" not in run.stderr
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(
    not os.environ.get("DRJIT_LIBLLVM_PATH"),
    reason="needs LLVM 16 or newer, which no wheel brings: name its library in DRJIT_LIBLLVM_PATH",
)
def test_both_tracers_see_the_same_light(tmp_path):
    code = f"""
import sys
import numpy as np
from easyhecpp.sim import Cell, CellOptions
from easyhecpp.sim.studio import Quality, tracer
rng = np.random.default_rng(5)
cell = Cell.random("xarm7", rng, options=CellOptions(width=320, height=180))
light = cell.light(cell.random_joints(1, rng)[0], Quality(64, denoise=False))
np.save({str(tmp_path)!r} + "/" + tracer(), light)
"""
    for library in ("", os.environ["DRJIT_LIBLLVM_PATH"]):
        run = in_another_process(library, code)
        assert run.returncode == 0, run.stderr
    scalar, compiled = (
        cv2.blur(np.load(tmp_path / f"{name}.npy"), (9, 9))
        for name in ("scalar_rgb", "llvm_ad_rgb")
    )
    apart = np.abs(scalar - compiled) / (scalar + compiled + 0.02)
    assert apart.mean() < 0.005
    assert np.percentile(apart, 95) < 0.03
