"""A view out of which the pose puts the arm takes no part, and the calibration goes on."""

from __future__ import annotations

from dataclasses import replace

import pytest
from scenes_small import photographed

from easyhecpp import Capture, calibrate
from easyhecpp.capture import View
from easyhecpp.segment.classical import calibrate as classical
from easyhecpp.session import CalibrationConfig


def test_a_view_without_the_arm_neither_fails_nor_ends_a_calibration(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    case = photographed(3, n_views=6)
    views = tuple(
        View(f"{i}", q, image=image)
        for i, (q, image) in enumerate(zip(case.joints, case.images, strict=True))
    )
    capture = Capture("cell", None, "eye-to-hand", case.rig.robot, case.camera, views)
    whole = classical.masks_at

    def without_one(*given):
        masks = whole(*given)
        masks[2] = replace(masks[2], mask=None, ignore=None)
        return masks

    monkeypatch.setattr(classical, "masks_at", without_one)
    found = calibrate(capture, CalibrationConfig(segmenter="classical"))
    assert found.result.verdict == "ok"
    assert "View 2 shows nothing of the arm and says nothing." in found.result.reasons
    assert [view.id for view in found.result.views] == list(capture.view_ids)
