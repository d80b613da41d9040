from __future__ import annotations

import socket
import sys
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from report_case import result_of, solved, without_pose

from easyhecpp.cli.commands.view import View as ViewCommand
from easyhecpp.errors import InputError, MissingExtraError
from easyhecpp.geometry import make_transform, matrix_from_quat_wxyz
from easyhecpp.report.viewer import PoseViewer


@pytest.fixture
def port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.fixture
def viewer(port: int) -> Iterator[PoseViewer]:
    pytest.importorskip("viser", reason="the viewer needs the extra 'view'")
    viewer = PoseViewer(solved().result, solved().capture, port=port)
    yield viewer
    viewer.stop()


def pose_of(handle) -> np.ndarray:
    return make_transform(matrix_from_quat_wxyz(np.asarray(handle.wxyz)), handle.position)


def test_the_arm_and_the_picture_follow_the_view(viewer, port):
    capture = solved().capture
    assert viewer.url == f"http://localhost:{port}"
    for view in capture.views[:2]:
        viewer.show(view.id)
        for handle, T in zip(viewer._links, capture.robot.link_poses(view.joints), strict=True):
            np.testing.assert_allclose(pose_of(handle), T, atol=1e-6)
        np.testing.assert_array_equal(viewer._frustum.image, view.image)
    with pytest.raises(InputError, match="no view '9'"):
        viewer.show("9")


def test_the_camera_is_where_the_result_says(viewer):
    np.testing.assert_allclose(pose_of(viewer._rider), viewer._T_mount_cam, atol=1e-6)


def test_a_camera_on_the_wrist_rides_along(port):
    pytest.importorskip("viser", reason="the viewer needs the extra 'view'")
    case = solved()
    assert case.estimate is not None
    capture = replace(case.capture, setup="eye-in-hand", ee_link="hand")
    T_ee_cam = np.eye(4)
    T_ee_cam[:3, 3] = 0.05, 0.0, 0.1
    viewer = PoseViewer(result_of(capture, case.estimate, T_mount_cam=T_ee_cam), capture, port=port)
    try:
        for view in capture.views[:2]:
            viewer.show(view.id)
            T_base_cam = capture.robot.frame_pose(view.joints, "hand") @ T_ee_cam
            np.testing.assert_allclose(pose_of(viewer._rider), T_base_cam, atol=1e-6)
    finally:
        viewer.stop()


def test_a_port_in_use_is_named(viewer, port):
    with pytest.raises(InputError, match=rf"Port {port} is in use.*--port"):
        PoseViewer(solved().result, solved().capture, port=port)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"port": 0}, "no port 0"),
        ({"port": 70000}, "no port 70000"),
        ({"host": "192.0.2.1"}, "Cannot listen"),
        ({"host": "no such host"}, "not known"),
    ],
)
def test_an_address_that_cannot_be_had_is_named(options, words, port):
    pytest.importorskip("viser", reason="the viewer needs the extra 'view'")
    with pytest.raises(InputError, match=words):
        PoseViewer(solved().result, solved().capture, **{"port": port, **options})


def test_a_result_without_a_pose_or_of_another_mount_is_refused(port):
    pytest.importorskip("viser", reason="the viewer needs the extra 'view'")
    with pytest.raises(InputError, match="holds no pose"):
        PoseViewer(without_pose().result, solved().capture, port=port)
    wrist = replace(solved().capture, setup="eye-in-hand", ee_link="hand")
    with pytest.raises(InputError, match=r"camera on 'base'.*on 'hand'"):
        PoseViewer(solved().result, wrist, port=port)


def test_without_viser_the_extra_is_named(monkeypatch, port):
    monkeypatch.setitem(sys.modules, "viser", None)
    with pytest.raises(MissingExtraError, match=r"easyhecpp\[view\]"):
        PoseViewer(solved().result, solved().capture, port=port)


def test_without_a_display_the_address_is_given(viewer, monkeypatch):
    monkeypatch.setattr("webbrowser.open", lambda url: False)
    with pytest.raises(InputError, match=r"no display .*ssh -L") as caught:
        viewer.open_browser()
    assert viewer.url in str(caught.value)


def test_the_command_serves_until_it_is_interrupted(monkeypatch, tmp_path, capsys, port):
    pytest.importorskip("viser", reason="the viewer needs the extra 'view'")
    solved().result.write(tmp_path / "result.json")

    def interrupted(self: PoseViewer) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("easyhecpp.capture.Capture.load", lambda folder: solved().capture)
    monkeypatch.setattr(PoseViewer, "wait", interrupted)
    command = ViewCommand(tmp_path, tmp_path / "result.json", port=port)
    assert command.run("easyhecpp view") == 0
    assert f"http://localhost:{port}" in capsys.readouterr().out
    with socket.socket() as probe:  # and lets go of the port
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        probe.bind(("127.0.0.1", port))
