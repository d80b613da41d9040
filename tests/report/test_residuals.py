from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from report_case import solved
from small_arm import small_arm

from easyhecpp.render import SilhouetteRenderer
from easyhecpp.report.outline import outline
from easyhecpp.report.plots import histogram
from easyhecpp.report.residuals import LinkRow, contour_plot, link_table, mask_table, odd_links
from easyhecpp.solve import ContourFit


def fit_of(distances: np.ndarray, links: np.ndarray) -> ContourFit:
    n = len(distances)
    return ContourFit(
        points=np.column_stack([np.arange(n), np.zeros(n)]).astype(float),
        normals=np.zeros((n, 2)),
        residuals=np.zeros(n),
        distances=distances.astype(float),
        weights=np.ones(n),
        jacobians=np.zeros((n, 6)),
        links=links.astype(np.int32),
    )


def test_exact_masks_leave_small_displacements_everywhere():
    case = solved()
    assert case.estimate is not None
    rows = link_table(case.estimate, small_arm().link_names)
    assert len(rows) >= 4
    cells = [cell for row in rows for cell in row.cells if cell is not None]
    assert np.abs(cells).max() < 0.6
    assert odd_links(rows) == []


def test_the_table_holds_medians_by_link_and_view():
    case = solved()
    assert case.estimate is not None
    first = fit_of(np.repeat([2.0, -1.0], 40), np.repeat([0, 1], 40))
    second = fit_of(np.repeat([4.0, 9.0], [60, 10]), np.repeat([0, 1], [60, 10]))
    estimate = replace(case.estimate, contours=(first, second))
    rows = link_table(estimate, ["a", "b", "c"])
    # Ten pixels of b in the second view say too little; c is on no contour.
    assert rows == [LinkRow("a", (2.0, 4.0), 4.0), LinkRow("b", (-1.0, None), -1.0)]


def test_a_tool_that_only_the_masks_show_is_found():
    case = solved()
    assert case.estimate is not None
    hand = small_arm().link_names.index("hand")
    masks = {}
    for view, fit in zip(case.capture.views, case.estimate.contours, strict=True):
        masks[view.id] = view.mask.copy()
        for x, y in np.rint(fit.points[fit.links == hand]).astype(int):
            masks[view.id][max(0, y - 12) : y + 13, max(0, x - 12) : x + 13] = True
    (row,) = odd_links(mask_table(case.estimate, masks, small_arm().link_names))
    assert row.link == "hand"
    assert row.overall == pytest.approx(12.5, abs=2)
    assert mask_table(case.estimate, {}, small_arm().link_names) == []


def test_a_link_that_is_off_in_most_views_is_odd():
    rows = [
        LinkRow("a", (0.2, -0.3, 0.1), 0.1),
        LinkRow("b", (0.4, 0.3, -0.1), 0.3),
        LinkRow("tool", (12.0, 8.0, None), 9.0),
        LinkRow("once", (0.1, 9.0, 0.2), 0.2),
    ]
    assert [row.link for row in odd_links(rows)] == ["tool"]
    assert odd_links([LinkRow("alone", (5.0,), 5.0)]) == []
    assert odd_links([]) == []


def test_the_plot_runs_along_the_outline_and_outward_is_up():
    case = solved()
    assert case.estimate is not None
    view, fit = case.capture.views[0], case.estimate.contours[0]
    renderer = SilhouetteRenderer(small_arm().meshes, case.capture.camera)
    coverage = renderer.coverage(
        case.capture.rig.Ts_cam_link(case.estimate.T_mount_cam, view.joints)
    )
    outward = replace(fit, distances=np.full(len(fit.points), 1.0))
    svg = contour_plot(outward, outline(coverage), small_arm().link_names, 2.0)
    bars = np.array(re.findall(r"M([\d.]+) ([\d.]+)V([\d.]+)", svg), float)
    assert len(bars) == pytest.approx(len(fit.points) / 3, abs=2)
    assert (np.diff(bars[:, 0]) >= 0).all()
    np.testing.assert_allclose(bars[:, 1] - bars[:, 2], 92.0 / 4, atol=0.1)
    # The steps along the outline are even: no point is out of its turn.
    assert np.diff(bars[:, 0]).max() < 12 * np.median(np.diff(bars[:, 0]))


def test_the_histogram_counts_every_sample_once():
    values = np.array([-9.0, -1.0, -1.0, 0.0, 0.1, 1.0, 30.0])
    weights = np.array([0.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.0])
    svg = histogram(values, weights, 2.0)
    heights = {
        kind: sum(
            float(tall) for tall in re.findall(rf'class="{kind}"[^>]* height="([\d.]+)"', svg)
        )
        for kind in ("fill", "fill out")
    }
    # The tallest bar holds two samples.
    assert heights["fill"] / 140.0 * 2 == pytest.approx(5, abs=0.05)
    assert heights["fill out"] / 140.0 * 2 == pytest.approx(2, abs=0.05)
