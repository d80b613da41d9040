"""From images, joints, intrinsics and the URDF alone to the camera's pose."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from easyhecpp.camera import Camera
from easyhecpp.errors import CalibrationError, InputError
from easyhecpp.geometry import pose_error
from easyhecpp.rig import Rig
from easyhecpp.segment.backgrounds import Backgrounds
from easyhecpp.segment.classical.change import ChangeMaps, change_maps, pairs_to_compare
from easyhecpp.segment.classical.first_pose import FINAL_TOLERANCE, FirstPoseConfig, first_pose
from easyhecpp.segment.classical.masks import masks_at
from easyhecpp.segment.classical.plate import PlateConfig, plate_maker
from easyhecpp.segment.classical.region import Round, fit_regions
from easyhecpp.segment.classical.search import PairScore, Scored, distinct
from easyhecpp.segment.edges import EdgeConfig, EdgeRefinement, refine_edges
from easyhecpp.segment.pictures import Pictures, load_pictures
from easyhecpp.segment.protocols import ViewMask
from easyhecpp.segment.quality import ViewQuality, assess_at
from easyhecpp.segment.scene import Scene
from easyhecpp.solve import Observation, PoseEstimate, SolveConfig, solve_pose

F64 = NDArray[np.float64]
U8 = NDArray[np.uint8]

FEWEST_VIEWS = 3
"""With fewer views there is no background to tell the arm from."""

_REGION_WIDTH = 640
"""Width of the pictures that the region stage looks at; the search takes half of it."""

_SELF_CONFIRMING = 4.0
"""On the covariance of a pose from masks that were made with a prediction of that pose."""

_RIVAL, _MOST_RIVALS = 0.4, 3
"""Candidates that are looked at closer: with this share of the best one's score, and how many."""

_SAME_POSE = 0.03
"""Poses less far apart than that share of the arm's size, and that many radians, are one."""
_BORNE_OUT, _BORNE_OUT_ALIKE = 0.6, 0.7
"""Edges tell a pose from another when they lie on so much of its outline, and on less than that
share of as much of the other's: right poses have them on three quarters, wrong ones on a fifth,
in scenes full of edges on half."""

_COARSE = (Round(12, 6.0, 3), Round(8, 3.0, 4))
_FINE = (Round(6, 2.0, 3, bracketed=True),)


@dataclass(frozen=True)
class ClassicalConfig:
    """Settings of the classical way.

    Attributes:
        search: How wide the first pose is looked for.
        edges: The edge stage.
        least_explained: Share of the change that the arm's motion must explain.
        least_margin: How much better than the next different pose, as a share of the best.
        least_edges: Share of the contour that must lie on image edges.
        least_length: Length of visible contour per view, in image widths.
        least_covered: Share of the image that the arm must cover on average.
    """

    search: FirstPoseConfig = field(default_factory=FirstPoseConfig)
    edges: EdgeConfig = field(default_factory=EdgeConfig)
    least_explained: float = 0.08
    least_margin: float = 0.15
    least_edges: float = 0.36
    least_length: float = 0.4
    least_covered: float = 0.01


@dataclass(frozen=True)
class ClassicalResult:
    """What the classical way found.

    Attributes:
        T_mount_cam: ``(4, 4)`` the camera's pose.
        candidates: The first poses with the share of change that each explains, best first.
        margin: How much better the best is than the next, as a share of the best; 0 when two looks
            at the pictures came to two poses that the edges do not tell apart.
        masks: One per view.
        quality: One per view.
        estimate: The pose with covariance, as the solver states it.
        before_edges: The same before the edge stage.
        refinement: What the edge stage did; the camera that the pose goes with is among it.
        reasons: Why the result may be wrong, sentences; empty when it is sure.
        timings_s: Seconds per stage.
    """

    T_mount_cam: F64
    candidates: tuple[Scored, ...]
    margin: float
    masks: tuple[ViewMask, ...]
    quality: tuple[ViewQuality, ...]
    estimate: PoseEstimate
    before_edges: PoseEstimate
    refinement: EdgeRefinement
    reasons: tuple[str, ...]
    timings_s: dict[str, float]

    @property
    def sure(self) -> bool:
        """Whether nothing speaks against the result."""
        return not self.reasons


