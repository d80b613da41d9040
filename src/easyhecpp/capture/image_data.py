"""Image files to arrays: pictures, masks and depth, with a small cache of decoded ones."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path
from threading import Lock
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from easyhecpp.capture.image_files import ImageHeader, broken_image, read_file, read_header
from easyhecpp.errors import InputError

#: Decoded pictures kept in memory, in bytes: about fifty colour images of 1280x720.
CACHE_BYTES = 128 * 2**20

_METRES_PER_UNIT = 1e-3
_DEPTHS = (8, 10, 12, 14, 16)


def read_image(path: Path, bits: int = 16) -> NDArray[np.uint8]:
    """Read a picture as ``(H, W, 3)`` uint8 RGB.

    Grey is repeated, alpha is dropped; an EXIF rotation is not applied, since the intrinsics belong
    to the pixels as they are stored.

    Args:
        path: A PNG or JPEG file.
        bits: How many bits a file with 16 bits per channel uses, see `bits_used`; the upper 8 of
            them are kept.

    Raises:
        InputError: The file cannot be read or decoded.
    """
    pixels = _decode(path)
    if pixels.dtype == np.uint16:
        pixels = np.minimum(pixels >> (bits - 8), 255).astype(np.uint8)
    if pixels.shape[2] < 3:
        return np.repeat(pixels[..., :1], 3, axis=2)
    return np.ascontiguousarray(pixels[..., 2::-1])


def bits_used(path: Path) -> int:
    """How many bits per channel a 16-bit picture needs: 8, 10, 12, 14 or 16.

    Sensors of 10 to 14 bits are often stored as they are, at the lower end of the 16.

    Raises:
        InputError: The file cannot be read or decoded.
    """
    pixels = _decode(path)
    highest = int(_colours(pixels).max())
    return next(bits for bits in _DEPTHS if highest < 2**bits)


def read_mask(path: Path) -> NDArray[np.bool_]:
    """Read a mask as ``(H, W)`` bool: what is brighter than half the brightest value.

    Of colour the brightest channel counts; alpha counts where the colours are all the same.

    Raises:
        InputError: The file cannot be read or decoded.
    """
    return _brightness(_decode(path))[1]


def read_depth(path: Path) -> NDArray[np.float32]:
    """Read a 16-bit depth image in millimetres as ``(H, W)`` float32 metres, 0 where unknown.

    Raises:
        InputError: The file cannot be read or decoded, or has another format.
    """
    header = read_header(path)
    if (header.bits, header.channels) != (16, 1):
        raise InputError(
            f"The depth image has {header.bits} bits and {header.channels} channels",
            where=path,
            expected="16-bit grey, in millimetres, 0 where there is no depth",
            fix="Export the depth itself, not a coloured picture of it; or delete the file",
        )
    return (_decode(path)[..., 0] * _METRES_PER_UNIT).astype(np.float32)


def inspect_mask(path: Path) -> tuple[float, int]:
    """What a mask file holds: the share of pixels inside, and how many different values.

    Raises:
        InputError: The file cannot be read or decoded.
    """
    values, mask = _brightness(_decode(path))
    return float(mask.mean()), int(np.count_nonzero(np.bincount(values.ravel())))


def conversion_of(header: ImageHeader, bits: int) -> str | None:
    """What `read_image` changes in a picture of this format that uses ``bits``, or None."""
    changes = []
    if header.bits > bits:
        changes.append(
            f"{bits} of {header.bits} bits per channel are used and scaled to 8, in all views alike"
        )
    elif header.bits > 8:
        changes.append(f"{header.bits} bits per channel are cut to the upper 8")
    if header.channels < 3:
        changes.append("grey is taken as colour")
    if header.channels in (2, 4):
        changes.append("alpha is dropped")
    return ", ".join(changes) or None


class ArrayCache:
    """Keeps the most recently used arrays up to a number of bytes; the rest is read again."""

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._held: OrderedDict[tuple[object, ...], NDArray[Any]] = OrderedDict()
        self._lock = Lock()

    def get(
        self, path: Path, reader: Callable[..., NDArray[Any]], *settings: object
    ) -> NDArray[Any]:
        """The array that ``reader(path, *settings)`` makes, read-only; anew when the file changed.

        Raises:
            InputError: The file cannot be read.
        """
        try:
            status = path.stat()
        except OSError:
            return reader(path, *settings)
        key = (str(path), status.st_mtime_ns, status.st_size, reader.__name__, *settings)
        with self._lock:
            if key in self._held:
                self._held.move_to_end(key)
                return self._held[key]
        array = reader(path, *settings)
        array.setflags(write=False)
        with self._lock:
            self._held[key] = array
            while self.held_bytes > self._limit and len(self._held) > 1:
                self._held.popitem(last=False)
        return array

    @property
    def held_bytes(self) -> int:
        """Memory in use."""
        return sum(array.nbytes for array in self._held.values())


#: Shared by all views: the limit is of the process, however many captures are open.
CACHE = ArrayCache(CACHE_BYTES)


def _decode(path: Path) -> NDArray[Any]:
    """The file's pixels ``(H, W, C)`` as stored, channels in OpenCV's order."""
    read_header(path)
    pixels = cv2.imdecode(np.frombuffer(read_file(path), np.uint8), cv2.IMREAD_UNCHANGED)
    if pixels is None or pixels.dtype.name not in ("uint8", "uint16"):
        raise broken_image(path)
    return pixels[..., None] if pixels.ndim == 2 else pixels


def _colours(pixels: NDArray[Any]) -> NDArray[Any]:
    """The channels without alpha."""
    return pixels[..., :3] if pixels.shape[2] >= 3 else pixels[..., :1]


def _brightness(pixels: NDArray[Any]) -> tuple[NDArray[Any], NDArray[np.bool_]]:
    """Brightest channel per pixel, and whether it exceeds half of the picture's maximum."""
    colours = _colours(pixels)
    has_alpha = pixels.shape[2] in (2, 4)
    if has_alpha and (colours == colours[0, 0]).all():
        colours = pixels[..., -1:]
    values = colours.max(axis=2)
    return values, values > int(values.max()) / 2
