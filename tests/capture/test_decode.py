"""Damage inside of picture files is found before any work is done."""

from __future__ import annotations

import zlib
from pathlib import Path

import numpy as np
import pytest
from capture_folder import CaptureFolder

from easyhecpp.capture import Capture
from easyhecpp.capture.decode import check_decodable
from easyhecpp.errors import InputError


@pytest.fixture
def folder(tmp_path: Path) -> CaptureFolder:
    return CaptureFolder(tmp_path / "demo", tuple(f"{i:04d}" for i in range(6)))


def test_whole_pictures(folder: CaptureFolder) -> None:
    rng = np.random.default_rng(0)
    (folder.root / "images" / "0001.png").unlink()
    folder.image("0001.jpg", rng.integers(0, 255, (48, 64, 3)).astype(np.uint8))
    folder.image("0002.png", rng.integers(0, 255, (48, 64)).astype(np.uint8))
    folder.image("0003.png", rng.integers(0, 65535, (48, 64, 3)).astype(np.uint16))
    folder.image("0004.png", rng.integers(0, 255, (48, 64, 4)).astype(np.uint8))
    check_decodable(Capture.load(folder.root))


def test_one_damaged_picture(folder: CaptureFolder, capfd: pytest.CaptureFixture[str]) -> None:
    path = folder.damage("images/0003.png")
    with pytest.raises(InputError, match=r"truncated or damaged \(.*0003\.png\)") as raised:
        check_decodable(Capture.load(folder.root))
    assert raised.value.where == str(path)
    assert capfd.readouterr().err == ""  # libpng keeps quiet


def test_all_damaged_pictures_in_the_order_of_the_views(folder: CaptureFolder) -> None:
    for view in ("0005", "0001", "0002"):
        folder.damage(f"images/{view}.png")
    with pytest.raises(InputError) as raised:
        check_decodable(Capture.load(folder.root))
    text = str(raised.value)
    assert "3 problems" in text
    assert text.index("0001.png") < text.index("0002.png") < text.index("0005.png")


def test_pixels_that_do_not_decode_behind_right_checksums(folder: CaptureFolder) -> None:
    """The decoder has the last word."""
    path = folder.root / "images" / "0000.png"
    data = bytearray(path.read_bytes())
    at = data.index(b"IDAT")
    length = int.from_bytes(data[at - 4 : at], "big")
    data[at + 4 : at + 24] = bytes(20)
    end = at + 4 + length
    data[end : end + 4] = zlib.crc32(data[at:end]).to_bytes(4, "big")
    path.write_bytes(data)
    with pytest.raises(InputError, match="truncated or damaged"):
        check_decodable(Capture.load(folder.root))