class ClassicalSegmenter:
    """Masks and poses from the arm's own motion before a still camera, without any weights.

    Args:
        rig: Robot and set-up; the camera must stand still (eye-to-hand).
        camera: Intrinsics.
        images: ``(H, W, 3)`` uint8 RGB, one per view.
        joints: ``(n,)`` per view.
        ids: Names of the views.
        config: Settings.

    Raises:
        InputError: Too few views, sizes that do not fit, or a camera that moves with the arm.
    """

    def __init__(
        self,
        rig: Rig,
        camera: Camera,
        images: Sequence[U8],
        joints: Sequence[F64],
        *,
        ids: Sequence[str] | None = None,
        config: ClassicalConfig | None = None,
    ) -> None:
        _check(rig, images, joints)
        self.config = config or ClassicalConfig()
        self.rig, self.camera = rig, camera
        self.images = list(images)
        self.ids = tuple(ids) if ids is not None else tuple(str(i) for i in range(len(images)))
        self.scene = Scene(rig, camera, joints)
        reduction = max(1, round(camera.width / _REGION_WIDTH))
        self.pictures: Pictures = load_pictures(images, camera, reduction)
        pairs = pairs_to_compare(self.scene.motion)
        self.changes: ChangeMaps = change_maps(self.pictures.reduced(2), pairs)
        self._backgrounds: Backgrounds | None = None

    def without_shadows(self) -> ClassicalSegmenter:
        """The same, for which what may be a shadow is no sign of the arm; see `change_maps`."""
        other = copy(self)
        pairs = self.changes.pairs
        other.changes = change_maps(self.pictures.reduced(2), pairs, shadows=False)
        if self._backgrounds is not None:
            # The plates are large, belong to a pose, and are made anew for the next.
            self._backgrounds.plates.clear()
            other._backgrounds = self._backgrounds.through(self.camera)
        return other

    @property
    def something_moved(self) -> bool:
        """Whether the pictures differ."""
        return float(np.mean(self.changes.maps > 0.0)) >= 1e-4

    def first_pose(self) -> list[Scored]:
        """Candidates for the pose, best first, to a few pixels.

        Raises:
            CalibrationError: Nothing moved between the views, or no pose explains what did.
        """
        if not self.something_moved:
            raise CalibrationError(
                "The images hardly differ from each other: nothing moved before the camera. The "
                "classical way needs views with the arm in different postures."
            )
        found = first_pose(self.scene, self.changes, self.config.search)
        if not found or found[0].score <= 0.0:
            raise CalibrationError(
                "No camera pose explains the motion in the images. Check that joints and images "
                "belong together, and that the arm, not something else, moves in them."
            )
        return found

    def approach(self, T_mount_cam: F64) -> F64:
        """A first pose brought to a pixel or two, against the background plate."""
        for rounds, plate in ((_COARSE, PlateConfig(4, 16)), (_FINE, PlateConfig(2, 12))):
            make = plate_maker(self.pictures, plate)
            T_mount_cam = fit_regions(
                self.scene, T_mount_cam, self.pictures.reduction, make, rounds
            )
        return T_mount_cam

    def settle(self, candidates: Sequence[Scored]) -> list[Scored]:
        """First poses that come near the best one, brought closer, scored again and told apart.

        Two candidates that were half way to the same pose are no reason for doubt.
        """
        score = PairScore(self.scene, self.changes, FINAL_TOLERANCE)
        least = _RIVAL * candidates[0].score
        near = [c for c in candidates[:_MOST_RIVALS] if c is candidates[0] or c.score > least]
        settled = [self.approach(c.T_mount_cam) for c in near]
        rivals = [Scored(T, score(T)) for T in settled] + list(candidates[len(near) :])
        return distinct(
            rivals, len(rivals), metres=0.06 * self.scene.radius, radians=np.deg2rad(2.5)
        )

    def backgrounds(self, T_mount_cam: F64) -> Backgrounds:
        """The full-size pictures and what is behind the arm at a pose."""
        if self._backgrounds is None:
            self._backgrounds = Backgrounds(self.scene, self.images, T_mount_cam)
        else:
            self._backgrounds.look_behind(T_mount_cam)
        return self._backgrounds

    def masks_at(self, T_mount_cam: F64) -> tuple[ViewMask, ...]:
        """Masks of all views at a pose that is off by a few pixels at most."""
        return tuple(masks_at(self.backgrounds(T_mount_cam), T_mount_cam, self.ids))

    def solve(self, T_mount_cam: F64, masks: Sequence[ViewMask]) -> PoseEstimate:
        """The pose that explains the masks.

        Raises:
            CalibrationError: No view has one.
        """
        seen = [
            Observation(q, m.mask, m.ignore, id=m.view_id)
            for q, m in zip(self.scene.joints, masks, strict=True)
            if m.mask is not None
        ]
        if not seen:
            raise CalibrationError(
                "No image shows the arm where the camera pose that explains the motion best puts "
                "it. Check that joints and images belong together, and the URDF."
            )
        estimate = solve_pose(
            self.rig, self.camera, seen, T_mount_cam, SolveConfig(start_error_px=6.0)
        )
        return replace(estimate, covariance=_SELF_CONFIRMING * estimate.covariance)

    def refine(self, estimate: PoseEstimate) -> tuple[EdgeRefinement, tuple[ViewQuality, ...]]:
        """The edge stage; views that contradict the others lose weight and it is run again."""
        backgrounds = self.backgrounds(estimate.T_mount_cam)
        config = self.config.edges
        refined = refine_edges(backgrounds, estimate, ids=self.ids, config=config)
        quality = self._quality(backgrounds, refined)
        weights = [v.weight for v in quality]
        if min(weights) < 0.75 and sum(w > 0.5 for w in weights) >= FEWEST_VIEWS:
            refined = refine_edges(
                backgrounds, estimate, ids=self.ids, weights=weights, config=config
            )
            quality = self._quality(backgrounds, refined)
        return refined, quality

    def _quality(
        self, backgrounds: Backgrounds, refined: EdgeRefinement
    ) -> tuple[ViewQuality, ...]:
        """At the refined pose, through the lens that goes with it; so are all later masks."""
        self._backgrounds = backgrounds.through(refined.camera)
        return assess_at(self._backgrounds, refined.estimate.T_mount_cam, self.ids)


