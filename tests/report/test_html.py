"""The report as text: complete, self-contained, valid."""

from __future__ import annotations

import re
from ast import literal_eval
from dataclasses import replace

import numpy as np
import pytest
from html_page import Page
from report_case import REASON, Case, result_of, solved, without_pose

import easyhecpp
from easyhecpp.capture import View
from easyhecpp.errors import InputError
from easyhecpp.formats.result_blocks import LinkAgreement, MaskResult, ViewResult
from easyhecpp.report.html import report_html, write_report


def page(case: Case) -> Page:
    return Page(report_html(*case.arguments))


def changed(**changes) -> Case:
    case = solved()
    assert case.estimate is not None
    return replace(case, result=result_of(case.capture, case.estimate, **changes))


@pytest.mark.parametrize("case", [solved, without_pose], ids=lambda case: case.__name__)
def test_the_page_is_balanced_and_loads_nothing(case):
    text = report_html(*case().arguments)
    found = Page(text)
    assert found.loads
    assert all(load.startswith("data:image/") for load in found.loads)
    assert all(link.startswith("#") and link[1:] in found.ids for link in found.links)
    assert not re.search(r"https?://|@import|url\(", text)


def test_the_verdict_comes_first_with_reasons_and_advice():
    text = page(changed(verdict="doubtful", reasons=[REASON])).text
    assert 0 < text.index("Doubtful") < text.index("Left out: 0002.") < text.index("Pose and unc")
    assert text.index("What to do next") < text.index(REASON)


def test_both_directions_are_given_with_frames_and_both_orders_of_the_quaternion():
    case = solved()
    found = page(case)
    for transform in (case.result.T_mount_cam, case.result.T_cam_mount):
        assert transform is not None
        assert f"p_{transform.parent} = T · p_{transform.child}" in found.text
        w, x, y, z = transform.quat_wxyz
        for order in ((w, x, y, z), (x, y, z, w)):
            assert " ".join(f"{value:+.7f}" for value in order) in found.text
        # The matrix can be pasted as it stands.
        rows = [", ".join(f"{v:+.7f}" for v in row) for row in transform.matrix[:3]]
        (matrix,) = [m for m in re.findall(r"\[\[.*?\]\]", found.text, re.S) if rows[0] in m]
        np.testing.assert_allclose(np.array(literal_eval(matrix)), transform.array, atol=1e-7)


def test_every_view_is_there_with_its_numbers_and_flags():
    views = [
        ViewResult(id="0000", weight=0.9, rms_px=0.41, iou=0.987),
        ViewResult(id="0001", weight=0.2, rms_px=0.52, iou=0.9, prediction_px=0.77),
        ViewResult(id="0002", weight=0.0, rms_px=7.5, iou=0.4, flags=("moving", "Odd thing.")),
    ]
    found = page(changed(views=views))
    assert {"view-0000", "view-0001", "view-0002", "view-0003"} <= set(found.ids)
    for words in ("0.41 px", "0.987", "0.77 px", "partly used", "left out", "Odd thing."):
        assert words in found.text
    assert "the arm was probably moving" in found.text
    assert "2 of 4" in re.sub(r"\s+", " ", found.text)


def test_the_record_tells_how_it_was_made():
    text = page(solved()).text
    for words in ("easyhecpp calibrate small", "given", easyhecpp.__version__, "1.50 s", "2.00 s"):
        assert words in text


def test_a_link_that_differs_from_the_urdf_is_named_at_the_top():
    case = solved()
    assert case.estimate is not None
    hand = case.capture.robot.link_names.index("hand")
    masks = {name: mask.copy() for name, mask in case.masks.items()}
    for view, fit in zip(case.estimate.views, case.estimate.contours, strict=True):
        for x, y in np.rint(fit.points[fit.links == hand]).astype(int):
            masks[view.id][max(0, y - 12) : y + 13, max(0, x - 12) : x + 13] = True
    text = page(replace(case, masks=masks)).text
    assert 0 < text.index("Compare hand with the real one") < text.index("Pose and uncertainty")
    assert "hand is larger in the masks than in" in text


def test_a_failed_pose_is_shown_without_its_uncertainty():
    found = page(changed(verdict="failed", reasons=["It is bad."]))
    assert "Pose, not to be used" in found.text
    assert "±" not in found.text
    assert "uncertainty" not in found.ids


def test_a_failure_without_a_pose_shows_the_masks_and_no_numbers():
    found = page(without_pose())
    assert "No pose was found." in found.text
    assert {"view-0000", "view-0003", "verdict"} <= set(found.ids)
    assert "pose" not in found.ids
    assert "Camera position" not in found.text


