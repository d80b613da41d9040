"""What pictures alone say about a recording: black, frozen or unevenly exposed frames.

A frame that shows nothing, or shows again what another frame has shown, is none to calibrate with.

Everything here is a pure function of the pictures. A picture is reduced to a few numbers first, so
that a hundred views need not be in memory together.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from easyhecpp.capture._text import listing

_THUMB_WIDTH = 64
# 8-bit grey levels.
_BLACK_LEVEL = 16
_BLANK_SPREAD = 4
# Below this difference of the small pictures, nothing but noise has changed: a pixel of those is
# the mean of hundreds, an arm that covers a tenth of it changes it by more.
_SAME_THUMB = 1.5
# A brightness factor between a frame and the middle of all frames that auto-exposure in a steady
# scene does not reach.
_EXPOSURE_FACTOR = 1.6
_MIN_FRAMES_FOR_EXPOSURE = 3
# Radians or metres that a joint has to differ by to count as moved.
_MOVED = 0.02


@dataclass(frozen=True)
class FrameStatistics:
    """A picture reduced to what the checks need.

    Attributes:
        view: Id of the view.
        joints: Joint positions (n,).
        high: Brightness that one pixel in a hundred exceeds.
        spread: Difference between that and the brightness that 99 in a hundred exceed.
        digest: Hash of the pixels.
        thumb: Grey picture 64 pixels wide, float32.
    """

    view: str
    joints: NDArray[np.float64]
    high: float
    spread: float
    digest: bytes
    thumb: NDArray[np.float32]

    @staticmethod
    def of(view: str, joints: ArrayLike, image: NDArray[np.uint8]) -> FrameStatistics:
        """Reduce one picture.

        Args:
            view: Id of the view.
            joints: Joint positions (n,).
            image: ``(H, W, 3)`` uint8 RGB.
        """
        grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
        height, width = grey.shape
        size = (_THUMB_WIDTH, max(1, round(height * _THUMB_WIDTH / width)))
        thumb = np.asarray(
            cv2.resize(grey.astype(np.float32), size, interpolation=cv2.INTER_AREA), np.float32
        )
        low, high = np.percentile(grey, (1, 99))
        digest = hashlib.blake2b(np.ascontiguousarray(image).data, digest_size=16).digest()
        return FrameStatistics(
            view,
            np.asarray(joints, dtype=np.float64),
            float(high),
            float(high - low),
            digest,
            thumb,
        )


@dataclass(frozen=True)
class HealthFinding:
    """Something about pictures that deserves a look.

    Attributes:
        text: What it is.
        fix: What to do about it.
        views: Ids of the views it concerns.
        unusable: For those views whose pictures must not be used, why, by view id.
        hopeless: Whether no picture at all can be used.
    """

    text: str
    fix: str
    views: tuple[str, ...]
    unusable: dict[str, str] = field(default_factory=dict)
    hopeless: bool = False


def health_findings(frames: Sequence[FrameStatistics]) -> list[HealthFinding]:
    """All findings on the pictures of one recording, in recording order."""
    blank = blank_frames(frames)
    blank_views = {view for finding in blank for view in finding.views}
    seen = [frame for frame in frames if frame.view not in blank_views]
    return [*blank, *frozen_frames(seen), *exposure_jumps(seen)]


def blank_frames(frames: Sequence[FrameStatistics]) -> list[HealthFinding]:
    """Frames that are black, or of one colour all over."""
    black = tuple(frame.view for frame in frames if frame.high < _BLACK_LEVEL)
    plain = tuple(
        frame.view for frame in frames if frame.view not in black and frame.spread < _BLANK_SPREAD
    )
    fix = "Record these views again, or delete them; check exposure, lens cap and pixel format"
    hopeless = len(black) + len(plain) == len(frames)
    return [
        HealthFinding(f"{text}: {listing(views)}", fix, views, dict.fromkeys(views, why), hopeless)
        for text, views, why in (
            ("Black images", black, "the image is black"),
            ("Images of one colour all over", plain, "the image is of one colour all over"),
        )
        if views
    ]


def frozen_frames(frames: Sequence[FrameStatistics]) -> list[HealthFinding]:
    """Pictures that stay the same although the joints move: a frozen camera or a wrong pairing."""
    if len(frames) < 2:
        return []
    views = tuple(frame.view for frame in frames)
    if len({frame.digest for frame in frames}) == 1:
        return [
            HealthFinding(
                f"All {len(frames)} images are identical",
                "Check that the camera delivered new frames while recording",
                views,
                hopeless=_moved_at_all(frames),
            )
        ]
    if all(_look_alike(first, frames[0]) for first in frames[1:]) and _moved_at_all(frames):
        return [
            HealthFinding(
                f"All {len(frames)} images show the same although the joints differ",
                "Check that the arm is in view and that the camera delivered new frames",
                views,
                hopeless=True,
            )
        ]
    pairs = [
        (before.view, after.view)
        for before, after in pairwise(frames)
        if before.digest == after.digest and _joints_differ(before, after)
    ]
    if not pairs:
        return []
    named = listing(f"{before} and {after}" for before, after in pairs)
    return [
        HealthFinding(
            f"Identical images of different joint positions: {named}",
            "The camera was frozen or images and joints are out of step: record these views again, "
            "or delete them",
            tuple(dict.fromkeys(view for pair in pairs for view in pair)),
            # The first of them may be in step; those that repeat it cannot be.
            {after: f"the image is that of view {before} again" for before, after in pairs},
        )
    ]


def exposure_jumps(frames: Sequence[FrameStatistics]) -> list[HealthFinding]:
    """Frames far brighter or darker than the rest.

    The brightness factor of a frame is the median over pixels of its ratio to the median frame, so
    that an arm which covers less than half of the picture does not count. Where the scene changes
    as a whole, as with a camera on the arm, the mean brightness has to jump as well.
    """
    if len(frames) < _MIN_FRAMES_FOR_EXPOSURE or len({frame.thumb.shape for frame in frames}) > 1:
        return []
    thumbs = np.stack([frame.thumb for frame in frames]).reshape(len(frames), -1) + 1.0
    by_pixel = np.median(thumbs / np.median(thumbs, axis=0), axis=1)
    means = thumbs.mean(axis=1)
    by_mean = means / np.median(means)
    findings = []
    for word, factors in (
        ("brighter", (by_pixel, by_mean)),
        ("darker", (1 / by_pixel, 1 / by_mean)),
    ):
        jumps = np.minimum(*factors) > _EXPOSURE_FACTOR
        views = tuple(frame.view for frame, jump in zip(frames, jumps, strict=True) if jump)
        if views:
            findings.append(
                HealthFinding(
                    f"Images much {word} than the others: {listing(views)}",
                    "Fix exposure and white balance while recording, or delete these views",
                    views,
                )
            )
    return findings


def _look_alike(a: FrameStatistics, b: FrameStatistics) -> bool:
    return a.thumb.shape == b.thumb.shape and bool(np.abs(a.thumb - b.thumb).max() < _SAME_THUMB)


def _joints_differ(a: FrameStatistics, b: FrameStatistics) -> bool:
    return bool(np.abs(a.joints - b.joints).max(initial=0.0) > _MOVED)


def _moved_at_all(frames: Sequence[FrameStatistics]) -> bool:
    return any(_joints_differ(frame, frames[0]) for frame in frames[1:])
