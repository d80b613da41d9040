from __future__ import annotations

import struct

import cv2
import numpy as np
import pytest

from easyhecpp.capture import Capture
from easyhecpp.capture.image_data import inspect_mask, read_depth, read_image, read_mask
from easyhecpp.capture.image_files import ImageHeader, read_header
from easyhecpp.errors import InputError

RNG = np.random.default_rng(11)
COLOUR = RNG.integers(0, 256, (20, 30, 3)).astype(np.uint8)


def save(path, pixels):
    assert cv2.imwrite(str(path), pixels)
    return path


@pytest.mark.parametrize(
    ("pixels", "suffix", "header"),
    [
        (COLOUR, "png", ImageHeader(20, 30, 3, 8)),
        (COLOUR, "jpg", ImageHeader(20, 30, 3, 8)),
        (COLOUR[..., 0], "png", ImageHeader(20, 30, 1, 8)),
        (COLOUR[..., 0], "jpeg", ImageHeader(20, 30, 1, 8)),
        (COLOUR.astype(np.uint16) * 257, "png", ImageHeader(20, 30, 3, 16)),
        (np.dstack([COLOUR, COLOUR[..., :1]]), "png", ImageHeader(20, 30, 4, 8)),
    ],
)
def test_headers_agree_with_what_was_written(tmp_path, pixels, suffix, header):
    assert read_header(save(tmp_path / f"a.{suffix}", pixels)) == header


def test_progressive_jpeg_and_a_thumbnail_inside(tmp_path):
    plain = cv2.imencode(".jpg", COLOUR, [cv2.IMWRITE_JPEG_PROGRESSIVE, 1])[1].tobytes()
    thumbnail = cv2.imencode(".jpg", COLOUR[:8, :8])[1].tobytes()
    inner = b"\xff\xe1" + struct.pack(">H", len(thumbnail) + 2) + thumbnail
    path = tmp_path / "a.jpg"
    path.write_bytes(plain[:2] + inner + plain[2:])
    assert read_header(path) == ImageHeader(20, 30, 3, 8)
    path.write_bytes((plain[:2] + inner + plain[2:])[:-200])
    with pytest.raises(InputError, match="truncated or damaged"):
        read_header(path)


@pytest.mark.parametrize("suffix", ["png", "jpg"])
@pytest.mark.parametrize("share", [0.01, 0.1, 0.5, 0.9, 0.995])
def test_files_cut_anywhere_are_refused(tmp_path, suffix, share):
    path = save(tmp_path / f"a.{suffix}", COLOUR)
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * share)])
    with pytest.raises(InputError):
        read_header(path)


def test_colours_come_in_the_order_red_green_blue(tmp_path):
    path = save(tmp_path / "a.png", COLOUR[..., ::-1])
    np.testing.assert_array_equal(read_image(path), COLOUR)


def test_grey_sixteen_bit_and_alpha_become_plain_colour(tmp_path):
    grey = save(tmp_path / "grey.png", COLOUR[..., 0])
    np.testing.assert_array_equal(read_image(grey), np.repeat(COLOUR[..., :1], 3, axis=2))
    deep = save(tmp_path / "deep.png", COLOUR[..., ::-1].astype(np.uint16) * 256 + 17)
    np.testing.assert_array_equal(read_image(deep), COLOUR)
    alpha = save(tmp_path / "alpha.png", np.dstack([COLOUR[..., ::-1], COLOUR[..., :1]]))
    np.testing.assert_array_equal(read_image(alpha), COLOUR)


@pytest.mark.parametrize("bits", [8, 10, 12, 14, 16])
def test_sixteen_bits_are_scaled_by_those_that_are_used(folder, bits):
    deep = [(RNG.integers(0, 2**bits, (48, 64, 3))).astype(np.uint16) for _ in folder.views]
    deep[0][0, 0] = 2**bits - 1
    deep[1] //= 8  # a dark one stays dark
    for view, image in zip(folder.views, deep, strict=True):
        folder.image(f"{view}.png", image)
    for view, image in zip(Capture.load(folder.root).views, deep, strict=True):
        np.testing.assert_array_equal(view.image, image >> (bits - 8))
        np.testing.assert_array_equal(view.with_joints(view.joints).image, view.image)


