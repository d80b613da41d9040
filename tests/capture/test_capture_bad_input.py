"""Every kind of bad input gives one clear error, the same from loading and from checking."""

from __future__ import annotations

import shutil

import cv2
import numpy as np
import pytest

from easyhecpp.capture import Capture, check_capture
from easyhecpp.errors import InputError


def no_images(f):
    shutil.rmtree(f.root / "images")
    shutil.rmtree(f.root / "masks")


def empty_images(f):
    for name in ("images", "masks"):
        for path in (f.root / name).iterdir():
            path.unlink()


def bitmap_images(f):
    for path in (f.root / "images").iterdir():
        path.rename(path.with_suffix(".bmp"))
    shutil.rmtree(f.root / "masks")


def truncate(path, share=0.6):
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * share)])


def truncated_jpeg(f):
    pixels = cv2.imread(str(f.root / "images" / "0001.png"))
    (f.root / "images" / "0001.png").unlink()
    path = f.root / "images" / "0001.jpg"
    cv2.imwrite(str(path), pixels)
    truncate(path, 0.9)


def cell(f, view, joint, value):
    f.positions[view][joint] = value
    f.table()


def rows(f, *changed):
    base = [[v, *f.positions[v].values()] for v in f.views]
    f.table(rows=[*base, *changed])


def lines(f, edit):
    path = f.root / "joints.csv"
    path.write_text("\n".join(edit(path.read_text().splitlines())) + "\n")


def mask(f, value):
    f.image("0002.png", np.full((48, 64), value, np.uint8), folder="masks")