def calibrate_from_images(
    rig: Rig,
    camera: Camera,
    images: Sequence[U8],
    joints: Sequence[F64],
    *,
    ids: Sequence[str] | None = None,
    config: ClassicalConfig | None = None,
) -> ClassicalResult:
    """Find the camera from images, joints, intrinsics and the URDF alone.

    Args:
        rig: Robot and set-up.
        camera: Intrinsics.
        images: ``(H, W, 3)`` uint8 RGB, one per view.
        joints: ``(n,)`` per view.
        ids: Names of the views.
        config: Settings.

    Raises:
        InputError: Too few views, sizes that do not fit, or a camera that moves with the arm.
        CalibrationError: Nothing moved, or the arm cannot be found.
    """
    config = config or ClassicalConfig()
    timings: dict[str, float] = {}
    clock = time.perf_counter()

    def lap(stage: str) -> None:
        nonlocal clock
        now = time.perf_counter()
        timings[stage], clock = timings.get(stage, 0.0) + now - clock, now

    segmenter = ClassicalSegmenter(rig, camera, images, joints, ids=ids, config=config)
    lap("changes")
    look = _looked(segmenter, lap)
    estimate = look.refinement.estimate
    masks = look.segmenter.masks_at(estimate.T_mount_cam)
    lap("last_masks")
    return ClassicalResult(
        T_mount_cam=estimate.T_mount_cam,
        candidates=look.candidates,
        margin=look.margin,
        masks=masks,
        quality=look.quality,
        estimate=replace(estimate, timings_s={**estimate.timings_s, **timings}),
        before_edges=look.before_edges,
        refinement=look.refinement,
        reasons=_doubts(look, config, camera, len(images)),
        timings_s=timings,
    )


@dataclass(frozen=True)
class _Look:
    """A pose from one kind of change maps.

    Attributes:
        segmenter: It was found with.
        candidates: First poses, best first.
        margin: How much better the best is than the next, as a share of the best; of two looks see
            `_better`.
        before_edges: The pose from the masks.
        refinement: On the edges.
        quality: One per view.
    """

    segmenter: ClassicalSegmenter
    candidates: tuple[Scored, ...]
    margin: float
    before_edges: PoseEstimate
    refinement: EdgeRefinement
    quality: tuple[ViewQuality, ...]

    @property
    def convinces(self) -> bool:
        """Whether no other pose comes near, and edges bear it out."""
        config = self.segmenter.config
        enough = self.refinement.support.share >= config.least_edges
        return enough and self.margin >= config.least_margin

    @property
    def worth(self) -> tuple[bool, float]:
        """Larger for the better of two looks; a little of an outline may lie on edges by chance."""
        support, scene = self.refinement.support, self.segmenter.scene
        config = self.segmenter.config
        length = support.length_px / (scene.camera.width * len(scene))
        seen = length >= config.least_length and support.covered >= config.least_covered
        return seen, support.share

    @classmethod
    def of(cls, segmenter: ClassicalSegmenter, lap: Callable[[str], None]) -> _Look:
        """Look at the pictures; ``lap`` is told when a stage is done.

        Raises:
            CalibrationError: Nothing moved, or the arm cannot be found.
        """
        candidates = segmenter.first_pose()
        lap("first_pose")
        candidates = segmenter.settle(candidates)
        T = candidates[0].T_mount_cam
        lap("region")
        before_edges = segmenter.solve(T, segmenter.masks_at(T))
        lap("masks")
        refinement, quality = segmenter.refine(before_edges)
        lap("edges")
        margin = _margin(candidates)
        return cls(segmenter, tuple(candidates), margin, before_edges, refinement, quality)


