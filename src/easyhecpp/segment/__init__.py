"""Masks of the arm: what makes them, and what the kinematics have to say about them."""

from __future__ import annotations

from easyhecpp.segment.autosam import AutoSam, AutoSamConfig
from easyhecpp.segment.encoding import RememberingSegmenter
from easyhecpp.segment.grounded import GroundedSegmenter
from easyhecpp.segment.judge import JudgeConfig, Judgement, Prior, judge
from easyhecpp.segment.prompts import (
    DEFAULT_VARIANT,
    VARIANTS,
    ArmPrompts,
    Variant,
    arm_prompts,
    padding_from_covariance,
)
from easyhecpp.segment.protocols import (
    CaptureMasks,
    EncodedImage,
    MaskSource,
    PoseBelief,
    PromptableSegmenter,
    Prompts,
    ScoredBoxes,
    ScoredMasks,
    TextDetector,
    TextSegmenter,
    ViewMask,
)
from easyhecpp.segment.text import ArmChoice, ChoiceConfig, choose_arm, masks_from_text

__all__ = [
    "DEFAULT_VARIANT",
    "VARIANTS",
    "ArmChoice",
    "ArmPrompts",
    "AutoSam",
    "AutoSamConfig",
    "CaptureMasks",
    "ChoiceConfig",
    "EncodedImage",
    "GroundedSegmenter",
    "JudgeConfig",
    "Judgement",
    "MaskSource",
    "PoseBelief",
    "Prior",
    "PromptableSegmenter",
    "Prompts",
    "RememberingSegmenter",
    "ScoredBoxes",
    "ScoredMasks",
    "TextDetector",
    "TextSegmenter",
    "Variant",
    "ViewMask",
    "arm_prompts",
    "choose_arm",
    "judge",
    "masks_from_text",
    "padding_from_covariance",
]
