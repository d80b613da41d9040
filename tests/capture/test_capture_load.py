from __future__ import annotations

import json

import numpy as np
import pytest

from easyhecpp.capture import Capture, View, check_capture
from easyhecpp.capture.image_data import ArrayCache, read_image
from easyhecpp.errors import InputError


@pytest.mark.parametrize(
    ("name", "n_views", "joints", "base", "has_depth"),
    [
        ("xarm7_realsense", 10, [f"joint{i}" for i in range(1, 8)], "link_base", True),
        ("lbr_med7_realsense", 11, [f"lbr_A{i}" for i in range(1, 8)], "lbr_link_0", False),
    ],
)
def test_real_captures_load_without_a_remark(shared, name, n_views, joints, base, has_depth):
    capture = Capture.load(shared / "captures" / name)
    assert capture.name == name
    assert capture.notes == ()
    assert capture.view_ids == tuple(f"{i:04d}" for i in range(n_views))
    assert list(capture.robot.joint_names) == joints
    assert capture.rig.mount == base
    assert (capture.camera.width, capture.camera.height) == (1280, 720)
    assert capture.camera.fx == 908.3020629882812
    view = capture.view("0007")
    assert view.image.shape == (720, 1280, 3)
    assert view.image.dtype == np.uint8
    assert view.mask.dtype == bool
    assert 0.01 < view.mask.mean() < 0.6
    assert view.has_depth is has_depth
    if has_depth:
        seen = view.depth[view.mask & (view.depth > 0)]
        assert 0.3 < np.median(seen) < 3.0
    line = (shared / "captures" / name / "joints.csv").read_text().splitlines()[8].split(",")
    assert line[0] == "0007"
    np.testing.assert_array_equal(view.joints, [float(cell) for cell in line[1:]])


@pytest.mark.parametrize("name", ["xarm7_realsense", "lbr_med7_realsense"])
def test_real_captures_check_clean(shared, name):
    assert check_capture(shared / "captures" / name) == []


def test_columns_are_matched_by_name_in_any_order(folder):
    expected = Capture.load(folder.root).view("0001").joints
    folder.table(header=["view", "joint3", "lift", "joint2", "joint1"])
    capture = Capture.load(folder.root)
    np.testing.assert_array_equal(capture.view("0001").joints, expected)
    index = capture.robot.joint_names.index("joint2")
    assert capture.view("0001").joints[index] == folder.positions["0001"]["joint2"]


def test_image_file_names_as_view_names(folder):
    rows = [[f"{v}.png", *folder.positions[v].values()] for v in folder.views]
    folder.table(rows=rows)
    assert Capture.load(folder.root).view_ids == folder.views


def test_fingers_without_a_column_go_to_the_middle_and_are_said_once(folder):
    capture = Capture.load(folder.root)
    index = capture.robot.joint_names.index("finger_joint")
    assert [view.joints[index] for view in capture.views] == [0.02] * 3
    assert [note for note in capture.notes if "finger_joint" in note] == [
        "No column for finger_joint: held at the middle of the range. Give their positions under "
        "'default_joints' in capture.yaml if you know them."
    ]


def test_default_joints_take_the_place_of_columns(folder):
    folder.config(default_joints={"finger_joint": 0.035})
    capture = Capture.load(folder.root)
    assert capture.views[0].joints[capture.robot.joint_names.index("finger_joint")] == 0.035
    assert not any("finger_joint" in note for note in capture.notes)


def test_a_joint_that_moves_nothing_drawn_needs_neither_column_nor_note(folder):
    folder.config(ignore_links=["finger"])
    assert Capture.load(folder.root).notes == ()


def test_degrees_are_of_turning_joints_only(folder):
    folder.config(joint_units="deg", default_joints={"finger_joint": 0.01})
    rows = [[v, 0.2, 90.0 + i, -45.0, 300.0] for i, v in enumerate(folder.views)]
    folder.table(rows=rows)
    joints = Capture.load(folder.root).view("0001").joints
    np.testing.assert_allclose(joints, [0.2, *np.radians([91.0, -45.0, 300.0]), 0.01])