def _looked(segmenter: ClassicalSegmenter, lap: Callable[[str], None]) -> _Look:
    """The pose of one look at the pictures, or of the better of two where the first leaves doubt.

    Raises:
        CalibrationError: Nothing moved, or the arm cannot be found, whatever is left out.
    """
    first, failure = None, None
    try:
        first = _Look.of(segmenter, lap)
    except CalibrationError as error:
        if not segmenter.something_moved:
            raise
        failure = error
    if first is not None and first.convinces:
        return first
    other = segmenter.without_shadows()
    lap("changes")
    try:
        second = _Look.of(other, lap)
    except CalibrationError:
        if failure is not None:
            raise failure from None
        second = None
    if first is None or second is None:
        found = first or second
        assert found is not None
        return found
    return _better(first, second)


def _better(first: _Look, second: _Look) -> _Look:
    """Of two looks the one with more edges of the pictures on its outline.

    Where both come to one pose, neither's rivals matter any more than the other's: the larger
    margin counts. Where they come to two, there is a margin only if the edges tell them apart.
    """
    better, other = sorted((first, second), key=lambda look: look.worth, reverse=True)
    poses = [look.refinement.estimate.T_mount_cam for look in (better, other)]
    metres, radians = pose_error(*poses)
    if metres < _SAME_POSE * first.segmenter.scene.radius and radians < _SAME_POSE:
        return replace(better, margin=max(better.margin, other.margin))
    share, rival = (look.refinement.support.share for look in (better, other))
    apart = share > _BORNE_OUT and rival < _BORNE_OUT_ALIKE * share
    return better if apart else replace(better, margin=0.0)


def _margin(candidates: Sequence[Scored]) -> float:
    best = candidates[0].score
    if best <= 0.0:
        return 0.0
    if len(candidates) < 2:
        return 1.0
    return float(np.clip((best - candidates[1].score) / best, 0.0, 1.0))


def _doubts(look: _Look, config: ClassicalConfig, camera: Camera, n_views: int) -> tuple[str, ...]:
    """Reasons why the pose may be wrong."""
    support = look.refinement.support
    reasons = []
    score = look.candidates[0].score
    if score < config.least_explained:
        reasons.append(f"The arm's motion explains only {score:.0%} of what changes in the images.")
    if look.margin < config.least_margin:
        reasons.append("Another camera pose explains the changes in the images nearly as well.")
    if support.share < config.least_edges:
        reasons.append(
            f"Only {support.share:.0%} of the arm's outline lies on an edge of the pictures, "
            f"under {config.least_edges:.0%}."
        )
    if support.length_px < config.least_length * camera.width * n_views:
        reasons.append("Only a short piece of the arm's outline is visible.")
    if support.covered < config.least_covered:
        reasons.append(f"The arm covers only {support.covered:.1%} of the images.")
    return tuple(reasons)


def _check(rig: Rig, images: Sequence[U8], joints: Sequence[F64]) -> None:
    if rig.mount != rig.robot.base_link:
        raise InputError(
            "the classical way needs a camera that stands still, not one that rides on the arm",
            where="setup",
            expected="eye-to-hand",
            fix="give masks, or name a segmenter with weights",
        )
    if len(images) != len(joints):
        raise InputError(f"{len(images)} images but joints for {len(joints)} views")
    if len(images) < FEWEST_VIEWS:
        raise InputError(
            f"there are {len(images)} views",
            expected=f"at least {FEWEST_VIEWS}: the background is learnt from the others",
            fix="take more views, or give masks",
        )
