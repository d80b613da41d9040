"""The page beside new masks: complete, self-contained, the worst first."""

from __future__ import annotations

import re

import numpy as np
from html_page import Page
from report_case import result_of, solved, without_pose

from easyhecpp.formats.result_blocks import MaskResult, ViewResult
from easyhecpp.report.masks_page import masks_html, write_masks_page


def test_every_view_has_its_outline_score_and_notes_the_worst_first(tmp_path):
    case = solved()
    assert case.estimate is not None
    views = [ViewResult(id=f"000{i}", weight=float(i != 2), iou=0.9) for i in range(3)]
    masks = [
        MaskResult(id="0000", score=0.97),
        MaskResult(id="0001", score=0.61, notes=("The mask of hand is rejected.",)),
        MaskResult(id="0002", score=0.99),
        MaskResult(id="0003", notes=("The arm is out of view.",)),
    ]
    result = result_of(
        case.capture, case.estimate, verdict="doubtful", views=views, masks=masks,
        reasons=["Two arms fit. Check which is outlined."], notes=["masks: as asked"],
    )  # fmt: skip
    made = {name: mask for name, mask in case.masks.items() if name != "0003"}
    write_masks_page(tmp_path / "masks.html", result, case.capture, made)
    text = (tmp_path / "masks.html").read_text("utf-8")
    found = Page(text)
    assert [i for i in found.ids if i.startswith("view-")] == [
        "view-0003", "view-0002", "view-0001", "view-0000",
    ]  # fmt: skip
    assert found.text.index("Doubtful") < found.text.index("Two arms fit.")
    for words in (
        "Check which is outlined.", "masks: as asked", "Score 0.61", "The arm is out of view.",
        "overlap with the rendered arm 0.900", "no mask", "left out",
    ):  # fmt: skip
        assert words in found.text
    outlines = dict(re.findall(r'<path id="mask-(\d+)" d="([^"]*)"', text))
    assert [name for name in sorted(outlines) if outlines[name]] == ["0000", "0001", "0002"]


def test_the_page_loads_nothing_and_works_without_a_pose():
    for case in (solved(), without_pose()):
        text = masks_html(case.result, case.capture, case.masks)
        found = Page(text)
        assert found.loads
        assert all(load.startswith("data:image/") for load in found.loads)
        assert not re.search(r"https?://|@import|url\(", text)
    assert "do not use them" in found.text
    assert "Copy" not in found.text


def test_soft_masks_are_drawn_where_they_are_one_half():
    case = solved()
    soft = {name: 0.9 * mask.astype(np.float32) for name, mask in case.masks.items()}
    assert masks_html(case.result, case.capture, soft) == masks_html(
        case.result, case.capture, case.masks
    )
