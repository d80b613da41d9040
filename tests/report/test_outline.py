from __future__ import annotations

import numpy as np
import pytest

from easyhecpp.report.outline import outline, simplify


def disc(cx: float, cy: float, radius: float, shape: tuple[int, int] = (160, 200)) -> np.ndarray:
    rows, columns = np.indices(shape)
    return np.hypot(columns - cx, rows - cy) < radius


@pytest.mark.parametrize("radius", [12.0, 50.3])
def test_a_disc_of_pixels_has_the_circle_as_its_outline(radius):
    (line,) = outline(disc(100.3, 79.6, radius))
    off = np.hypot(line[:, 0] - 100.3, line[:, 1] - 79.6) - radius
    assert abs(off.mean()) < 0.1  # findContours alone: -0.5
    assert np.abs(off).max() < 0.7  # a stair of pixels
    assert (line[0] == line[-1]).all()


def test_the_edge_of_a_soft_mask_is_where_it_is_one_half():
    # Columns up to 30 are covered, and 30 % of column 31: the edge is at 30.5 + 0.3.
    coverage = np.zeros((60, 80), np.float32)
    coverage[:, :31] = 1.0
    coverage[:, 31] = 0.3
    (line,) = outline(coverage)
    assert np.abs(line[:, 0] - 30.8).max() < 0.1


def test_the_image_edge_is_no_outline_and_cuts_the_line():
    mask = np.zeros((60, 80), bool)
    mask[20:50, :40] = True
    (line,) = outline(mask)
    assert line[:, 0].min() > 0.4
    assert (line[0] != line[-1]).any()
    # Up one side and back along the other: both ends are at the image's left edge.
    assert max(line[0, 0], line[-1, 0]) < 2.0
    assert line[:, 0].max() == pytest.approx(39.5, abs=0.1)


def test_holes_have_outlines_and_specks_have_none():
    mask = disc(100, 80, 50) & ~disc(100, 80, 20)
    mask[2:4, 2:4] = True
    lines = outline(mask)
    radii = sorted(np.hypot(*(line - (100, 80)).T).mean() for line in lines)
    assert radii == pytest.approx([20, 50], abs=0.2)


@pytest.mark.parametrize("value", [False, True])
def test_a_mask_of_one_value_has_no_outline(value):
    assert outline(np.full((40, 50), value)) == []


def test_simplifying_moves_the_line_by_about_what_was_asked():
    lines = outline(disc(100.3, 79.6, 50.3))
    (thin,) = simplify(lines, 0.15)
    assert len(thin) < 0.5 * len(lines[0])
    assert (thin[0] == thin[-1]).all()
    # Distance of every original point to the nearest point of the thin polyline.
    a, b = thin[:-1], thin[1:]
    along = np.einsum("nk,mnk->mn", b - a, lines[0][:, None] - a) / ((b - a) ** 2).sum(1)
    nearest = a + np.clip(along, 0, 1)[..., None] * (b - a)
    assert np.linalg.norm(nearest - lines[0][:, None], axis=2).min(axis=1).max() < 0.3
