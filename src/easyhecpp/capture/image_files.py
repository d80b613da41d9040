"""What a PNG or JPEG file says about itself, without decoding it.

Loading a capture looks at every file, and decoding a hundred of them would take seconds; sizes,
pixel formats and whether a file ends too early all stand outside the compressed data.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path

from easyhecpp.errors import InputError

#: Suffixes of files that count as pictures, lower case.
IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg")

_PNG_MAGIC = b"\x89PNG\r\n\x1a\n"
_JPEG_MAGIC = b"\xff\xd8\xff"
# Channels by PNG colour type: grey, RGB, palette (decoded to RGB), grey and alpha, RGB and alpha.
_PNG_CHANNELS = {0: 1, 2: 3, 3: 3, 4: 2, 6: 4}
_STANDALONE_MARKERS = {0x01, *range(0xD0, 0xD9)}
_FRAME_MARKERS = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}
_START_OF_SCAN = 0xDA


@dataclass(frozen=True)
class ImageHeader:
    """Size and pixel format of an image file.

    Attributes:
        height: Pixels.
        width: Pixels.
        channels: 1 grey, 2 grey and alpha, 3 colour, 4 colour and alpha.
        bits: Bits per channel.
    """

    height: int
    width: int
    channels: int
    bits: int


def read_header(path: Path) -> ImageHeader:
    """Read size and format, and make sure that the file is whole.

    Raises:
        InputError: The file cannot be read, is neither PNG nor JPEG, or ends too early.
    """
    data = read_file(path)
    if data.startswith(_PNG_MAGIC):
        header = _png_header(data)
    elif data.startswith(_JPEG_MAGIC):
        header = _jpeg_header(data)
    else:
        raise InputError(
            "The file is not an image" if data else "The image file is empty",
            where=path,
            expected="a PNG or JPEG file",
            fix="Record or export it again, or delete it",
        )
    if header is None:
        raise broken_image(path)
    return header


def read_file(path: Path) -> bytes:
    """The bytes of a file.

    Raises:
        InputError: The file cannot be read.
    """
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(
            f"The file cannot be read: {error.strerror or error}",
            where=path,
            fix="Check that it exists and that you may read it",
        ) from error


def broken_image(path: Path) -> InputError:
    """The error for a file that starts as an image but does not decode."""
    return InputError(
        "The image file is truncated or damaged",
        where=path,
        expected="a complete PNG or JPEG file",
        fix="Copy or record it again, or delete it",
    )


def _png_header(data: bytes) -> ImageHeader | None:
    """The header of a PNG whose chunks reach to the end mark, else None."""
    if len(data) < 33 or data[12:16] != b"IHDR":
        return None
    width, height, bits, colour_type = struct.unpack(">IIBB", data[16:26])
    channels = _PNG_CHANNELS.get(colour_type)
    position = len(_PNG_MAGIC)
    while position + 12 <= len(data):
        (length,) = struct.unpack(">I", data[position : position + 4])
        if data[position + 4 : position + 8] == b"IEND":
            return None if channels is None else ImageHeader(height, width, channels, max(bits, 8))
        position += 12 + length
    return None


def _jpeg_header(data: bytes) -> ImageHeader | None:
    """The header of a JPEG whose compressed data reach to the end mark, else None."""
    header: ImageHeader | None = None
    position = 2
    while position + 4 <= len(data):
        if data[position] != 0xFF:
            return None
        marker = data[position + 1]
        if marker == 0xFF or marker in _STANDALONE_MARKERS:
            position += 1 if marker == 0xFF else 2
            continue
        if marker == _START_OF_SCAN:
            # Thumbnails inside the header have an end mark of their own; only later ones count.
            return header if data.find(b"\xff\xd9", position) >= 0 else None
        (length,) = struct.unpack(">H", data[position + 2 : position + 4])
        if marker in _FRAME_MARKERS and position + 10 <= len(data):
            bits, height, width, channels = struct.unpack(
                ">BHHB", data[position + 4 : position + 10]
            )
            header = ImageHeader(height, width, channels, bits)
        position += 2 + length
    return None
