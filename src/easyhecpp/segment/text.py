"""The arm among what a text prompt found: the one whose masks the joints explain in all views.

A text model finds every robot arm in a picture, its reflection, and sometimes the table. Each is
kept as a hypothesis. A camera pose guessed from one hypothesis predicts all the other views; only
for the arm whose joints were recorded do the predictions meet a mask each time.

What stays put proves nothing: a table in every view is "explained" by a camera so close that the
base fills that part of the image. So pixels that a pose predicts as arm in ALL views do not count.
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
from easyhecpp.initialise import sample_initial_pose
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
    union,
)
from easyhecpp.solve import Observation

_OUTLIER = 0.6  # of the views' median overlap

_CLEAR_SCORE, _CLEAR_MARGIN = 0.6, 0.1
_LOOK = "Check that the outlined arm is the one whose joints were recorded."

F32 = NDArray[np.float32]
Assignment = tuple[tuple[int, ...], ...]

FirstPose = Callable[[Rig, Camera, Sequence[Observation]], Sequence[FloatArray]]
"""Finds camera poses from rough masks: candidates of T_mount_cam (4, 4), best first."""


@dataclass(frozen=True)
class ChoiceConfig:
    """How the arm is chosen among hypotheses.

    Attributes:
        anchors: how many single hypotheses at most may found a pose.
        refined: how many of the best sets of hypotheses are solved again, several views together.
        rounds: how often at most that is repeated.
        views: how many views at most are solved together.
        min_iou: a hypothesis that overlaps the prediction less does not explain its view.
        promising_iou: a choice that overlaps this much on average is solved again at once.
        settled_iou: the search ends with a choice that overlaps this much in every view.
        min_score: mean overlap below which nothing is believed to be the arm.
        width: px to which masks are shrunk for comparing.
    """

    anchors: int = 16
    refined: int = 3
    rounds: int = 3
    views: int = 6
    min_iou: float = 0.25
    promising_iou: float = 0.4
    settled_iou: float = 0.6
    min_score: float = 0.3
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
        ious: (views,) overlap of these with the prediction, without what stays put; 0 where there
            are none.
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
    def margin(self) -> float:
        """By how much the mean overlap beats that of the best rival."""
        return self.score - self.rival

    @property
    def doubts(self) -> tuple[str, ...]:
        """Why it may be the wrong thing, sentences; none when it is clear."""
        doubts: list[str] = []
        if self.score < _CLEAR_SCORE:
            doubts.append(
                "The joints explain what the text model found poorly (mean overlap "
                f"{self.score:.2f}). {_LOOK}"
            )
        if self.margin < _CLEAR_MARGIN:
            doubts.append(
                "Two things that the text model found are explained by the joints about as well "
                f"(mean overlap {self.score:.2f} and {self.rival:.2f}). {_LOOK}"
            )
        return tuple(doubts)


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
    found = [_found(capture, i, segmenter, text) for i in range(len(capture.views))]
    nothing = f"{segmenter.name} found no '{text}'."
    none_found = tuple(ViewMask(h.view_id, None, notes=(nothing,)) for h in found)
    if not any(len(h.masks) for h in found):
        require_usable(none_found, segmenter.name)
    choice = choose_arm(capture.rig, capture.camera, found, first_pose or sampled_poses, config)
    views = tuple(_chosen(h, choice, i, nothing) for i, h in enumerate(found))
    return CaptureMasks(
        views, PoseBelief(choice.T_mount_cam), doubts=choice.doubts, margin=choice.margin
    )


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
    tried = _Chooser(rig, camera, found, first_pose, config).search()
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
    # Where the arm itself was not found, something else may overlap the prediction a little.
    fits = best.ious >= _OUTLIER * np.median(best.ious[best.ious > 0])
    return ArmChoice(
        best.T_mount_cam,
        tuple(c if fit else () for c, fit in zip(best.assignment, fits, strict=True)),
        np.where(fits, best.ious, 0.0),
        best.score,
        max(rivals, default=0.0),
    )


def sampled_poses(
    rig: Rig, camera: Camera, observations: Sequence[Observation]
) -> list[FloatArray]:
    """Candidate poses by sampling around the arm, best first (paper, pose initialisation)."""
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
        self._proposed: dict[Assignment, list[_Trial]] = {}

    def search(self) -> list[_Trial]:
        """Poses founded on the models' favourites, then on single hypotheses, until one settles."""
        tried: list[_Trial] = []
        for assignment in _starts(self.found, self.config):
            tried += self.proposals(assignment)
            best = max(tried, key=lambda trial: trial.score, default=None)
            if best is not None and best.score >= self.config.promising_iou:
                tried.append(self.refined(best))
                if tried[-1].worst >= self.config.settled_iou:
                    return tried
        return tried + [self.refined(t) for t in _best_distinct(tried, self.config.refined)]

    def proposals(self, assignment: Assignment) -> list[_Trial]:
        """Poses that the masks of an assignment suggest, each with all that it explains."""
        if assignment not in self._proposed:
            observations = [
                Observation(joints=h.joints, mask=union(h.masks[list(chosen)]), id=h.view_id)
                for h, chosen in zip(self.found, assignment, strict=True)
                if chosen
            ]
            poses = self.first_pose(self.rig, self.camera, observations) if observations else []
            self._proposed[assignment] = [self.explained(pose) for pose in poses]
        return self._proposed[assignment]

    def explained(self, T_mount_cam: FloatArray) -> _Trial:
        """For each view the hypotheses that together overlap the predicted arm best."""
        joints = np.stack([h.joints for h in self.found])
        Ts_cam_link = self.rig.Ts_cam_link(T_mount_cam, joints)
        arms = [self.renderer.coverage(Ts) for Ts in Ts_cam_link]
        # With one view nothing moves, and all of it has to count.
        moves = 1.0 - np.min(arms, axis=0) if len(arms) > 1 else np.ones_like(arms[0])
        assignment, ious = [], []
        for masks, arm in zip(self.small, arms, strict=True):
            chosen, iou = _best_union(masks * moves, arm * moves)
            explains = iou >= self.config.min_iou
            assignment.append(chosen if explains else ())
            ious.append(iou if explains else 0.0)
        return _Trial(T_mount_cam, tuple(assignment), np.array(ious), self.has_any)

    def refined(self, trial: _Trial) -> _Trial:
        """The same arm, with the pose from those of its views that are explained best."""
        for _ in range(self.config.rounds):
            best = np.argsort(-trial.ious, kind="stable")[: self.config.views]
            kept = tuple(c if i in best else () for i, c in enumerate(trial.assignment))
            again = max(self.proposals(kept), key=lambda t: t.score, default=trial)
            if again.score <= trial.score:
                return trial
            settled = again.assignment == trial.assignment
            trial = again
            if settled:
                return trial
        return trial


