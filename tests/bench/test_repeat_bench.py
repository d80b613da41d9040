"""Two halves of a recording, compared with each other and with what they state."""

from __future__ import annotations

import numpy as np
import pytest

from easyhecpp import Capture
from easyhecpp.bench.repeat import repeat_table, run_repeat_bench
from easyhecpp.capture import View
from easyhecpp.errors import InputError
from easyhecpp.sim.robots import load_robot
from easyhecpp.sim.scenes import random_scene


@pytest.fixture(scope="module")
def capture() -> Capture:
    """Exact masks of the xArm7, without images."""
    scene = random_scene(
        load_robot("xarm7"),
        np.random.default_rng([45, 0]),
        n_views=6,
        width=480,
        height=270,
        focal=338.0,
    )
    views = tuple(
        View(f"{i:04d}", q, mask=mask)
        for i, (q, mask) in enumerate(zip(scene.joints, scene.masks, strict=True))
    )
    return Capture("cell", None, "eye-to-hand", scene.robot, scene.camera, views)


def test_halves_with_exact_masks_agree_within_their_error_bars(capture: Capture) -> None:
    rows = run_repeat_bench(capture, splits=2, seed=5)
    assert [row.way for row in rows] == ["given masks"] * 2, "there are no images"
    for row in rows:
        assert row.apart is not None
        assert row.chi_square is not None
        assert 0.0 < row.apart.position_mm < 3.0
        assert row.chi_square < 20.0
    table = repeat_table(capture, rows, 5)
    (line,) = table.rows
    assert line[:3] == ("given masks", 2, 0)
    assert line[3] == pytest.approx(np.median([r.apart.position_mm for r in rows if r.apart]))
    assert line[-1] == 100.0


def test_too_few_views_for_two_halves_are_refused(capture: Capture) -> None:
    with pytest.raises(InputError, match=r"has 5 views.*6 or more"):
        run_repeat_bench(capture.subset(capture.view_ids[:5]), splits=1, seed=0)


def test_the_classical_way_is_left_out_for_a_camera_on_the_arm(capture: Capture) -> None:
    views = tuple(View(v.id, v.joints, np.zeros((270, 480, 3), np.uint8)) for v in capture.views)
    link = capture.robot.frame_names[-1]
    riding = Capture("wrist", None, "eye-in-hand", capture.robot, capture.camera, views, link)
    with pytest.raises(InputError, match="neither masks nor images"):
        run_repeat_bench(riding, splits=1, seed=0)


def test_a_recording_without_pictures_is_refused(capture: Capture) -> None:
    views = tuple(View(view.id, view.joints) for view in capture.views)
    bare = Capture("bare", None, "eye-to-hand", capture.robot, capture.camera, views)
    with pytest.raises(InputError, match="neither masks nor images"):
        run_repeat_bench(bare, splits=1, seed=0)
