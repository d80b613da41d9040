"""A view out of which the pose puts the arm takes no part, and the calibration goes on."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from scenes_small import photographed

from easyhecpp import Capture, calibrate
from easyhecpp.capture import View
from easyhecpp.segment.classical import calibrate_from_images, segmenter
from easyhecpp.segment.classical.masks import NO_ARM
from easyhecpp.session import CalibrationConfig
from easyhecpp.session.save import save


@pytest.mark.parametrize("edges", [True, False])
def test_a_view_without_the_arm_neither_fails_nor_ends_a_calibration(
    monkeypatch: pytest.MonkeyPatch, edges: bool
) -> None:
    case = photographed(3, n_views=6)
    views = tuple(
        View(f"{i}", q, image=image)
        for i, (q, image) in enumerate(zip(case.joints, case.images, strict=True))
    )
    capture = Capture("cell", None, "eye-to-hand", case.rig.robot, case.camera, views)
    whole = segmenter.masks_at

    def without_one(*given):
        masks = whole(*given)
        masks[2] = replace(masks[2], mask=None, ignore=None)
        return masks

    monkeypatch.setattr(segmenter, "masks_at", without_one)
    found = calibrate(capture, CalibrationConfig(segmenter="classical", edges=edges))
    assert found.result.verdict == "ok"
    assert "View 2 shows nothing of the arm and says nothing." in found.result.reasons
    assert [view.id for view in found.result.views] == list(capture.view_ids)


def test_a_view_with_joints_of_another_picture_gets_no_mask_of_the_prediction(
    tmp_path: Path,
) -> None:
    case = photographed(3, n_views=8)
    joints = list(case.joints)
    joints[5] = joints[0] + 0.9
    found = calibrate_from_images(case.rig, case.camera, case.images, joints)
    assert [mask.mask is None for mask in found.masks] == [i == 5 for i in range(8)]
    assert found.masks[5].notes == (NO_ARM,)
    views = tuple(
        View(f"{i}", q, image=image)
        for i, (q, image) in enumerate(zip(joints, case.images, strict=True))
    )
    capture = Capture("cell", None, "eye-to-hand", case.rig.robot, case.camera, views)
    whole = calibrate(capture, CalibrationConfig(segmenter="classical"))
    assert any(r.startswith("View 5 does not show the arm where") for r in whole.result.reasons)
    assert "hidden" in whole.result.views[5].flags
    save(whole, tmp_path)  # the report copes with a view that has nothing to show