def _starts(found: Sequence[Hypotheses], config: ChoiceConfig) -> Iterator[Assignment]:
    """Favourites of some views together; then one hypothesis each, where there are fewest."""
    views = [i for i, h in enumerate(found) if len(h.masks)]
    spread = {views[k] for k in np.linspace(0, len(views) - 1, config.views).round().astype(int)}
    yield tuple((0,) if i in spread else () for i in range(len(found)))
    # Of views with as many hypotheses, those that show most of something say most about a pose.
    views.sort(key=lambda i: (len(found[i].masks), -int(found[i].masks.sum())))
    singles = [(i, k) for i in views for k in range(len(found[i].masks))]
    for view, hypothesis in singles[: config.anchors]:
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
    return float(np.minimum(a, b).sum()) / either if either > 1.0 else 0.0


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


def _found(capture: Capture, index: int, segmenter: TextSegmenter, text: str) -> Hypotheses:
    masks = segmenter.segment(image_of(capture, index), text).masks
    view = capture.views[index]
    return Hypotheses(view.id, view.joints, masks[masks.any(axis=(1, 2))])


def _chosen(h: Hypotheses, choice: ArmChoice, index: int, nothing: str) -> ViewMask:
    chosen = list(choice.assignment[index])
    if chosen:
        others = len(h.masks) - len(chosen)
        notes = (f"{others} other detections are not this arm.",) if others else ()
        mask = union(h.masks[chosen])
        return ViewMask(h.view_id, mask, score=float(choice.ious[index]), notes=notes)
    unexplained = "Nothing that was found lies where the joints put the arm."
    return ViewMask(h.view_id, None, score=0.0, notes=(unexplained if len(h.masks) else nothing,))


def _shrunk(masks: BoolArray, size: tuple[int, int]) -> F32:
    """Masks (N, H, W) as shares of covered area at another (width, height)."""
    small = [cv2.resize(m.astype(np.float32), size, interpolation=cv2.INTER_AREA) for m in masks]
    return np.stack(small) if small else np.zeros((0, size[1], size[0]), dtype=np.float32)