def test_a_camera_on_the_wrist_is_called_so():
    case = solved()
    assert case.estimate is not None
    capture = replace(case.capture, setup="eye-in-hand", ee_link="hand")
    result = result_of(capture, case.estimate)
    text = Page(report_html(result, capture, None, case.masks)).text
    assert "camera on the arm" in text
    assert "p_hand = T · p_camera_color_optical_frame" in text


def test_it_works_without_an_estimate_without_masks_and_without_pictures():
    case = solved()
    bare = replace(case.capture, views=tuple(View(v.id, v.joints) for v in case.capture.views))
    found = Page(report_html(case.result, bare))
    assert {"view-0000", "view-0003"} <= set(found.ids)
    assert "residuals" not in found.ids


def test_soft_masks_are_drawn_where_they_are_one_half():
    case = solved()
    soft = {name: 0.9 * mask.astype(np.float32) for name, mask in case.masks.items()}
    hard = report_html(*case.arguments)
    assert report_html(case.result, case.capture, case.estimate, soft) == hard


def test_names_cannot_break_the_page():
    case = solved()
    views = tuple(
        View(name, v.joints, v.image)
        for name, v in zip(("a b", "<i>&", 'é"', "a_20b"), case.capture.views, strict=True)
    )
    capture = replace(case.capture, name="<script>alert(1)</script>", views=views)
    text = report_html(case.result.model_copy(update={"command": "x --out '<b>'"}), capture)
    found = Page(text)
    assert "<script>alert" not in text
    assert "<i>&" in found.text
    assert "'<b>'" in found.text


def test_the_worst_place_is_where_the_mask_lacks_a_part():
    case = solved()
    mask = case.masks["0000"].copy()
    rows, columns = np.nonzero(mask)
    y, x = rows[0] + 4, columns[rows == rows[0] + 4][0]
    mask[max(0, y - 14) : y + 14, max(0, x - 14) : x + 14] ^= True
    text = report_html(case.result, case.capture, case.estimate, {**case.masks, "0000": mask})
    (window,) = re.findall(
        r'<rect class="window" x="([\d.-]+)" y="([\d.-]+)" width="(\d+)" height="(\d+)"',
        text.split('id="view-0001"')[0],
    )
    left, top, width, height = map(float, window)
    assert left <= x <= left + width
    assert top <= y <= top + height
    gap = re.search(r"worst gap</dt><dd>(\d+) px", text)
    assert gap
    assert 20 <= int(gap.group(1)) <= 30


def test_the_file_is_written_whole_and_an_unwritable_place_is_named(tmp_path):
    case = solved()
    write_report(tmp_path / "new" / "report.html", *case.arguments)
    assert [p.name for p in (tmp_path / "new").iterdir()] == ["report.html"]
    assert Page((tmp_path / "new" / "report.html").read_text("utf-8")).ids
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match=r"Cannot write.*file"):
        write_report(tmp_path / "file" / "report.html", *case.arguments)
    with pytest.raises(InputError, match="over a folder"):
        write_report(tmp_path / "new", *case.arguments)


def test_how_well_links_and_pictures_agree_stands_in_a_table():
    links = (
        LinkAgreement(link="hand", score=0.07, edge=0.05, colour=0.5, length_px=300.0),
        LinkAgreement(
            link="base", score=0.95, edge=0.6, colour=0.0, offset_px=1.24, length_px=100.0
        ),
    )
    masks = [
        MaskResult(id="0000", score=0.875, notes=("Link hand hardly agrees.",), links=links),
        MaskResult(id="0001", notes=("The arm is out of view.",)),
    ]
    text = report_html(*changed(masks=masks).arguments)
    table = text[text.index('id="agreement"') : text.index('id="residuals"')]
    cells = re.findall(r"<td[^>]*>([^<]*)</td>", table)
    base, hand, mask = cells[:3], cells[3:6], cells[6:]
    assert (base, hand, mask) == (["95", "·", "95"], ["7", "·", "7"], ["88", "·", ""])
    assert "5 % on an edge, 50 % told from the background, no edge" in table
    assert "edges +1.2 px out" in table
    # Of each view its own notes.
    views = text.split('<article class="card view"')[1:]
    assert ["hardly agrees" in view for view in views] == [True, False, False, False]
    assert ["out of view" in view for view in views] == [False, True, False, False]
    assert Page(text).ids
    assert "agreement" not in page(solved()).ids


def test_the_notes_are_part_of_the_record():
    assert "masks: as asked" in page(changed(notes=["masks: as asked"])).text
