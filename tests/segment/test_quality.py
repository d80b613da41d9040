from __future__ import annotations

import numpy as np
from scenes_small import photographed

from easyhecpp.segment.backgrounds import Backgrounds
from easyhecpp.segment.edge_reading import EdgeReader
from easyhecpp.segment.quality import assess
from easyhecpp.segment.scene import Scene


def _assess(joints):
    case = photographed(0)
    scene = Scene(case.rig, case.camera, joints)
    reader = EdgeReader(Backgrounds(scene, case.images, case.T_mount_cam))
    readings = reader.read(case.T_mount_cam, 6.0)
    return assess(readings, [f"v{i}" for i in range(len(joints))], case.rig.robot.link_names)


def test_views_that_agree_are_trusted():
    quality = _assess(photographed(0).joints)
    assert [q.view_id for q in quality] == ["v0", "v1", "v2", "v3", "v4"]
    for view in quality:
        assert view.weight > 0.9
        assert view.edge > 0.7
        assert not view.notes
        assert all(0.0 <= link.score <= 1.0 for link in view.links)
        assert {link.link for link in view.links} <= set(photographed(0).rig.robot.link_names)


def test_a_view_whose_joints_belong_to_another_picture_loses_its_weight():
    joints = list(photographed(0).joints)
    joints[2] = joints[2] + np.array([0.3, -0.25, 0.3, 0.2])
    quality = _assess(joints)
    assert quality[2].weight < 0.6
    assert any("joints belong to this picture" in note for note in quality[2].notes)
    assert min(q.weight for i, q in enumerate(quality) if i != 2) > quality[2].weight


def test_a_picture_without_the_outline_has_no_weight():
    case = photographed(0)
    scene = Scene(case.rig, case.camera, case.joints)
    reader = EdgeReader(Backgrounds(scene, case.images, case.T_mount_cam))
    readings = reader.read(case.T_mount_cam, 6.0, spacing_px=1e6)
    quality = assess(readings, ["a"] * 5, case.rig.robot.link_names)
    assert all(q.weight == 0.0 and "not visible" in q.notes[0] for q in quality)
