from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from easyhecpp.errors import InputError
from easyhecpp.sim.faults import add_blob, punch_holes, remove_link


def coverage_of_a_box() -> np.ndarray:
    truth = np.zeros((120, 160), dtype=np.float32)
    truth[30:90, 50:110] = 1.0
    truth[30:90, 110] = 0.4  # a column that is partly covered
    return truth


@pytest.mark.parametrize("plain", [False, True])
def test_link_is_removed(plain: bool) -> None:
    truth = coverage_of_a_box()
    links = np.where(truth > 0.5, 0, -1).astype(np.int16)
    links[30:60, 50:110] = 1
    faulty = remove_link(truth > 0.5 if plain else truth, links, 1)
    assert faulty.dtype == (bool if plain else np.float32)
    assert not (faulty[30:60, 50:110] > 0.5).any()
    assert (faulty[60:90, 50:110] > 0.5).all()
    assert truth[40, 60] == 1.0  # the given one is left alone


@pytest.mark.parametrize("plain", [False, True])
@pytest.mark.parametrize("seed", range(5))
def test_blob_adds_its_area_and_is_attached(plain: bool, seed: int) -> None:
    truth = coverage_of_a_box()
    mask = truth > 0.5
    faulty = add_blob(mask if plain else truth, np.random.default_rng(seed), 0.15)
    assert faulty.dtype == (bool if plain else np.float32)
    now = faulty > 0.5
    assert (now | mask == now).all()
    assert now.sum() - mask.sum() == pytest.approx(0.15 * mask.sum(), abs=2)
    _, pieces = ndimage.label(now)
    assert pieces == 1


def test_blob_without_room_is_refused() -> None:
    with pytest.raises(InputError, match="blob of 15% of the arm's area cannot be attached"):
        add_blob(np.zeros((10, 10), dtype=bool), np.random.default_rng(0))


def test_holes_are_inside_and_of_the_asked_size() -> None:
    mask = np.ones((300, 300), dtype=bool)
    faulty = punch_holes(mask, np.random.default_rng(3), area_fraction=0.03, count=2)
    _, pieces = ndimage.label(~faulty)
    assert pieces == 2
    assert (~faulty).mean() == pytest.approx(0.03, rel=0.05)
    empty = np.zeros((5, 5), dtype=bool)
    np.testing.assert_array_equal(punch_holes(empty, np.random.default_rng(0)), empty)
