from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest
from report_case import solved

from easyhecpp.camera import Camera
from easyhecpp.capture import Capture, View
from easyhecpp.errors import InputError
from easyhecpp.geometry import inverse, look_at
from easyhecpp.report.overlay import ARM, MASK, draw_overlay, write_overlays
from easyhecpp.robot import Robot

SIZE = (0.3, 0.2, 0.4)
BOX = f"""<robot name="box"><link name="base"><visual><geometry>
<box size="{SIZE[0]} {SIZE[1]} {SIZE[2]}"/></geometry></visual></link></robot>"""


@pytest.fixture(scope="module")
def box(tmp_path_factory: pytest.TempPathFactory) -> Capture:
    """A robot that is a box, seen by a camera with a bent lens; the picture is black."""
    path = tmp_path_factory.mktemp("box") / "robot.urdf"
    path.write_text(BOX)
    robot = Robot.from_urdf(path)
    camera = Camera(
        320, 240, 300.0, 305.0, 158.0, 121.0, "plumb_bob", (-0.12, 0.03, 0.001, -0.002, 0.0)
    )
    view = View("0", np.zeros(robot.n_joints), np.zeros((240, 320, 3), np.uint8))
    return Capture("box", None, "eye-to-hand", robot, camera, (view,))


T_BASE_CAM = look_at((1.0, 0.5, 0.4), (0.0, 0.0, 0.0))


def box_edges(camera: Camera) -> np.ndarray:
    """Pixels along the silhouette of the box, by OpenCV's projection and a convex hull."""
    corners = np.array(np.meshgrid([-0.5, 0.5], [-0.5, 0.5], [-0.5, 0.5])).reshape(3, -1).T * SIZE
    T = inverse(T_BASE_CAM)
    vector, lens = cv2.Rodrigues(T[:3, :3])[0], np.array(camera.distortion)

    def project(points: np.ndarray) -> np.ndarray:
        return cv2.projectPoints(points, vector, T[:3, 3], camera.K, lens)[0][:, 0]

    hull = cv2.convexHull(project(corners).astype(np.float32), returnPoints=False)[:, 0]
    ring = corners[[*hull, hull[0]]]
    share = np.linspace(0, 1, 60)[:, None]
    along = [a + share * (b - a) for a, b in pairwise(ring)]
    return project(np.concatenate(along))


def written(folder: Path, capture: Capture, **options) -> np.ndarray:
    (path,) = write_overlays(folder, capture, T_BASE_CAM, **options)
    assert path == folder / f"{capture.views[0].id}.jpg"
    return cv2.imread(str(path))[..., ::-1].astype(int)


def test_the_line_lies_on_the_silhouette_that_opencv_projects(box, tmp_path):
    picture = written(tmp_path, box)
    line = np.abs(picture - ARM).sum(axis=2) < 160
    edges = box_edges(box.camera)
    x, y = np.rint(edges).astype(int).T
    near = cv2.dilate(line.astype(np.uint8), np.ones((3, 3))) > 0
    assert near[y, x].mean() > 0.99
    # And nowhere else.
    distance = np.linalg.norm(np.argwhere(line)[:, None, ::-1] - edges, axis=2).min(axis=1)
    assert distance.max() < 1.8
    assert distance.mean() < 0.6


def test_a_mask_is_drawn_in_the_second_colour(box, tmp_path):
    mask = np.zeros((240, 320), bool)
    mask[30:60, 40:90] = True
    picture = written(tmp_path, box, masks={"0": mask})
    line = np.abs(picture - MASK).sum(axis=2) < 160
    assert line[29:31, 50:80].any(axis=0).all()
    assert not line[100:].any()


@pytest.mark.parametrize("colour", [(0, 0, 0), (255, 255, 255), ARM, MASK, (200, 120, 30)])
def test_the_lines_show_on_any_background(colour):
    image = np.full((80, 120, 3), colour, np.uint8)
    covered = np.zeros((80, 120), np.float32)
    covered[20:60, 30:90] = 1.0
    drawn = draw_overlay(image, covered).astype(int)
    # The strongest change across the line, at every row that it passes.
    change = np.abs(drawn - image).sum(axis=2)[25:55, 26:34].max(axis=1)
    assert change.min() > 150


def test_the_picture_itself_is_not_drawn_on(box):
    image = np.zeros((240, 320, 3), np.uint8)
    draw_overlay(image, np.ones((240, 320), np.float32))
    assert not image.any()


def test_views_without_a_picture_are_passed_over_and_ids_choose(tmp_path):
    case = solved()
    views = (replace_image(case.capture.views[0]), *case.capture.views[1:])
    capture = replace(case.capture, views=views)
    names = [p.name for p in write_overlays(tmp_path / "a", capture, case.T_base_cam)]
    assert names == ["0001.jpg", "0002.jpg", "0003.jpg"]
    names = [p.name for p in write_overlays(tmp_path / "b", capture, case.T_base_cam, ["0002"])]
    assert names == ["0002.jpg"] == [p.name for p in (tmp_path / "b").iterdir()]


def replace_image(view: View) -> View:
    return View(view.id, view.joints, None, view.mask)


@pytest.mark.parametrize(
    "pose", [np.eye(3), np.diag([2.0, 1, 1, 1]), np.diag([-1.0, 1, 1, 1]), np.full((4, 4), np.nan)]
)
def test_a_pose_that_is_none_is_refused(box, tmp_path, pose):
    with pytest.raises(InputError, match="no rigid transform"):
        write_overlays(tmp_path, box, pose)
    assert list(tmp_path.iterdir()) == []


def test_an_unknown_view_and_an_unwritable_folder_are_named(box, tmp_path):
    with pytest.raises(InputError, match="no view '7'"):
        write_overlays(tmp_path, box, T_BASE_CAM, ["7"])
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="Cannot write"):
        write_overlays(tmp_path / "file", box, T_BASE_CAM)
