"""The arm among what a text prompt found: the one whose masks the joints explain in all views.

A text model finds every robot arm in a picture, its reflection, and sometimes the table. Each is
kept as a hypothesis. A camera pose guessed from one hypothesis predicts all the other views; only
for the arm whose joints were recorded do the predictions meet a mask each time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from easyhecpp.camera import Camera
from easyhecpp.capture import Capture
from easyhecpp.errors import CalibrationError
from easyhecpp.render import SilhouetteRenderer
from easyhecpp.rig import Rig
from easyhecpp.segment.protocols import (
    BoolArray,
    CaptureMasks,
    FloatArray,
    PoseBelief,
    TextSegmenter,
    ViewMask,
    image_of,
    require_usable,
)
from easyhecpp.solve import Observation

F32 = NDArray[np.float32]
Assignment = tuple[tuple[int, ...], ...]

FirstPose = Callable[[Rig, Camera, Sequence[Observation]], Sequence[FloatArray]]
"""Finds camera poses from rough masks: candidates of T_mount_cam (4, 4), best first."""


@dataclass(frozen=True)
class ChoiceConfig:
    """How the arm is chosen among hypotheses.

    Attributes:
        anchors: in how many views each hypothesis may found a pose of its own.
        candidates: how many poses a hypothesis may propose.
        refined: how many of the best sets of hypotheses are solved again, all views together.
        rounds: how often at most that is repeated.
        min_iou: a hypothesis that overlaps the prediction less does not explain its view.
        settled_iou: the models' favourites are believed at once when each overlaps this much.
        min_score: mean IoU over the views below which nothing is believed to be the arm.
        width: px to which masks are shrunk for comparing.
    """

    anchors: int = 3
    candidates: int = 4
    refined: int = 3
    rounds: int = 3
    min_iou: float = 0.3
    settled_iou: float = 0.75
    min_score: float = 0.35
    width: int = 320


@dataclass(frozen=True)
class Hypotheses:
    """What was found in one view.

    Attributes:
        view_id: the view.
        joints: (n,) where the arm was.
        masks: (N, H, W) bool, the model's favourite first.
    """

    view_id: str
    joints: FloatArray
    masks: BoolArray


@dataclass(frozen=True)
class ArmChoice:
    """The arm, chosen over all views.

    Attributes:
        T_mount_cam: the pose that explains the masks.
        assignment: for each view the hypotheses that together are the arm; empty for none.
        ious: (views,) overlap of these with the prediction; 0 where there are none.
        score: mean of ``ious`` over the views in which something was found.
        rival: score of the best choice that takes another thing in at least half of the views; 0
            when there is none.
    """

    T_mount_cam: FloatArray
    assignment: Assignment
    ious: FloatArray
    score: float
    rival: float

    @property
    def clear(self) -> bool:
        """Whether no other thing explains the views nearly as well."""
        return self.score - self.rival >= 0.1


def masks_from_text(
    capture: Capture,
    segmenter: TextSegmenter,
    text: str,
    first_pose: FirstPose | None = None,
    config: ChoiceConfig | None = None,
) -> CaptureMasks:
    """First masks of the arm, and a first pose, from text.

    Args:
        capture: the capture; every view needs an image.
        segmenter: the text model.
        text: what it looks for.
        first_pose: finds poses from rough masks; None for sampling (the paper's way).
        config: settings.

    Raises:
        InputError: a view without an image; nothing found in any view.
        CalibrationError: nothing that was found moves as the joints do.
    """
    found = [
        Hypotheses(view.id, view.joints, segmenter.segment(image_of(capture, i), text).masks)
        for i, view in enumerate(capture.views)
    ]
    nothing = f"{segmenter.name} found no '{text}'."
    require_usable(
        [
            ViewMask(h.view_id, _any(h.masks), notes=() if len(h.masks) else (nothing,))
            for h in found
        ],
        segmenter.name,
    )
    choice = choose_arm(capture.rig, capture.camera, found, first_pose or sampled_poses, config)
    views = tuple(_chosen(h, choice, i, nothing) for i, h in enumerate(found))
    notes = () if choice.clear else (_UNCLEAR,)
    return CaptureMasks(views, PoseBelief(choice.T_mount_cam), notes)


def choose_arm(
    rig: Rig,
    camera: Camera,
    found: Sequence[Hypotheses],
    first_pose: FirstPose,
    config: ChoiceConfig | None = None,
) -> ArmChoice:
    """The hypotheses that the joints explain best, over all views.

    Args:
        rig: robot and set-up.
        camera: the camera.
        found: the hypotheses of each view; some views may have none, not all.
        first_pose: finds poses from rough masks.
        config: settings.

    Raises:
        CalibrationError: no choice explains the views.
    """
    config = config or ChoiceConfig()
    chooser = _Chooser(rig, camera, found, first_pose, config)
    favourites = tuple((0,) if len(h.masks) else () for h in found)
    tried = list(chooser.proposals(favourites))
    if all(trial.worst < config.settled_iou for trial in tried):
        for assignment in _anchor_assignments(found, config.anchors):
            tried += chooser.proposals(assignment)
        tried += [chooser.refined(trial) for trial in _best_distinct(tried, config.refined)]
    best = max(tried, key=lambda trial: trial.score, default=None)
    if best is None or best.score < config.min_score:
        score = 0.0 if best is None else best.score
        raise CalibrationError(
            "Nothing that the text model found moves as the joints say: the best choice overlaps "
            f"the predicted arm by {score:.2f} only (IoU, {config.min_score} is asked for). Are "
            "the joints those of the views, and is it this robot? Else try another model, or "
            "--segmenter classical, which needs no text model."
        )
    rivals = [t.score for t in tried if _differs(t.assignment, best.assignment)]
    return ArmChoice(
        best.T_mount_cam, best.assignment, best.ious, best.score, max(rivals, default=0.0)
    )


def sampled_poses(
    rig: Rig, camera: Camera, observations: Sequence[Observation]
) -> list[FloatArray]:
    """Candidate poses by sampling around the arm, best first (paper, pose initialisation)."""
    from easyhecpp.initialise import sample_initial_pose

    result = sample_initial_pose(rig, camera, observations)
    return [T_mount_cam for T_mount_cam, _ in result.candidates] or [result.T_mount_cam]


@dataclass(frozen=True)
class _Trial:
    """A pose, and what of the hypotheses it explains."""

    T_mount_cam: FloatArray
    assignment: Assignment
    ious: FloatArray
    found: BoolArray

    @property
    def score(self) -> float:
        return float(self.ious[self.found].mean())

    @property
    def worst(self) -> float:
        return float(self.ious[self.found].min())


class _Chooser:
    """Poses from hypotheses, and hypotheses from poses."""

    def __init__(
        self,
        rig: Rig,
        camera: Camera,
        found: Sequence[Hypotheses],
        first_pose: FirstPose,
        config: ChoiceConfig,
    ) -> None:
        self.rig, self.camera, self.found = rig, camera, found
        self.first_pose, self.config = first_pose, config
        small = camera.scaled(min(1.0, config.width / camera.width))
        self.renderer = SilhouetteRenderer(rig.robot.meshes, small)
        self.small = [_shrunk(h.masks, (small.width, small.height)) for h in found]
        self.has_any = np.array([len(h.masks) > 0 for h in found])

    def proposals(self, assignment: Assignment) -> Iterator[_Trial]:
        """Poses that the masks of an assignment suggest, each with all that it explains."""
        observations = [
            Observation(joints=h.joints, mask=h.masks[list(chosen)].any(axis=0), id=h.view_id)
            for h, chosen in zip(self.found, assignment, strict=True)
            if chosen
        ]
        if observations:
            poses = self.first_pose(self.rig, self.camera, observations)
            for T_mount_cam in poses[: self.config.candidates]:
                yield self.explained(T_mount_cam)

    def explained(self, T_mount_cam: FloatArray) -> _Trial:
        """For each view the hypotheses that together overlap the predicted arm best."""
        assignment, ious = [], []
        for h, masks in zip(self.found, self.small, strict=True):
            arm = self.renderer.coverage(self.rig.Ts_cam_link(T_mount_cam, h.joints))
            chosen, iou = _best_union(masks, arm)
            explains = iou >= self.config.min_iou
            assignment.append(chosen if explains else ())
            ious.append(iou if explains else 0.0)
        return _Trial(T_mount_cam, tuple(assignment), np.array(ious), self.has_any)

    def refined(self, trial: _Trial) -> _Trial:
        """The same arm, with the pose from all of its views."""
        for _ in range(self.config.rounds):
            again = max(self.proposals(trial.assignment), key=lambda t: t.score, default=trial)
            if again.score <= trial.score:
                return trial
            settled = again.assignment == trial.assignment
            trial = again
            if settled:
                return trial
        return trial


def _anchor_assignments(found: Sequence[Hypotheses], anchors: int) -> Iterator[Assignment]:
    """One hypothesis of one view each, in the views that found the fewest."""
    views = sorted((len(h.masks), i) for i, h in enumerate(found) if len(h.masks))
    for count, view in views[:anchors]:
        for hypothesis in range(count):
            yield tuple((hypothesis,) if i == view else () for i in range(len(found)))


def _best_union(masks: F32, arm: F32) -> tuple[tuple[int, ...], float]:
    """The hypothesis that overlaps the arm best, with others added as long as that helps."""
    chosen: list[int] = []
    union, best = np.zeros_like(arm), 0.0
    while len(chosen) < len(masks):
        scores = [
            0.0 if i in chosen else _iou(np.maximum(union, mask), arm)
            for i, mask in enumerate(masks)
        ]
        i = int(np.argmax(scores))
        # A part has to bring something: the arm in two pieces, not a sliver of the other arm.
        if scores[i] < best + (0.02 if chosen else 1e-9):
            break
        chosen.append(i)
        union, best = np.maximum(union, masks[i]), scores[i]
    return tuple(sorted(chosen)), best


def _iou(a: F32, b: F32) -> float:
    either = float(np.maximum(a, b).sum())
    return float(np.minimum(a, b).sum()) / either if either else 0.0


def _best_distinct(trials: Sequence[_Trial], count: int) -> list[_Trial]:
    """The best trial of each assignment, best first."""
    best: dict[Assignment, _Trial] = {}
    for trial in sorted(trials, key=lambda t: -t.score):
        best.setdefault(trial.assignment, trial)
    return list(best.values())[:count]


def _differs(assignment: Assignment, other: Assignment) -> bool:
    """Whether two assignments see different things as the arm in at least half of the views."""
    pairs = [(set(a), set(b)) for a, b in zip(assignment, other, strict=True) if a or b]
    return 2 * sum(not (a & b) for a, b in pairs) >= len(pairs) > 0


def _chosen(h: Hypotheses, choice: ArmChoice, index: int, nothing: str) -> ViewMask:
    chosen = list(choice.assignment[index])
    if chosen:
        others = len(h.masks) - len(chosen)
        notes = (f"{others} other detections are not this arm.",) if others else ()
        mask = h.masks[chosen].any(axis=0)
        return ViewMask(h.view_id, mask, score=float(choice.ious[index]), notes=notes)
    unexplained = "Nothing that was found lies where the joints put the arm."
    return ViewMask(h.view_id, None, score=0.0, notes=(unexplained if len(h.masks) else nothing,))


def _any(masks: BoolArray) -> BoolArray | None:
    return masks.any(axis=0) if len(masks) else None


def _shrunk(masks: BoolArray, size: tuple[int, int]) -> F32:
    """Masks (N, H, W) as shares of covered area at another (width, height)."""
    small = [cv2.resize(m.astype(np.float32), size, interpolation=cv2.INTER_AREA) for m in masks]
    return np.stack(small) if small else np.zeros((0, size[1], size[0]), dtype=np.float32)


_UNCLEAR = (
    "Two of the things that the text model found explain the joints almost equally well: check in "
    "the report that the outlined arm is the one whose joints were recorded."
)
