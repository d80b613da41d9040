from __future__ import annotations

from functools import cache

import cv2
import numpy as np
import pytest

from easyhecpp.capture.still_camera import Backdrop, camera_moves

SIZE = (480, 640)


@cache
def room(seed: int = 0) -> np.ndarray:
    """Patches of many sizes, larger than what the camera sees of them."""
    rng = np.random.default_rng(seed)
    picture = np.full((SIZE[0] + 400, SIZE[1] + 400, 3), 110.0)
    for cells in (9, 23, 60):
        small = rng.normal(0.0, 22.0, (cells, cells, 3))
        picture += cv2.resize(small, picture.shape[1::-1], interpolation=cv2.INTER_NEAREST)
    return cv2.GaussianBlur(picture, (0, 0), 0.8)


def seen(
    view: int, *, shift: tuple[float, float] = (0.0, 0.0), turn_deg: float = 0.0, gain: float = 1.0
) -> np.ndarray:
    """The room with a patterned arm before it, which stands elsewhere in every view."""
    M = cv2.getRotationMatrix2D((SIZE[1] / 2 + 200, SIZE[0] / 2 + 200), turn_deg, 1.0)
    M[:, 2] += np.array(shift) - 200.0
    picture = cv2.warpAffine(room(), M, SIZE[::-1])
    arm = room(7)[:260, :150]
    x = 60 + 47 * view
    picture[100:360, x : x + 150] = arm + 40.0
    noise = np.random.default_rng(view).normal(0.0, 2.0, picture.shape)
    return (gain * picture + noise).clip(0, 255).astype(np.uint8)


def moves(pictures: list[np.ndarray]):
    return camera_moves([Backdrop.of(f"{i:04d}", p) for i, p in enumerate(pictures)])


def test_a_still_camera_before_an_arm_that_moves():
    assert moves([seen(i, gain=(1.0, 0.8, 1.2)[i % 3]) for i in range(8)]).moved == {}


@pytest.mark.parametrize("shift", [(2.5, 0.0), (-20.0, 30.0), (150.0, -40.0)])
def test_one_view_of_a_camera_that_stood_elsewhere(shift):
    pictures = [seen(i) for i in range(8)]
    pictures[3] = seen(3, shift=shift)
    found = moves(pictures)
    assert list(found.moved) == ["0003"]
    assert found.moved["0003"] == pytest.approx(np.hypot(*shift), abs=0.3)
    assert not found.for_good
    size = round(found.moved["0003"])
    assert (
        found.text == f"The camera moved in view 0003 by about {size} px, against the other views"
    )


def test_a_camera_that_turned_about_its_axis():
    pictures = [seen(i) for i in range(6)]
    pictures[5] = seen(5, turn_deg=2.0)
    assert list(moves(pictures).moved) == ["0005"]


def test_the_smaller_group_is_the_one_that_moved():
    pictures = [seen(i, shift=(0.0, 0.0) if i < 3 else (25.0, 9.0)) for i in range(8)]
    found = moves(pictures)
    assert list(found.moved) == ["0000", "0001", "0002"]
    assert found.for_good
    assert "in views 0000, 0001, 0002 by about 27 px" in found.text


def test_many_views():
    pictures = [seen(i % 8) for i in range(20)]
    pictures[7] = seen(7, shift=(40.0, 0.0))
    assert list(moves(pictures).moved) == ["0007"]


def test_nothing_is_said_where_nothing_is_known():
    plain = [np.full((*SIZE, 3), 90, np.uint8) for _ in range(5)]
    assert moves(plain).moved == {}
    # An arm alone before a plain wall: all that can be followed moves.
    for i, picture in enumerate(plain):
        picture[60:400, 60 + 40 * i : 300 + 40 * i] = room(7)[:340, :240].clip(0, 255)
    assert moves(plain).moved == {}
    assert (
        moves([room(i)[: SIZE[0], : SIZE[1]].clip(0, 255).astype(np.uint8) for i in range(5)]).moved
        == {}
    )
    assert moves([seen(0), seen(1, shift=(30.0, 0.0))]).moved == {}
