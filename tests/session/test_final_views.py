"""What is said about each view belongs to the pose that is handed out."""

from __future__ import annotations

import numpy as np
import pytest
from scenes_small import photographed

from easyhecpp import Capture, calibrate
from easyhecpp.capture import View
from easyhecpp.geometry import inverse
from easyhecpp.render import SilhouetteRenderer
from easyhecpp.session import CalibrationConfig


def test_views_are_described_at_the_pose_of_the_edge_stage() -> None:
    case = photographed(3, n_views=6)
    views = tuple(
        View(f"{i}", q, image=image)
        for i, (q, image) in enumerate(zip(case.joints, case.images, strict=True))
    )
    capture = Capture("cell", None, "eye-to-hand", case.rig.robot, case.camera, views)
    found = calibrate(capture, CalibrationConfig(segmenter="classical"))
    renderer = SilhouetteRenderer(case.rig.robot.meshes, case.camera)
    for view, said in zip(views, found.result.views, strict=True):
        rendered = renderer.coverage(
            inverse(found.T_mount_cam) @ case.rig.Ts_mount_link(view.joints)
        )
        made = np.asarray(found.masks[view.id]) > 0.5
        overlap = ((rendered > 0.5) & made).sum() / ((rendered > 0.5) | made).sum()
        assert said.iou == pytest.approx(overlap, abs=0.01)
        # No view of a good recording is a surprise to the others.
        assert said.prediction_px is not None
        assert 0.0 < said.prediction_px < 2.0
