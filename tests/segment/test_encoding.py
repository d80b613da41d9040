"""No image is encoded twice."""

from __future__ import annotations

import numpy as np
import pytest
from stage import PerfectSam

from easyhecpp.segment import PromptableSegmenter, Prompts, RememberingSegmenter


def image(value):
    return np.full((4, 6, 3), value, dtype=np.uint8)


def test_the_same_pixels_are_encoded_once():
    sam = PerfectSam()
    remembering = RememberingSegmenter(sam)
    assert isinstance(remembering, PromptableSegmenter)
    assert remembering.name == "perfect"
    first = remembering.encode(image(1))
    assert remembering.encode(image(1)) is first
    assert remembering.encode(image(1)[:, ::-1]) is first
    assert remembering.encode(image(2)) is not first
    assert remembering.encode(image(1).reshape(6, 4, 3)) is not first
    assert len(sam.encoded) == 3


def test_memory_is_bounded_and_the_least_used_goes_first():
    sam = PerfectSam()
    remembering = RememberingSegmenter(sam, capacity=2)
    for value in (1, 2, 1, 3, 1, 2):
        remembering.encode(image(value))
    assert [int(seen[0, 0, 0]) for seen in sam.encoded] == [1, 2, 3, 2]


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({}, "boxes, points, or both"),
        ({"boxes": np.zeros((2, 3))}, r"\(N, 4\)"),
        ({"points": np.zeros((2, 2))}, r"\(N, P, 2\)"),
        ({"boxes": np.zeros((2, 4)), "points": np.zeros((3, 1, 2))}, "2 boxes but points for 3"),
        ({"points": np.zeros((3, 1, 2)), "on_object": np.ones((3, 2), bool)}, "for every point"),
        ({"boxes": np.zeros((2, 4)), "on_object": np.ones((2, 1), bool)}, "for every point"),
    ],
)
def test_prompts_that_do_not_fit_together(fields, words):
    with pytest.raises(ValueError, match=words):
        Prompts(**fields)
