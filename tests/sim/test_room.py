from __future__ import annotations

import numpy as np
import pytest

from easyhecpp.sim import textures
from easyhecpp.sim.clutter import upright
from easyhecpp.sim.panels import Lamp, Shade, painted, to_linear
from easyhecpp.sim.room import RoomPlan, random_surroundings
from easyhecpp.sim.skies import SKIES

GREY = (0.5, 0.5, 0.5)
PICTURES = {
    "paint": lambda rng: textures.paint(rng, GREY),
    "concrete": lambda rng: textures.concrete(rng, GREY),
    "wood": lambda rng: textures.wood(rng, GREY),
    "checker": lambda rng: textures.checker(rng, GREY, (0.1, 0.2, 0.3)),
    "tiles": lambda rng: textures.tiles(rng, GREY),
    "bricks": lambda rng: textures.bricks(rng, GREY),
    "carpet": lambda rng: textures.carpet(rng, GREY),
    "brushed": lambda rng: textures.brushed(rng, GREY),
    "cabinet": lambda rng: textures.cabinet(rng, GREY),
    "cardboard": textures.cardboard,
    "poster": textures.poster,
    "screen": textures.screen,
    "bookshelf": textures.bookshelf,
    "spots": textures.spots,
}
DOWN = np.diag([1.0, -1.0, -1.0, 1.0])


@pytest.mark.parametrize("name", PICTURES)
def test_textures_are_coloured_pictures_that_the_seed_decides(name):
    first, again, other = (PICTURES[name](np.random.default_rng(s)) for s in (1, 1, 2))
    assert first.dtype == np.uint8
    assert first.ndim == 3
    assert first.shape[2] == 3
    assert first.std() > 1
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


@pytest.mark.parametrize("name", SKIES)
def test_skies_are_bright_above_and_close_to_even(name):
    sky = SKIES[name](np.random.default_rng(3))
    assert sky.dtype == np.float32
    assert sky.shape[1] == 2 * sky.shape[0]
    assert (sky >= 0).all()
    half = len(sky) // 2
    assert sky[:half].mean() > sky[half:].mean()


def test_noise_has_the_spectrum_that_it_names():
    noise = textures.fractal_noise((256, 256), np.random.default_rng(0), slope=1.0)
    assert noise.mean() == pytest.approx(0.0, abs=1e-9)
    assert noise.std() == pytest.approx(1.0)
    power = np.abs(np.fft.fft2(noise)) ** 2
    low, high = power[0, 4:8].mean(), power[0, 32:64].mean()
    # Amplitude 1 / f is power 1 / f^2: eight times the frequency, a sixty-fourth of the power.
    assert 20 < low / high < 200


def lamp_above(height: float) -> Lamp:
    return Lamp(upright(0, 0, height, 0) @ DOWN, (0.2, 0.2), np.array([10.0, 10.0, 10.0]))


def test_a_small_lamp_lights_a_panel_by_the_inverse_square_of_its_distance():
    white = np.full((8, 8, 3), 255, np.uint8)
    none = np.zeros(3)
    near, far = (
        painted("floor", np.eye(4), (0.02, 0.02), white, [lamp_above(h)], none).radiance.mean()
        for h in (2.0, 4.0)
    )
    # Lambert: radiance = irradiance / pi = L A / (pi d^2).
    assert near == pytest.approx(10 * 0.04 / np.pi / 4, rel=0.01)
    assert near / far == pytest.approx(4.0, rel=0.01)


def test_a_table_keeps_lamp_and_sky_from_the_floor_below():
    white = np.full((90, 90, 3), 255, np.uint8)
    table = Shade(upright(0, 0, 0.8, 0), (1.0, 1.0))
    floor, open_floor = (
        painted(
            "floor",
            np.eye(4),
            (6.0, 6.0),
            white,
            [lamp_above(2.5)],
            np.ones(3),
            shades=shades,
            cells=90,
        ).radiance[..., 0]
        for shades in ([table], [])
    )
    assert floor[45, 45] < 0.8 * open_floor[45, 45]
    assert floor[45, 2] == pytest.approx(open_floor[45, 2], rel=0.06)
    assert (floor <= open_floor + 1e-6).all()


def test_to_linear_follows_the_srgb_curve():
    assert to_linear(np.array([0, 128, 255], np.uint8)) == pytest.approx([0.0, 0.2158605, 1.0])


@pytest.mark.parametrize("seed", range(6))
def test_a_room_stays_clear_of_the_base_and_of_the_camera(seed):
    rng = np.random.default_rng(seed)
    plan = RoomPlan(1.07, 0.0, False, rng.uniform(-np.pi, np.pi), 1.5, 0.6, n_clutter=10)
    room = random_surroundings(rng, plan)
    camera = 1.5 * np.array([np.cos(plan.camera_azimuth), np.sin(plan.camera_azimuth), 0.3])
    for panel in room.panels:
        offset = camera - panel.T_base_panel[:3, 3]
        if panel.name in ("wall", "floor", "ceiling"):
            assert offset @ panel.T_base_panel[:3, 2] > 0, "the camera is behind a wall"
        if panel.name == "furniture":
            assert np.linalg.norm(panel.surface.vertices[:, :2], axis=1).min() > 0.9 * plan.reach
    for prop in room.props:
        if prop.name == "clutter":
            assert prop.surface.vertices[:, 2].min() > -1e-6
            assert np.linalg.norm(prop.surface.vertices[:, :2].mean(axis=0)) > 0.15
        if prop.name == "table":
            assert prop.surface.vertices[:, 2].max() == pytest.approx(plan.stand_z)


def test_lamps_hang_above_the_camera() -> None:
    """From just above one, its black back would fill the picture."""
    rng = np.random.default_rng(5)
    heights = []
    for camera_z in (0.3, 1.6):
        plan = RoomPlan(1.07, 0.0, False, 0.3, 1.0, camera_z, n_clutter=0)
        lamps = [lamp for _ in range(10) for lamp in random_surroundings(rng, plan).lamps]
        lowest = min(lamp.T_base_lamp[2, 3] for lamp in lamps)
        assert lowest > camera_z + 0.1
        heights.append(lowest)
    assert heights[0] < 1.6


def test_the_ceiling_is_above_the_lamps_and_a_camera_that_stands_high() -> None:
    """From above it, its back would fill the picture."""
    rng = np.random.default_rng(6)
    found = 0
    for _ in range(8):
        plan = RoomPlan(1.07, 0.0, False, 0.3, 1.0, 2.3, n_clutter=0)
        room = random_surroundings(rng, plan)
        for panel in room.panels:
            if panel.name == "ceiling":
                found += 1
                height = panel.T_base_panel[2, 3]
                assert height > plan.camera_z + 0.1
                assert height > max(lamp.T_base_lamp[2, 3] for lamp in room.lamps)
    assert found > 0
