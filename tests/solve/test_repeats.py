"""Mask errors that several views share because they show the same scene."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from easyhecpp.solve.correlation import ContourPoints
from easyhecpp.solve.repeats import Repeats

N_STILL, N_MOVING = 80, 120


def views(n_views: int, common: float, rng: np.random.Generator) -> list[ContourPoints]:
    """Pictures of a base that stands still and a link that does not."""
    angle = np.linspace(0.0, 2.0 * np.pi, N_STILL, endpoint=False)
    still = np.column_stack([np.cos(angle), np.sin(angle)])
    same = np.repeat(rng.normal(size=N_STILL // 8), 8)
    made = []
    for view in range(n_views):
        own = np.repeat(rng.normal(size=N_STILL // 8), 8)
        made.append(
            ContourPoints(
                points=np.concatenate(
                    [
                        [300, 200] + 100.0 * still + 0.3 * rng.normal(size=still.shape),
                        rng.uniform(0, 100, (N_MOVING, 2)) + [600 + 150 * view, 100],
                    ]
                ),
                normals=np.concatenate([still, np.tile([1.0, 0.0], (N_MOVING, 1))]),
                jacobians=np.zeros((N_STILL + N_MOVING, 6)),
                residuals=np.concatenate(
                    [
                        np.sqrt(common) * same + np.sqrt(1.0 - common) * own,
                        rng.normal(size=N_MOVING),
                    ]
                ),
                weights=np.ones(N_STILL + N_MOVING),
                length_px=np.full(N_STILL + N_MOVING, 6.0),
                links=np.repeat([0, 1], [N_STILL, N_MOVING]),
            )
        )
    return made


def test_what_stands_still_is_seen_by_all_others() -> None:
    made = views(5, 0.5, np.random.default_rng(0))
    counts = Repeats.among(made, np.ones(5)).others()
    for count in counts:
        np.testing.assert_array_equal(count[:N_STILL], 4)
        np.testing.assert_array_equal(count[N_STILL:], 0)


def test_a_view_without_say_repeats_nothing() -> None:
    made = views(4, 0.5, np.random.default_rng(0))
    counts = Repeats.among(made, np.array([1.0, 0.0, 1.0, 1.0])).others()
    assert counts[1].max() == 0
    assert counts[0].max() == 2


@pytest.mark.parametrize("common", [0.3, 0.8])
def test_the_shared_part_is_measured_from_below(common: float) -> None:
    found = []
    for seed in range(20):
        made = views(6, common, np.random.default_rng(seed))
        repeats = Repeats.among(made, np.ones(6))
        found.append(repeats.shared([v.residuals for v in made]))
    assert common - 0.2 < np.mean(found) < common


def test_independent_masks_keep_their_say() -> None:
    found = []
    for seed in range(20):
        made = views(5, 0.0, np.random.default_rng(seed))
        repeats = Repeats.among(made, np.ones(5))
        found.append(repeats.shared([v.residuals for v in made]))
    assert np.median(found) == 0.0
    assert np.mean(found) < 0.03


def test_another_link_or_side_is_another_outline() -> None:
    made = views(2, 0.5, np.random.default_rng(0))
    other = replace(made[1], links=1 - made[1].links)
    turned = replace(made[1], normals=-made[1].normals)
    for second in (other, turned):
        assert Repeats.among([made[0], second], np.ones(2)).others()[0].max() == 0


def test_views_without_points() -> None:
    nothing = ContourPoints.joined([])
    repeats = Repeats.among([nothing, nothing], np.ones(2))
    assert [len(n) for n in repeats.others()] == [0, 0]
    assert repeats.shared([nothing.residuals] * 2) == 0.0
