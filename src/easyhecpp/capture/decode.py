"""Decodes every picture once before any work is done with them.

Loading looks at sizes and formats only. Damage inside of a file shows when it is decoded, which
must not be in the middle of writing results.
"""

from __future__ import annotations

import zlib
from pathlib import Path

from easyhecpp._parallel import parallel_map
from easyhecpp.capture.capture import Capture
from easyhecpp.capture.image_files import broken_image, read_file
from easyhecpp.capture.problems import Findings, joined_error
from easyhecpp.capture.view import View

_PNG_MAGIC = b"\x89PNG\r\n\x1a\n"


def check_decodable(capture: Capture) -> None:
    """Decode all pictures of a capture; those that fit into the cache of pictures stay there.

    Raises:
        InputError: Pictures are damaged; all of them are listed.
    """
    findings = Findings()

    def decode(view: View) -> None:
        with findings.catching(views=(view.id,), drops="view"):
            if view.image_path is not None and not _png_intact(view.image_path):
                raise broken_image(view.image_path)
            _ = view.image

    parallel_map(decode, [view for view in capture.views if view.image_path is not None])
    if findings.errors:
        # Threads come to the views in any order.
        rank = {view: i for i, view in enumerate(capture.view_ids)}
        found = sorted(findings.errors, key=lambda problem: rank[problem.views[0]])
        raise joined_error(found, capture.root or Path(capture.name))


def _png_intact(path: Path) -> bool:
    """Whether the checksums of a PNG's pixels are right; True for other formats.

    libpng would find out as well, but writes a line of its own to standard error.
    """
    data = read_file(path)
    if not data.startswith(_PNG_MAGIC):
        return True
    position = len(_PNG_MAGIC)
    while position + 12 <= len(data):
        length = int.from_bytes(data[position : position + 4], "big")
        end = position + 8 + length
        kind = data[position + 4 : position + 8]
        stored = int.from_bytes(data[end : end + 4], "big")
        if kind in (b"IHDR", b"PLTE", b"IDAT") and zlib.crc32(data[position + 4 : end]) != stored:
            return False
        if kind == b"IEND":
            break
        position = end + 4
    return True