CASES = {
    "no images": (no_images, ["There is no folder of images", "images: FOLDER"]),
    "empty images": (empty_images, ["folder of images holds no image", "PNG or JPEG"]),
    "bitmaps": (bitmap_images, ["holds no image"]),
    "text as image": (
        lambda f: (f.root / "images" / "0001.png").write_text("hello"),
        ["not an image", "0001.png", "a PNG or JPEG file", "delete it"],
    ),
    "image of no bytes": (
        lambda f: (f.root / "images" / "0001.png").write_bytes(b""),
        ["image file is empty", "0001.png"],
    ),
    "truncated png": (
        lambda f: truncate(f.root / "images" / "0001.png"),
        ["truncated or damaged", "0001.png", "Copy or record it again"],
    ),
    "truncated jpeg": (truncated_jpeg, ["truncated or damaged", "0001.jpg"]),
    "image that is a folder": (
        lambda f: [
            (f.root / "images" / "0001.png").unlink(),
            (f.root / "images" / "0001.png").mkdir(),
        ],
        ["cannot be read", "0001.png"],
    ),
    "truncated mask": (
        lambda f: truncate(f.root / "masks" / "0001.png"),
        ["truncated or damaged", "masks", "0001.png"],
    ),
    "text as depth": (
        lambda f: [(f.root / "depth").mkdir(), (f.root / "depth" / "0000.png").write_text("x")],
        ["not an image", "depth"],
    ),
    "coloured depth": (
        lambda f: f.image("0000.png", np.zeros((48, 64, 3), np.uint8), folder="depth"),
        ["depth image has 8 bits and 3 channels", "16-bit grey, in millimetres"],
    ),
    "images of another size": (
        lambda f: [f.image(f"{v}.png", np.full((24, 32, 3), 9, np.uint8)) for v in f.views],
        ["image of views 0000, 0001, 0002 is 32x24 pixels, the camera 64x48", "scaled by 0.5"],
    ),
    "one image of another size": (
        lambda f: f.image("0001.png", np.full((48, 60, 3), 9, np.uint8)),
        ["image of view 0001 is 60x48 pixels, the camera 64x48", "same resolution"],
    ),
    "turned images": (
        lambda f: [f.image(f"{v}.png", np.full((64, 48, 3), 9, np.uint8)) for v in f.views],
        ["48x64", "turned by 90 degrees"],
    ),
    "mask of another size": (
        lambda f: f.image("0001.png", np.eye(30, dtype=np.uint8) * 255, folder="masks"),
        ["mask of view 0001 is 30x30 pixels, the camera 64x48", "pixel for pixel"],
    ),
    "depth of another size": (
        lambda f: f.image("0001.png", np.ones((30, 30), np.uint16), folder="depth"),
        ["depth image of view 0001 is 30x30 pixels"],
    ),
    "empty mask": (lambda f: mask(f, 0), ["mask of view '0002' is empty", "Delete the file"]),
    "full mask": (lambda f: mask(f, 255), ["mask of view '0002' is all arm", "Delete the file"]),
    "two images": (
        lambda f: f.image("0001.jpg", np.full((48, 64, 3), 99, np.uint8)),
        ["View '0001' has two images: 0001.jpg and 0001.png"],
    ),
    "no table": (
        lambda f: (f.root / "joints.csv").unlink(),
        ["no table of joint positions", "joints.csv", "header 'view,JOINT", "joints: FILE"],
    ),
    "empty table": (
        lambda f: (f.root / "joints.csv").write_text("\n\n"),
        ["table of joints is empty"],
    ),
    "binary table": (
        lambda f: (f.root / "joints.csv").write_bytes(b"\xff\xfe\x00\x01view"),
        ["table of joints cannot be read"],
    ),
    "header only": (lambda f: lines(f, lambda t: t[:1]), ["table of joints has no rows"]),
    "semicolons": (
        lambda f: lines(f, lambda t: [line.replace(",", ";") for line in t]),
        ["not separated by commas"],
    ),
    "no view column": (
        lambda f: lines(f, lambda t: ["frame" + t[0][4:], *t[1:]]),
        ["no column 'view'", "its header is frame, lift, joint1", "Name the column"],
    ),
    "column twice": (
        lambda f: f.table(["view", "lift", "joint1", "joint1", "joint2", "joint3"]),
        ["Column joint1 stands more than once"],
    ),
    "short row": (
        lambda f: lines(f, lambda t: [*t[:2], t[2].rsplit(",", 1)[0], *t[3:]]),
        ["row of view '0001' has 4 cells, the header 5", "line 3"],
    ),
    "row without a view": (lambda f: rows(f, ["", 0, 0, 0, 0]), ["row names no view", "line 5"]),
    "view twice": (
        lambda f: rows(f, ["0001", 0.1, 0, 0, 0]),
        ["View '0001' has a second row; its first is in line 3", "line 5"],
    ),
    "text in a cell": (
        lambda f: cell(f, "0001", "joint2", "0;5"),
        ["'0;5' in column 'joint2', view '0001', is not a finite number", "line 3"],
    ),
    "nan": (
        lambda f: cell(f, "0001", "joint2", "nan"),
        ["'nan' in column 'joint2', view '0001', is not a finite number"],
    ),
    "infinity": (
        lambda f: cell(f, "0002", "lift", "-inf"),
        ["'-inf' in column 'lift', view '0002', is not a finite number"],
    ),
    "empty cell": (
        lambda f: cell(f, "0000", "joint1", ""),
        ["cell in column 'joint1', view '0000', is empty", "line 2"],
    ),
    "degrees": (
        lambda f: cell(f, "0001", "joint1", 85.3),
        ["Joint 'joint1' is 85.3 in view '0001'", "these are degrees", "joint_units: deg"],
    ),
    "misspelt joint": (
        lambda f: f.table(["view", "lift", "joint_1", "joint2", "joint3"]),
        [
            "no column for joint1",
            "no joint of the robot: joint_1",
            "lift, joint1, joint2, joint3, finger_joint",
            "Rename 'joint_1' to 'joint1'",
        ],
    ),
    "misspelt finger": (
        lambda f: f.table(["view", "lift", "joint1", "joint2", "joint3", "fingerjoint"]),
        ["no column for finger_joint", "Rename 'fingerjoint' to 'finger_joint'"],
    ),
    "arm joint left out": (
        lambda f: f.table(["view", "lift", "joint1", "joint3"]),
        ["no column for joint2", "no joint of the robot: none", "'default_joints'"],
    ),
    "first joint left out": (
        lambda f: f.table(["view", "joint1", "joint2", "joint3"]),
        ["no column for lift"],
    ),
    "last joint left out": (
        lambda f: f.table(["view", "lift", "joint1", "joint2"]),
        ["no column for joint3"],
    ),
    "another robot's joints": (
        lambda f: f.table(["view", "panda_a", "panda_b"]),
        ["no column for lift, joint1", "no joint of the robot: panda_a, panda_b"],
    ),
    "rows without images": (
        lambda f: rows(f, ["0005", 0.1, 0, 0, 0], ["0006", 0.1, 0, 0, 0]),
        ["2 views with a row in joints.csv but without an image: 0005, 0006"],
    ),
    "images without rows": (
        lambda f: lines(f, lambda t: t[:2]),
        ["2 views with an image but without a row in joints.csv: 0001, 0002", "Add the rows"],
    ),
    "zeros eaten": (
        lambda f: f.table(rows=[[v.lstrip("0") or "0", 0.1, 0, 0, 0] for v in f.views]),
        ["Views in joints.csv lack the leading zeros of their files: 0, 1, 2", "'0' is '0000'"],
    ),
    "no camera": (
        lambda f: (f.root / "camera_info.yaml").unlink(),
        ["There is no camera_info file", "ros2 topic echo", "camera_info: FILE"],
    ),
    "no robot": (
        lambda f: (f.root / "robot" / "robot.urdf").unlink(),
        ["There is no robot description", "robot.urdf", "robot: FILE"],
    ),
    "robot of an unknown package": (
        lambda f: f.config(robot="package://nowhere/arm.urdf", package_dirs=["pkg"]),
        ["no robot description 'package://nowhere/arm.urdf'; looked for at", "package_dirs"],
    ),
    "robot that is no urdf": (
        lambda f: (f.root / "robot" / "robot.urdf").write_text("<sdf/>"),
        ["not a URDF"],
    ),
    "unknown default joint": (
        lambda f: f.config(default_joints={"finger_jont": 0.01}),
        ["'finger_jont', which is no joint", "Did you mean 'finger_joint'?"],
    ),
    "unknown key": (
        lambda f: f.config(joint_unit="deg"),
        ["unknown key in capture.yaml: joint_unit", "setup, robot, base_link", "'joint_units'?"],
    ),
    "settings that are no settings": (
        lambda f: (f.root / "capture.yaml").write_text("- a\n- b\n"),
        ["does not hold settings", "key: value"],
    ),
    "broken yaml": (
        lambda f: (f.root / "capture.yaml").write_text("setup: [eye\nrobot: x"),
        ["not valid YAML", "line 2"],
    ),
    "unknown setup": (
        lambda f: f.config(setup="eye_in_hand"),
        ["'setup' in capture.yaml is 'eye_in_hand'", "one of eye-to-hand, eye-in-hand"],
    ),
    "unknown unit": (lambda f: f.config(joint_units="degree"), ["'joint_units'", "rad or deg"]),
    "text for a list": (
        lambda f: f.config(ignore_links="finger"),
        ["'ignore_links' in capture.yaml is 'finger'", "a list of texts"],
    ),
    "number for a text": (lambda f: f.config(images=7), ["'images' in capture.yaml is 7"]),
    "default that is no number": (
        lambda f: f.config(default_joints={"finger_joint": "open"}),
        ["'default_joints: finger_joint' in capture.yaml is 'open'", "a finite number"],
    ),
    "defaults that are no map": (
        lambda f: f.config(default_joints=[1, 2]),
        ["joint names with a number each"],
    ),
    "no ee_link": (
        lambda f: f.config(setup="eye-in-hand"),
        ["needs the link it rides on", "camera_mount"],
    ),
    "unknown ee_link": (
        lambda f: f.config(setup="eye-in-hand", ee_link="flange"),
        ["has no link 'flange'", "one of world, base"],
    ),
    "capture.yaml that is a folder": (
        lambda f: (f.root / "capture.yaml").mkdir(),
        ["capture.yaml cannot be read: Is a directory", "or delete it to use the defaults"],
    ),
    "a date that is none": (
        lambda f: (f.root / "capture.yaml").write_text("setup: 2024-13-45"),
        ["capture.yaml is not valid YAML"],
    ),
    "robot of an unknown user": (
        lambda f: f.config(robot="~no-such-user/robot.urdf"),
        ["home folder in '~no-such-user/robot.urdf'", "capture.yaml, robot", "without ~"],
    ),
    "packages of an unknown user": (
        lambda f: f.config(package_dirs=["~no-such-user/ws"]),
        ["home folder in '~no-such-user/ws'", "capture.yaml, package_dirs", "without ~"],
    ),
    "zero byte in a path": (
        lambda f: f.config(joints="a\0b"),
        ["'joints' in capture.yaml is 'a\\x00b'", "Expected: a text"],
    ),
    "a cell without end": (
        lambda f: lines(f, lambda all_: [all_[0], all_[1].replace(",", ',"', 1), *all_[2:]]),
        ["no table from here on: unexpected end of data", "joints.csv, line 2", "quotation mark"],
    ),
    "a cell too long": (
        lambda f: cell(f, "0001", "joint1", "1" * 200_000),
        ["no table from here on: field larger than field limit", "joints.csv, line 3"],
    ),
    "table that is a folder": (
        lambda f: [(f.root / "joints.csv").unlink(), (f.root / "joints.csv").mkdir()],
        ["table of joints cannot be read: Is a directory", "joints.csv"],
    ),
    "unknown geometry": (
        lambda f: f.config(geometry="contact"),
        ["'geometry' in capture.yaml is 'contact'", "visual or collision"],
    ),
    "unknown base link": (lambda f: f.config(base_link="bse"), ["'bse'", "base"]),
    "unknown ignored link": (lambda f: f.config(ignore_links=["fingr"]), ["'fingr'", "finger"]),
}


