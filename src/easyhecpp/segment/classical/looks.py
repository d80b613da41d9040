"""One look at the pictures, or more where it leaves doubt: without shadows, then thoroughly."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from easyhecpp.errors import CalibrationError
from easyhecpp.geometry import pose_error
from easyhecpp.segment.classical.search import Scored
from easyhecpp.segment.classical.segmenter import ClassicalSegmenter
from easyhecpp.segment.edges import EdgeRefinement
from easyhecpp.segment.quality import ViewQuality
from easyhecpp.solve import PoseEstimate

F64 = NDArray[np.float64]

_SAME_POSE = 0.03
"""Poses less far apart than that share of the arm's size, and that many radians, are one."""
_ROUNDS = 3
"""Of masks and edges, at most, until the edges leave the camera where they were read from."""
_BORNE_OUT, _BORNE_OUT_ALIKE = 0.6, 0.7
"""Edges tell a pose from another when they lie on so much of its outline, and on less than that
share of as much of the other's: right poses have them on three quarters, wrong ones on a fifth,
in scenes full of edges on half."""


@dataclass(frozen=True)
class Look:
    """A pose from one kind of change maps.

    Attributes:
        segmenter: It was found with.
        candidates: First poses, best first.
        margin: How much better the best is than the next, as a share of the best; of two looks see
            `better_look`.
        started_at: ``(4, 4)`` T_mount_cam that the masks were made at.
        before_edges: The pose from the masks.
        refinement: On the edges.
        quality: One per view.
    """

    segmenter: ClassicalSegmenter
    candidates: tuple[Scored, ...]
    margin: float
    started_at: F64
    before_edges: PoseEstimate
    refinement: EdgeRefinement
    quality: tuple[ViewQuality, ...]

    @property
    def settled(self) -> bool:
        """Whether the edges leave the camera where it was when they were first read."""
        edges = self.refinement.estimate.T_mount_cam
        return _are_one(self.started_at, edges, self.segmenter.scene.radius)

    @property
    def borne_out(self) -> bool:
        """Whether edges bear the pose out."""
        seen, share = self.worth
        return seen and share >= self.segmenter.config.least_edges

    @property
    def convinces(self) -> bool:
        """Whether no other pose comes near, and edges bear it out."""
        return self.borne_out and self.margin >= self.segmenter.config.least_margin

    @property
    def worth(self) -> tuple[bool, float]:
        """Larger for the better of two looks; a little of an outline may lie on edges by chance."""
        support, config = self.refinement.support, self.segmenter.config
        seen = self.length >= config.least_length and support.covered >= config.least_covered
        return seen, support.share

    @property
    def length(self) -> float:
        """Of the visible contour per view, in longer sides of the image."""
        scene = self.segmenter.scene
        side = max(scene.camera.width, scene.camera.height)
        return self.refinement.support.length_px / (side * len(scene))

    @classmethod
    def of(cls, segmenter: ClassicalSegmenter, lap: Callable[[str], None]) -> Look:
        """Look at the pictures; ``lap`` is told when a stage is done.

        Raises:
            CalibrationError: Nothing moved, or the arm cannot be found.
        """
        candidates = segmenter.first_pose()
        lap("first_pose")
        candidates = tuple(segmenter.settle(candidates))
        lap("region")
        look = cls._at(segmenter, candidates, candidates[0].T_mount_cam, lap)
        for _ in range(_ROUNDS - 1):
            if look.settled or not look.borne_out:
                break
            # Edges read from so far off are half of them others; masks made there are too.
            T = look.refinement.estimate.T_mount_cam
            look = cls._at(segmenter.anew(), candidates, T, lap)
        return look

    @classmethod
    def _at(
        cls,
        segmenter: ClassicalSegmenter,
        candidates: tuple[Scored, ...],
        T_mount_cam: F64,
        lap: Callable[[str], None],
    ) -> Look:
        """Masks and edges from a pose on."""
        before_edges = segmenter.solve(T_mount_cam, segmenter.masks_at(T_mount_cam))
        lap("masks")
        refinement, quality = segmenter.refine(before_edges)
        lap("edges")
        return cls(
            segmenter,
            candidates,
            _margin(candidates),
            T_mount_cam,
            before_edges,
            refinement,
            quality,
        )


def looked(segmenter: ClassicalSegmenter, lap: Callable[[str], None]) -> Look:
    """The pose of one look at the pictures, or of the best of several where there is doubt.

    The second leaves out what may be a shadow. Where edges bear neither out, both are repeated with
    a more thorough search, until they do.

    Raises:
        CalibrationError: Nothing moved, or the arm cannot be found, whatever is left out.
    """
    found = _look(segmenter, lap)
    if isinstance(found, CalibrationError) and not segmenter.something_moved:
        raise found
    if isinstance(found, Look) and found.convinces:
        return found
    shadowless = segmenter.without_shadows()
    lap("changes")
    for other, thorough in ((shadowless, False), (segmenter, True), (shadowless, True)):
        if thorough and isinstance(found, Look) and found.borne_out:
            break
        found = _better(found, _look(other.thorough() if thorough else other, lap))
    if isinstance(found, CalibrationError):
        raise found
    return found


def _look(segmenter: ClassicalSegmenter, lap: Callable[[str], None]) -> Look | CalibrationError:
    try:
        return Look.of(segmenter, lap)
    except CalibrationError as error:
        return error


def _better(
    first: Look | CalibrationError, second: Look | CalibrationError
) -> Look | CalibrationError:
    """The better of two looks; of two failures the first."""
    if isinstance(second, CalibrationError):
        return first
    return second if isinstance(first, CalibrationError) else better_look(first, second)


def better_look(first: Look, second: Look) -> Look:
    """Of two looks the one with more edges of the pictures on its outline.

    Where both come to one pose, neither's rivals matter any more than the other's: the larger
    margin counts. Where they come to two, there is a margin only if the edges tell them apart.
    """
    better, other = sorted((first, second), key=lambda look: look.worth, reverse=True)
    poses = [look.refinement.estimate.T_mount_cam for look in (better, other)]
    if _are_one(poses[0], poses[1], first.segmenter.scene.radius):
        return replace(better, margin=max(better.margin, other.margin))
    share, rival = (look.refinement.support.share for look in (better, other))
    apart = share > _BORNE_OUT and rival < _BORNE_OUT_ALIKE * share
    return better if apart else replace(better, margin=0.0)


def _are_one(T_a: F64, T_b: F64, radius: float) -> bool:
    """Whether two poses lie close together, for an arm of that radius."""
    metres, radians = pose_error(T_a, T_b)
    return bool(metres < _SAME_POSE * radius and radians < _SAME_POSE)


def _margin(candidates: Sequence[Scored]) -> float:
    best = candidates[0].score
    if best <= 0.0:
        return 0.0
    if len(candidates) < 2:
        return 1.0
    return float(np.clip((best - candidates[1].score) / best, 0.0, 1.0))