def test_radians_declared_as_degrees_are_suspected(folder):
    folder.config(joint_units="deg")
    assert any("looks like radians" in note for note in Capture.load(folder.root).notes)


def test_extra_columns_are_noted_and_may_hold_texts(folder):
    rows = [[v, *folder.positions[v].values(), "12:00:01"] for v in folder.views]
    folder.table(["view", "lift", "joint1", "joint2", "joint3", "stamp"], rows)
    notes = Capture.load(folder.root).notes
    assert any("Columns that are no joint of the robot are not used: stamp" in n for n in notes)


def test_joints_a_little_beyond_their_limits_are_a_warning(folder):
    folder.positions["0001"]["joint2"] = 2.3
    folder.table()
    notes = Capture.load(folder.root).notes
    assert any(
        "'joint2' reaches 2.3, beyond its limits of -2 to 2, in view 0001" in n for n in notes
    )
    folder.positions["0001"]["joint2"] = 2.01
    folder.table()
    assert not any("joint2" in n for n in Capture.load(folder.root).notes)


def test_a_joint_without_limits_may_be_wound_up(folder):
    folder.positions["0001"]["joint3"] = 7.5
    folder.table()
    capture = Capture.load(folder.root)
    assert capture.view("0001").joints[3] == 7.5
    assert not any("joint3" in note for note in capture.notes)


def test_another_branch_that_is_not_measured_is_a_warning(folder):
    urdf = folder.root / "robot" / "robot.urdf"
    branch = """<link name="head"><visual><geometry><box size="0.1 0.1 0.1"/></geometry></visual>
      </link>
      <joint name="head_pan" type="revolute"><parent link="base"/><child link="head"/>
        <limit lower="-1" upper="2" effort="1" velocity="1"/></joint>
    </robot>"""
    urdf.write_text(urdf.read_text().replace("</robot>", branch))
    capture = Capture.load(folder.root)
    assert capture.views[0].joints[capture.robot.joint_names.index("head_pan")] == 0.5
    (warning,) = (p for p in check_capture(folder.root) if p.severity == "warning")
    assert "No column for head_pan, which move parts of the robot" in warning.what
    assert "ignore_links" in warning.fix


def test_settings_of_capture_yaml_are_followed(folder):
    (folder.root / "images").rename(folder.root / "rgb")
    (folder.root / "joints.csv").rename(folder.root / "q.csv")
    (folder.root / "camera_info.yaml").unlink()
    info = {k: v for k, v in folder.topic_dump().items() if k != "frame_id"}
    (folder.root / "intrinsics.json").write_text(json.dumps(info))
    (folder.root / "robot").rename(folder.root / "arm")
    folder.config(
        setup="eye-in-hand",
        ee_link="camera_mount",
        base_link="world",
        robot="arm/robot.urdf",
        images="rgb",
        joints="q.csv",
        camera_info="intrinsics.json",
        ignore_links=["finger"],
    )
    capture = Capture.load(folder.root)
    assert capture.rig.mount == "camera_mount"
    assert capture.robot.base_link == "world"
    assert "finger" not in capture.robot.link_names
    assert capture.camera.frame == "camera_color_optical_frame"
    assert capture.views[0].image.shape == (48, 64, 3)


def test_robot_of_a_package(folder, tmp_path):
    package = tmp_path / "ws" / "tiny_description"
    package.parent.mkdir()
    (folder.root / "robot").rename(package)
    folder.config(robot="package://tiny_description/robot.urdf", package_dirs=["../ws"])
    assert Capture.load(folder.root).robot.name == "tiny"


def test_empty_capture_yaml_means_defaults(folder):
    (folder.root / "capture.yaml").write_text("# nothing yet\n")
    assert Capture.load(folder.root).setup == "eye-to-hand"


def test_masks_and_images_are_optional_one_at_a_time(folder):
    for path in (folder.root / "images").iterdir():
        path.unlink()
    capture = Capture.load(folder.root)
    assert capture.views[0].image is None
    assert capture.views[0].has_mask
    assert any("only masks" in note for note in capture.notes)