@pytest.mark.parametrize("case", CASES)
def test_bad_input_is_one_clear_error(folder, case):
    break_it, phrases = CASES[case]
    break_it(folder)
    with pytest.raises(InputError) as caught:
        Capture.load(folder.root)
    text = str(caught.value)
    for phrase in phrases:
        assert phrase in text
    assert "problems" not in text, "one cause is to give one error"
    errors = [problem for problem in check_capture(folder.root) if problem.severity == "error"]
    assert [str(problem) for problem in errors] == [text]


LOCKED = {
    "camera_info.yaml": "camera_info file cannot be read: Permission denied",
    "joints.csv": "table of joints cannot be read: Permission denied",
    "capture.yaml": "capture.yaml cannot be read: Permission denied",
    "robot": "robot description cannot be read: Permission denied",
    "robot/robot.urdf": "robot description cannot be read: Permission denied",
    "images": "folder of images cannot be listed: Permission denied",
    "masks": "folder of masks cannot be listed: Permission denied",
    "masks/0001.png": "file cannot be read: Permission denied",
}


@pytest.mark.parametrize("name", LOCKED)
def test_what_may_not_be_read_is_one_clear_error(folder, lock, name):
    folder.config(setup="eye-to-hand")
    lock(folder.root / name)
    with pytest.raises(InputError) as caught:
        Capture.load(folder.root)
    assert LOCKED[name] in str(caught.value)
    assert str(folder.root / name) in str(caught.value)
    assert "problems" not in str(caught.value), "one cause is to give one error"