def test_what_is_brighter_than_the_others_does_not_wrap_round(tmp_path):
    deep = save(tmp_path / "deep.png", np.full((4, 5, 3), 5000, np.uint16))
    assert (read_image(deep, bits=12) == 255).all()


def test_an_exif_rotation_is_not_applied(tmp_path):
    plain = cv2.imencode(".jpg", COLOUR)[1].tobytes()
    entry = struct.pack(">HHIHH", 0x0112, 3, 1, 6, 0)
    exif = b"Exif\0\0MM\0*\0\0\0\x08" + struct.pack(">H", 1) + entry + struct.pack(">I", 0)
    path = tmp_path / "turned.jpg"
    path.write_bytes(plain[:2] + b"\xff\xe1" + struct.pack(">H", len(exif) + 2) + exif + plain[2:])
    assert cv2.imread(str(path)).shape == (30, 20, 3)
    assert read_image(path).shape == (20, 30, 3)


def test_the_used_bits_are_noted(folder):
    for view in folder.views:
        folder.image(f"{view}.png", RNG.integers(0, 4096, (48, 64, 3)).astype(np.uint16))
    assert any(
        "12 of 16 bits per channel are used and scaled to 8, in all views alike" in note
        for note in Capture.load(folder.root).notes
    )


def test_conversions_are_noted(folder):
    grey = RNG.integers(0, 65536, (48, 64)).astype(np.uint16)
    folder.image("0000.png", grey)
    folder.image("0002.png", np.dstack([np.full((48, 64, 3), 99), np.arange(64) + grey * 0]))
    notes = Capture.load(folder.root).notes
    assert any(
        "view 0000, 16 bits per channel are cut to the upper 8, grey is taken as colour" in note
        for note in notes
    )
    assert any("In the image of view 0002, alpha is dropped" in note for note in notes)


ARM = np.zeros((20, 30), bool)
ARM[4:12, 6:20] = True


@pytest.mark.parametrize(
    "pixels",
    [
        ARM * np.uint8(255),
        ARM * np.uint8(1),
        ARM * np.uint16(65535),
        np.dstack([ARM * np.uint8(0), ARM * np.uint8(0), ARM * np.uint8(200)]),
        np.dstack([np.full((20, 30, 3), 255, np.uint8), ARM * np.uint8(255)]),
        np.dstack([np.repeat(ARM[..., None] * np.uint8(255), 3, 2), np.full((20, 30), 255)]),
    ],
    ids=["0-255", "0-1", "16 bit", "red", "in the alpha", "opaque colour"],
)
def test_masks_of_all_kinds(tmp_path, pixels):
    path = save(tmp_path / "mask.png", np.ascontiguousarray(pixels.astype(pixels.dtype)))
    np.testing.assert_array_equal(read_mask(path), ARM)
    assert inspect_mask(path) == (ARM.mean(), 2)


def test_soft_masks_are_cut_at_half_the_maximum(folder):
    soft = np.zeros((48, 64), np.uint8)
    soft[10:30, 10:40] = 100
    soft[12:28, 12:38] = 102
    soft[14:26, 14:36] = 202
    folder.image("0001.png", soft, folder="masks")
    capture = Capture.load(folder.root)
    np.testing.assert_array_equal(capture.view("0001").mask, soft > 101)
    assert any("mask of view 0001 has more than two values" in note for note in capture.notes)


def test_depth_is_in_metres_with_zero_for_unknown(tmp_path):
    millimetres = np.array([[0, 1, 500], [1234, 65535, 2]], np.uint16)
    depth = read_depth(save(tmp_path / "d.png", millimetres))
    assert depth.dtype == np.float32
    np.testing.assert_allclose(depth, millimetres / 1000.0, rtol=1e-6)


def test_missing_file_is_an_input_error(tmp_path):
    with pytest.raises(InputError, match=r"cannot be read.*No such file.*gone\.png"):
        read_image(tmp_path / "gone.png")