def test_views_without_a_mask_are_noted(folder):
    (folder.root / "masks" / "0001.png").unlink()
    capture = Capture.load(folder.root)
    assert [view.has_mask for view in capture.views] == [True, False, True]
    assert any("1 view without a mask: 0001" in note for note in capture.notes)


def test_subset_keeps_the_given_order_and_refuses_unknown_views(folder):
    capture = Capture.load(folder.root)
    assert capture.subset(["0002", "0000"]).view_ids == ("0002", "0000")
    with pytest.raises(InputError, match=r"no view '002'.*0000, 0001, 0002.*Did you mean '0002'"):
        capture.subset(["002"])


def test_not_strict_leaves_out_what_is_broken_and_says_so(folder):
    (folder.root / "images" / "0000.png").write_bytes(b"no image")
    (folder.root / "masks" / "0001.png").write_bytes(b"")
    capture = Capture.load(folder.root, strict=False)
    assert capture.view_ids == ("0001", "0002")
    assert not capture.view("0001").has_mask
    left_out = [note for note in capture.notes if note.startswith("Left out: ")]
    assert len(left_out) == 2
    assert "0000.png" in left_out[0]


def test_not_strict_still_refuses_what_concerns_all_views(folder):
    (folder.root / "camera_info.yaml").unlink()
    with pytest.raises(InputError, match="no camera_info file"):
        Capture.load(folder.root, strict=False)


def test_pictures_are_read_when_asked_for_and_read_only(folder):
    capture = Capture.load(folder.root)
    image = capture.views[0].image
    assert capture.views[0].image is image
    with pytest.raises(ValueError, match="read-only"):
        image[0, 0] = 0
    np.testing.assert_array_equal(image[15, 12], (200, 120, 30))


def test_a_changed_file_is_read_again(folder):
    capture = Capture.load(folder.root)
    before = capture.views[0].image
    folder.image("0000.png", np.zeros((48, 64, 3), np.uint8))
    assert before.any()
    assert not capture.views[0].image.any()


def test_cache_stays_within_its_limit(folder):
    size = 48 * 64 * 3
    cache = ArrayCache(2 * size)
    paths = sorted((folder.root / "images").iterdir())
    arrays = [cache.get(path, read_image) for path in paths]
    assert cache.held_bytes == 2 * size
    assert cache.get(paths[2], read_image) is arrays[2]
    again = cache.get(paths[0], read_image)
    assert again is not arrays[0]
    np.testing.assert_array_equal(again, arrays[0])


def test_view_from_arrays_and_its_refusals():
    view = View("a", [0.1, 0.2], image=np.zeros((4, 6, 3), np.uint8), mask=np.eye(4))
    assert view.mask.dtype == bool
    assert view.mask.sum() == 4
    assert repr(view) == "View('a', 2 joints, image + mask)"
    with pytest.raises(AttributeError):
        view.id = "b"
    with pytest.raises(InputError, match=r"joints of view 'a'.*finite numbers"):
        View("a", [np.nan])
    with pytest.raises(InputError, match=r"shape \(4, 6\).*\(height, width, 3\)"):
        View("a", [0.0], image=np.zeros((4, 6), np.uint8))
    with pytest.raises(InputError, match=r"array of float64.*uint8"):
        View("a", [0.0], image=np.zeros((4, 6, 3)))


def test_capture_in_memory_checks_its_views(folder):
    loaded = Capture.load(folder.root)

    def capture(*views: View) -> Capture:
        return Capture("memory", None, "eye-to-hand", loaded.robot, loaded.camera, views)

    q = loaded.views[0].joints
    assert capture(View("a", q), View("b", q)).view_ids == ("a", "b")
    with pytest.raises(InputError, match="more than once: a"):
        capture(View("a", q), View("a", q))
    with pytest.raises(InputError, match=r"'a' has 2 joint positions.*5: lift, joint1"):
        capture(View("a", q[:2]))
    with pytest.raises(InputError, match="mask of view 'a' is 6x4 pixels, the camera 64x48"):
        capture(View("a", q, mask=np.ones((4, 6), bool)))