def test_folders_inside_one_that_may_not_be_looked_into(folder, lock):
    (folder.root / "private").mkdir()
    lock(folder.root / "private")
    for setting, what in (
        ({"images": "private/images"}, "folder of images cannot be listed: Permission denied"),
        ({"robot": "private/arm.xacro"}, "robot description cannot be read: Permission denied"),
    ):
        folder.config(**setting)
        with pytest.raises(InputError, match=what) as caught:
            Capture.load(folder.root)
        assert "problems" not in str(caught.value)


def test_a_locked_folder_that_the_capture_does_not_need(folder, lock):
    (folder.root / "lost+found").mkdir()
    lock(folder.root / "lost+found")
    assert Capture.load(folder.root).view_ids == folder.views


def test_folder_that_is_none(tmp_path):
    with pytest.raises(InputError, match=r"no such capture folder .*nowhere"):
        Capture.load(tmp_path / "nowhere")
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="This is not a folder"):
        Capture.load(tmp_path / "file")
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match=r"folder is empty.*camera_info\.yaml, joints\.csv"):
        Capture.load(tmp_path / "empty")
    assert "folder is empty" in str(check_capture(tmp_path / "empty")[0])


def test_folder_of_captures(folder):
    with pytest.raises(InputError, match=r"holds captures, it is none itself.*Take one of demo"):
        Capture.load(folder.root.parent)


def test_everything_wrong_is_found_at_once(folder):
    (folder.root / "camera_info.yaml").unlink()
    (folder.root / "images" / "0001.png").write_text("x")
    (folder.root / "masks" / "0002.png").write_bytes(b"")
    folder.positions["0000"]["joint1"] = "?"
    folder.table()
    errors = [problem for problem in check_capture(folder.root) if problem.severity == "error"]
    assert len(errors) == 4
    assert {view for problem in errors for view in problem.views} == {"0000", "0001", "0002"}
    with pytest.raises(InputError) as caught:
        Capture.load(folder.root)
    text = str(caught.value)
    assert "has 4 problems" in text
    for number, problem in enumerate(errors, 1):
        assert f"\n  {number}. {problem}" in text


def test_a_long_list_of_errors_is_cut(make_folder):
    folder = make_folder("long", views=tuple(f"{i:04d}" for i in range(14)))
    for path in (folder.root / "images").iterdir():
        path.write_text("x")
    with pytest.raises(InputError) as caught:
        Capture.load(folder.root)
    text = str(caught.value)
    assert "has 14 problems" in text
    assert "\n  10. " in text
    assert "\n  11. " not in text
    assert text.rstrip(".").endswith("and 4 more")


def test_stray_masks_and_other_formats_are_warnings(folder):
    folder.image("0009.png", np.eye(48, 64, dtype=np.uint8) * 255, folder="masks")
    (folder.root / "images" / "0004.tiff").write_bytes(b"II*")
    warnings = [str(p) for p in check_capture(folder.root) if p.severity == "warning"]
    assert len(warnings) == 2
    assert "1 file of another format not used: 0004.tiff" in warnings[0]
    assert "Mask without a view: 0009" in warnings[1]


def test_damage_inside_a_png_is_found_by_checking(folder):
    path = folder.root / "images" / "0001.png"
    data = bytearray(path.read_bytes())
    start = data.index(b"IDAT") + 4
    data[start : start + 40] = bytes(40)
    path.write_bytes(bytes(data))
    errors = [problem for problem in check_capture(folder.root) if problem.severity == "error"]
    assert [problem.views for problem in errors] == [("0001",)]
    assert "truncated or damaged" in str(errors[0])
