"""Remembering encoded images, so that no round of a calibration encodes a view twice."""

from __future__ import annotations

import hashlib
from collections import OrderedDict

import numpy as np
from numpy.typing import NDArray

from easyhecpp.segment.protocols import EncodedImage, PromptableSegmenter

# A capture rarely has more views. An embedding takes 4 MB (SAM) to 25 MB (SAM-HQ).
IMAGES_REMEMBERED = 32


class RememberingSegmenter:
    """A ``PromptableSegmenter`` that knows again an image it has encoded.

    Masks are made several times per view (from text, then at each better pose), but the image
    stays; encoding it is what takes the time.

    Args:
        segmenter: does the work.
        capacity: how many images are remembered; the one unused for longest goes first.
    """

    def __init__(self, segmenter: PromptableSegmenter, capacity: int = IMAGES_REMEMBERED) -> None:
        self.segmenter = segmenter
        self.capacity = capacity
        self._encoded: OrderedDict[bytes, EncodedImage] = OrderedDict()

    @property
    def name(self) -> str:
        """The model's name."""
        return self.segmenter.name

    def encode(self, image: NDArray[np.uint8]) -> EncodedImage:
        """Encode an (H, W, 3) uint8 RGB image, or hand out its embedding of last time."""
        key = _fingerprint(image)
        if key in self._encoded:
            self._encoded.move_to_end(key)
            return self._encoded[key]
        encoded = self.segmenter.encode(image)
        self._encoded[key] = encoded
        if len(self._encoded) > self.capacity:
            self._encoded.popitem(last=False)
        return encoded


def _fingerprint(image: NDArray[np.uint8]) -> bytes:
    digest = hashlib.blake2b(str((image.shape, image.dtype)).encode(), digest_size=16)
    digest.update(np.ascontiguousarray(image).data)
    return digest.digest()
