"""AutoSAM: the kinematic model prompts a segmenter, link by link, and checks what comes back."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from easyhecpp.capture import Capture
from easyhecpp.errors import InputError
from easyhecpp.render import SilhouetteRenderer
from easyhecpp.segment.judge import JudgeConfig, Judgement, Prior, judge
from easyhecpp.segment.prompts import (
    DEFAULT_VARIANT,
    ArmPrompts,
    arm_prompts,
    padding_from_covariance,
)
from easyhecpp.segment.protocols import (
    CaptureMasks,
    FloatArray,
    PoseBelief,
    PromptableSegmenter,
    ScoredMasks,
    TextSegmenter,
    ViewMask,
    image_of,
    require_usable,
)
from easyhecpp.segment.text import FirstPose, masks_from_text

DEFAULT_TEXT = "robot arm"


@dataclass(frozen=True)
class AutoSamConfig:
    """Settings of AutoSAM.

    Attributes:
        variant: row of the paper's table on prompts, ``a`` to ``f``.
        unknown_error_px: how far a link may be from where it is predicted when the pose comes
            without a covariance.
        text: what the text model looks for, before there is a pose.
        judge: when a mask is believed.
    """

    variant: str = DEFAULT_VARIANT
    unknown_error_px: float = 10.0
    text: str = DEFAULT_TEXT
    judge: JudgeConfig = field(default_factory=JudgeConfig)


@dataclass(frozen=True)
class Prediction:
    """What the kinematics say of one view before its image is looked at.

    Attributes:
        boxes: (L, 4) of the links' visible parts, px; nan for none.
        prior: where the links are visible, and how sure that is.
        padding_px: (L, 2) by how much a link's box grows.
        parents: (L,) for each link the next one with geometry towards the base, -1 for none.
    """

    boxes: FloatArray
    prior: Prior
    padding_px: FloatArray
    parents: tuple[int, ...]

    def prompts(self, variant: str) -> ArmPrompts:
        """The prompts of a variant of the paper's table."""
        return arm_prompts(
            self.boxes,
            self.prior.visible,
            self.prior.link_names,
            self.parents,
            variant,
            self.padding_px,
        )


class AutoSam:
    """A ``MaskSource``: text for the first masks, AutoSAM once a pose is known.

    Args:
        segmenter: outlines what a box points at. Wrap it in ``RememberingSegmenter`` when masks
            are made more than once.
        text: finds the arm without a pose; None when a first pose comes from elsewhere.
        config: settings.
        first_pose: finds a pose from rough masks; None for sampling (the paper's way).
    """

    def __init__(
        self,
        segmenter: PromptableSegmenter,
        text: TextSegmenter | None = None,
        config: AutoSamConfig | None = None,
        first_pose: FirstPose | None = None,
    ) -> None:
        self.segmenter = segmenter
        self.text = text
        self.config = config or AutoSamConfig()
        self.first_pose = first_pose

    @property
    def name(self) -> str:
        """The models' names."""
        return self.segmenter.name if self.text is None else self.text.name

    def masks(self, capture: Capture, belief: PoseBelief | None = None) -> CaptureMasks:
        """Masks of the arm in every view.

        Args:
            capture: the capture.
            belief: the pose so far; None asks the text model, which finds a first pose, too.

        Raises:
            InputError: a view without an image, no belief and no text model, or no view in which
                a usable mask could be made.
        """
        if belief is None:
            if self.text is None:
                raise _needs_pose(self.segmenter.name)
            return masks_from_text(capture, self.text, self.config.text, self.first_pose)
        renderer = SilhouetteRenderer(capture.robot.meshes, capture.camera)
        views = tuple(
            self._view(capture, index, belief, renderer) for index in range(len(capture.views))
        )
        require_usable(views, self.segmenter.name)
        return CaptureMasks(views, belief)

    def _view(
        self, capture: Capture, index: int, belief: PoseBelief, renderer: SilhouetteRenderer
    ) -> ViewMask:
        view_id = capture.views[index].id
        prediction = predict(capture, index, belief, renderer, self.config.unknown_error_px)
        asked = prediction.prompts(self.config.variant)
        if asked.prompts is None:
            return ViewMask(view_id, None, notes=("The arm is out of view.", *asked.skipped))
        encoded = self.segmenter.encode(image_of(capture, index))
        judgement = self.judged(encoded.predict(asked.prompts), asked, prediction)
        return ViewMask(
            view_id,
            judgement.mask,
            judgement.ignore,
            judgement.agreement,
            (*judgement.notes, *asked.skipped),
        )

    def judged(self, answer: ScoredMasks, asked: ArmPrompts, prediction: Prediction) -> Judgement:
        """The union of the masks that agree with the kinematics."""
        return judge(answer.masks, asked.labels, prediction.prior, self.config.judge)


def predict(
    capture: Capture,
    index: int,
    belief: PoseBelief,
    renderer: SilhouetteRenderer,
    unknown_error_px: float,
) -> Prediction:
    """What the kinematics and the pose say of one view.

    Args:
        capture: the capture.
        index: which view.
        belief: the pose, and how sure it is.
        renderer: of the capture's robot and camera.
        unknown_error_px: see ``AutoSamConfig``.
    """
    robot = capture.robot
    Ts_cam_link = capture.rig.Ts_cam_link(belief.T_mount_cam, capture.views[index].joints)
    if belief.covariance is None:
        padding = np.full((len(robot.meshes), 2), unknown_error_px)
    else:
        padding = padding_from_covariance(
            capture.camera, robot.meshes, Ts_cam_link, belief.covariance
        )
    prior = Prior(renderer.visible_links(Ts_cam_link), robot.link_names, padding.max(axis=1))
    return Prediction(renderer.boxes(Ts_cam_link), prior, padding, robot.link_parents)


def _needs_pose(name: str) -> InputError:
    return InputError(
        f"the model {name} turns boxes into masks and cannot find the arm by itself",
        expected="a pose to project the boxes with, or a segmenter with a text model",
        fix="take a pair such as grounded-sam, or --segmenter classical for the first pose",
    )
