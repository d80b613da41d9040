from __future__ import annotations

import json

import pytest
import yaml

from easyhecpp.camera import Camera
from easyhecpp.capture.camera_info import (
    camera_info_entries,
    parse_camera_info,
    read_camera_info,
)
from easyhecpp.errors import InputError

TOPIC = {
    "height": 480,
    "width": 640,
    "distortion_model": "plumb_bob",
    "d": [0.1, -0.2, 0.001, 0.002, 0.03],
    "k": [600.5, 0.0, 320.25, 0.0, 601.5, 239.75, 0.0, 0.0, 1.0],
    "r": [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
    "p": [600.5, 0.0, 320.25, 0.0, 0.0, 601.5, 239.75, 0.0, 0.0, 0.0, 1.0, 0.0],
    "frame_id": "optical",
}
EXPECTED = Camera(
    640, 480, 600.5, 601.5, 320.25, 239.75, "plumb_bob", (0.1, -0.2, 0.001, 0.002, 0.03), "optical"
)


@pytest.fixture
def write(tmp_path):
    def write_(entries, name="camera_info.yaml"):
        path = tmp_path / name
        path.write_text(json.dumps(entries) if name.endswith("json") else yaml.safe_dump(entries))
        return path

    return write_


def changed(**entries):
    return {
        key: value for key, value in {**TOPIC, **entries}.items() if not isinstance(value, Missing)
    }


class Missing:
    pass


def test_topic_dump(write):
    assert read_camera_info(write(TOPIC)) == EXPECTED


def test_json_of_the_same_keys(write):
    assert read_camera_info(write(TOPIC, "camera_info.json")) == EXPECTED


def test_what_ros2_topic_echo_prints(tmp_path):
    path = tmp_path / "camera_info.yaml"
    path.write_text("""header:
  stamp:
    sec: 1700000000
    nanosec: 5
  frame_id: /optical
height: 480
width: 640
distortion_model: plumb_bob
d:
- 0.1
- -0.2
- 1e-3
- 2e-3
- 0.03
k: [600.5, 0.0, 320.25, 0.0, 601.5, 239.75, 0.0, 0.0, 1.0]
binning_x: 0
binning_y: 0
roi: {x_offset: 0, y_offset: 0, height: 0, width: 0, do_rectify: false}
---
""")
    assert parse_camera_info(path) == (EXPECTED, ())


def test_capital_keys_of_ros1_and_nested_rows(write):
    rows = [TOPIC["k"][i : i + 3] for i in (0, 3, 6)]
    info = {"width": 640, "height": 480, "K": rows, "D": TOPIC["d"], "frame_id": "optical"}
    assert read_camera_info(write({**info, "distortion_model": "plumb_bob"})) == EXPECTED


def test_camera_calibration_parsers_layout(write):
    entries = {
        "image_width": 640,
        "image_height": 480,
        "camera_name": "narrow_stereo",
        "camera_matrix": {"rows": 3, "cols": 3, "data": TOPIC["k"]},
        "distortion_model": "plumb_bob",
        "distortion_coefficients": {"rows": 1, "cols": 5, "data": TOPIC["d"]},
        "rectification_matrix": {"rows": 3, "cols": 3, "data": TOPIC["r"]},
        "projection_matrix": {"rows": 3, "cols": 4, "data": TOPIC["p"]},
    }
    camera, notes = parse_camera_info(write(entries))
    assert camera.frame == "camera_color_optical_frame"
    assert camera_info_entries(camera) == {
        **camera_info_entries(EXPECTED),
        "frame_id": camera.frame,
    }
    assert len(notes) == 1
    assert "no frame_id" in notes[0]


@pytest.mark.parametrize(
    ("entries", "model", "coefficients", "note"),
    [
        ({"d": Missing(), "distortion_model": Missing()}, "none", (), "gives no distortion"),
        ({"d": []}, "none", (), "without coefficients"),
        ({"d": [0.0] * 5, "distortion_model": Missing()}, "none", (), "gives no distortion"),
        ({"d": [0.0] * 5, "distortion_model": "none"}, "none", (), None),
        ({"d": [], "distortion_model": ""}, "none", (), None),
        ({"d": [0.1, 0.2, 0.3, 0.4]}, "plumb_bob", (0.1, 0.2, 0.3, 0.4), None),
        (
            {"d": [0.1] * 8 + [0.0] * 6, "distortion_model": "rational_polynomial"},
            "rational_polynomial",
            (0.1,) * 8,
            None,
        ),
        (
            {"d": [0.1, 0, 0, 0], "distortion_model": "fisheye"},
            "equidistant",
            (0.1, 0, 0, 0),
            None,
        ),
        (
            {"d": [0, 0, 0, 0], "distortion_model": "equidistant"},
            "equidistant",
            (0, 0, 0, 0),
            None,
        ),
    ],
)
def test_distortion(write, entries, model, coefficients, note):
    camera, notes = parse_camera_info(write(changed(**entries)))
    assert camera.distortion_model == model
    assert camera.distortion[: len(coefficients)] == coefficients
    assert (len(notes) == 1 and note in notes[0]) if note else notes == ()


def test_region_of_interest_shifts_the_principal_point(write):
    roi = {"x_offset": 100, "y_offset": 50, "width": 400, "height": 300, "do_rectify": False}
    camera, notes = parse_camera_info(write(changed(roi=roi)))
    assert (camera.width, camera.height) == (400, 300)
    assert (camera.cx, camera.cy, camera.fx) == (220.25, 189.75, 600.5)
    assert "400x300 pixels at (100, 50)" in notes[0]


def test_binning_joins_pixels_about_their_middle(write):
    camera, _ = parse_camera_info(write(changed(binning_x=2, binning_y=2)))
    expected = EXPECTED.scaled(0.5)
    assert (camera.width, camera.height) == (320, 240)
    assert (camera.fx, camera.fy) == (expected.fx, expected.fy)
    assert (camera.cx, camera.cy) == (expected.cx, expected.cy)


def test_principal_point_outside_a_cropped_image_is_a_note(write):
    matrix = [600.0, 0, 700.0, 0, 600.0, 240.0, 0, 0, 1]
    _, notes = parse_camera_info(write(changed(k=matrix)))
    assert notes == ("The principal point cx = 700 lies outside the image of 640x480.",)


@pytest.mark.parametrize(
    ("entries", "phrases"),
    [
        ({"k": Missing()}, ["no intrinsics (no 'k' and no 'camera_matrix')", "fx, 0, cx"]),
        ({"k": [0.0] * 9}, ["all zeros", "never calibrated"]),
        ({"k": [600.0, 320.0, 240.0]}, ["has 3 numbers", "nine, row by row"]),
        ({"k": "none"}, ["'k' is 'none'", "a list of numbers"]),
        ({"k": [0, 0, 320, 0, 600, 240, 0, 0, 1]}, ["focal length fx is 0", "a positive number"]),
        ({"k": [600, 0, 320, 0, -600, 240, 0, 0, 1]}, ["focal length fy is -600"]),
        ({"k": [0.94, 0, 0.5, 0, 1.25, 0.5, 0, 0, 1]}, ["fx = 0.94", "normalised"]),
        ({"k": [1e6, 0, 320, 0, 1e6, 240, 0, 0, 1]}, ["fx = 1e+06", "Check the unit"]),
        ({"k": [600, 0, 3200, 0, 600, 240, 0, 0, 1]}, ["cx = 3200", "far outside", "near 320"]),
        ({"k": [600, 0, 320, 0, 600, -900, 0, 0, 1]}, ["cy = -900", "far outside"]),
        ({"k": [600, 2.5, 320, 0, 600, 240, 0, 0, 1]}, ["skew of 2.5", "not supported"]),
        ({"k": [600, 0, 0, 0, 600, 0, 320, 240, 1]}, ["a transposed matrix looks like this"]),
        ({"k": [600, 0, 320, 0, float("nan"), 240, 0, 0, 1]}, ["'k' holds nan", "finite"]),
        ({"d": [0.1, "x", 0, 0, 0]}, ["'d' holds 'x'"]),
        ({"width": Missing()}, ["has no width"]),
        ({"height": 0}, ["gives the height as 0", "positive whole number"]),
        ({"width": 640.5}, ["gives the width as 640.5"]),
        (
            {"distortion_model": "plum_bob"},
            [
                "Unknown distortion model 'plum_bob'",
                "none, plumb_bob, rational_polynomial, equidistant",
                "Did you mean 'plumb_bob'?",
            ],
        ),
        ({"distortion_model": Missing()}, ["5 distortion coefficients but no distortion_model"]),
        ({"d": [0.1, 0.2, 0.3]}, ["plumb_bob comes with 3 coefficients", "Expected: 4 or 5"]),
        ({"d": [0.1] * 6}, ["plumb_bob comes with 6 coefficients"]),
        ({"d": [], "distortion_model": "equidistant"}, ["0 coefficients", "Expected: 4"]),
        ({"roi": {"x_offset": 600, "width": 100}}, ["100x480 at (600, 0)", "not inside"]),
        ({"binning_x": -2}, ["'binning_x' is -2", "whole number"]),
    ],
)
def test_numbers_that_cannot_be_a_camera(write, entries, phrases):
    path = write(changed(**entries))
    with pytest.raises(InputError) as caught:
        read_camera_info(path)
    for phrase in [*phrases, "camera_info.yaml"]:
        assert phrase in str(caught.value)


@pytest.mark.parametrize(
    ("name", "text", "phrase"),
    [
        ("c.yaml", "k: [1, 2", "not valid YAML"),
        ("c.json", "{k: 1}", "not valid JSON"),
        ("c.yaml", "", "holds no entries"),
        ("c.yaml", "- 1\n- 2\n", "holds no entries"),
        ("c.yaml", "%YAML:1.0\n---\nK: !!opencv-matrix\n   rows: 3\n", "not valid YAML"),
    ],
)
def test_files_that_are_no_camera_info(tmp_path, name, text, phrase):
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(InputError, match=phrase) as caught:
        read_camera_info(path)
    assert "camera_calibration_parsers" in str(caught.value)


def test_file_that_is_not_there_or_not_text(tmp_path):
    with pytest.raises(InputError, match=r"There is no camera_info file .*ros2 topic echo"):
        read_camera_info(tmp_path / "camera_info.yaml")
    path = tmp_path / "binary.yaml"
    path.write_bytes(b"\xff\xfe\x00k")
    with pytest.raises(InputError, match="cannot be read"):
        read_camera_info(path)


def test_entries_read_back_exactly(write):
    lens = (1e-7, 0.0, -1e-5, 1 / 7)
    camera = Camera(641, 479, 600.1, 600 + 1 / 3, 320.1 + 0.2, 239.7, "plumb_bob", lens)
    assert read_camera_info(write(camera_info_entries(camera))) == camera
