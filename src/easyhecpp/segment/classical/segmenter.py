"""The steps of the classical way on one set of pictures: first pose, region, masks, edges."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from easyhecpp.camera import Camera
from easyhecpp.errors import CalibrationError, InputError
from easyhecpp.rig import Rig
from easyhecpp.segment.backgrounds import Backgrounds
from easyhecpp.segment.classical.change import ChangeMaps, change_maps, pairs_to_compare
from easyhecpp.segment.classical.first_pose import FINAL_TOLERANCE, FirstPoseConfig, first_pose
from easyhecpp.segment.classical.grid import TURNED_FINE
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

_REGION_SIZE = 640
"""Longer side of the pictures that the region stage looks at; the search takes half of it."""

_SELF_CONFIRMING = 4.0
"""On the covariance of a pose from masks that were made with a prediction of that pose."""

_RIVAL, _MOST_RIVALS = 0.4, 3
"""Candidates that are looked at closer: with this share of the best one's score, and how many."""

_COARSE = (Round(12, 6.0, 3), Round(8, 3.0, 4))
_FINE = (Round(6, 2.0, 3, bracketed=True),)


@dataclass(frozen=True)
class ClassicalConfig:
    """Settings of the classical way.

    Attributes:
        search: How wide the first pose is looked for.
        thorough_search: The same, where that finds no pose that edges bear out.
        edges: The edge stage.
        least_explained: Share of the change that the arm's motion must explain.
        least_margin: How much better than the next different pose, as a share of the best.
        least_edges: Share of the contour that must lie on image edges.
        least_length: Length of visible contour per view, in longer sides of the image.
        least_covered: Share of the image that the arm must cover on average.
    """

    search: FirstPoseConfig = field(default_factory=FirstPoseConfig)
    thorough_search: FirstPoseConfig = field(
        default_factory=lambda: FirstPoseConfig(grids=((TURNED_FINE, 16),))
    )
    edges: EdgeConfig = field(default_factory=EdgeConfig)
    least_explained: float = 0.08
    least_margin: float = 0.15
    least_edges: float = 0.36
    least_length: float = 0.4
    least_covered: float = 0.01


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
        reduction = max(1, round(max(camera.width, camera.height) / _REGION_SIZE))
        self.pictures: Pictures = load_pictures(images, camera, reduction)
        pairs = pairs_to_compare(self.scene.motion)
        self.changes: ChangeMaps = change_maps(self.pictures.reduced(2), pairs)
        self._backgrounds: Backgrounds | None = None

    def without_shadows(self) -> ClassicalSegmenter:
        """The same, for which what may be a shadow is no sign of the arm; see `change_maps`."""
        other = self.anew()
        pairs = self.changes.pairs
        other.changes = change_maps(self.pictures.reduced(2), pairs, shadows=False)
        return other

    def thorough(self) -> ClassicalSegmenter:
        """The same, which spends several times as long on the search for the first pose."""
        other = self.anew()
        other.config = replace(self.config, search=self.config.thorough_search)
        return other

    def anew(self) -> ClassicalSegmenter:
        """The same with plates, lens and joints as before the first pose was found."""
        other = copy(self)
        if self._backgrounds is not None:
            # The plates are large, belong to a pose, and are made anew for the next.
            self._backgrounds.plates.clear()
            # The lens and the joints that were found belong to that pose too.
            other._backgrounds = self._backgrounds.with_scene(self.scene)
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
        """At the refined pose, with the lens and joints that go with it; so are all later masks."""
        self._backgrounds = backgrounds.with_scene(refined.scene)
        return assess_at(self._backgrounds, refined.estimate.T_mount_cam, self.ids)


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
