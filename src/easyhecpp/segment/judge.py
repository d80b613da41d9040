"""Masks against the kinematic prior: which to trust, and where the union says nothing.

A promptable segmenter outlines whatever thing a box seems to mean. The arm's predicted silhouette
says where that thing must be: a mask that lies largely elsewhere is a table, a second arm or a
tool, and would pull the pose.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from easyhecpp.segment.protocols import BoolArray, FloatArray, union


@dataclass(frozen=True)
class JudgeConfig:
    """When a mask is believed.

    Attributes:
        max_spill: largest share of a mask that may lie beyond the predicted arm.
        min_link_cover: share of a link's visible part that the union must cover for the link to
            count as segmented.
        min_arm_cover: the same for all of the arm; below, the view has no usable mask.
        slack_px: by how much the prediction is widened on top of the pose's uncertainty, for
            meshes that are not quite the robot and masks that are not quite sharp.
    """

    max_spill: float = 0.25
    min_link_cover: float = 0.5
    min_arm_cover: float = 0.5
    slack_px: float = 4.0


@dataclass(frozen=True)
class Prior:
    """What the kinematics predict for one view.

    Attributes:
        visible: (H, W) index of the nearest link, -1 for none.
        link_names: the L links.
        margin_px: (L,) how far each link may be from where it is predicted.
    """

    visible: NDArray[np.integer]
    link_names: Sequence[str]
    margin_px: FloatArray

    @property
    def arm(self) -> BoolArray:
        """(H, W) where the arm is predicted."""
        return self.visible >= 0


@dataclass(frozen=True)
class Judgement:
    """What became of a view's masks.

    Attributes:
        mask: (H, W) bool, the union of those accepted; None when the view has no usable mask.
        ignore: (H, W) bool, where the union says nothing.
        agreement: IoU of mask and predicted arm outside ``ignore``; 0 without a mask.
        rejected: for each mask the reason why it was rejected, None for the accepted.
        notes: sentences for the user.
    """

    mask: BoolArray | None
    ignore: BoolArray
    agreement: float
    rejected: tuple[str | None, ...]
    notes: tuple[str, ...]


def judge(
    masks: BoolArray,
    labels: Sequence[str],
    prior: Prior,
    config: JudgeConfig | None = None,
) -> Judgement:
    """Unite the masks that agree with the kinematics.

    Args:
        masks: (N, H, W).
        labels: what each mask was asked for.
        prior: the kinematics' prediction.
        config: thresholds.
    """
    config = config or JudgeConfig()
    margin = float(prior.margin_px.max(initial=0.0)) + config.slack_px
    beyond = _distance_to(prior.arm) > margin
    rejected = tuple(
        _reason(mask, label, beyond, config) for mask, label in zip(masks, labels, strict=True)
    )
    notes = [reason for reason in rejected if reason is not None]
    accepted = [i for i, reason in enumerate(rejected) if reason is None]
    united = union(masks[accepted])

    unseen, link_notes = _links_not_covered(united, prior, config)
    # A little of what lies beyond comes with many masks (a tool, a cable). Nobody knows where it
    # begins, so the arm's outline close to it is not used either.
    spilt = united & beyond
    near_spill = _distance_to(spilt) <= 2 * margin if spilt.any() else spilt
    ignore = unseen | near_spill
    mask = united & ~beyond

    believed = prior.arm & ~ignore
    cover = _share(mask, believed)
    if not accepted or cover < config.min_arm_cover:
        notes.insert(0, _no_mask(len(masks), len(accepted), cover))
        return Judgement(None, ignore, 0.0, rejected, tuple(notes))
    either = (mask | prior.arm) & ~ignore
    agreement = float((mask & believed).sum() / max(either.sum(), 1))
    return Judgement(mask, ignore, agreement, rejected, (*notes, *link_notes))


def _reason(mask: BoolArray, label: str, beyond: BoolArray, config: JudgeConfig) -> str | None:
    area = int(mask.sum())
    if area == 0:
        return f"The mask of {label} is empty."
    spill = float((mask & beyond).sum()) / area
    if spill <= config.max_spill:
        return None
    what = "it is another thing" if spill > 0.9 else "it has swallowed something beside the arm"
    return f"The mask of {label} is rejected: {spill:.0%} of it lies off the arm; {what}."


def _links_not_covered(
    united: BoolArray, prior: Prior, config: JudgeConfig
) -> tuple[BoolArray, list[str]]:
    """Where links are that the union leaves out, widened by their margin; and sentences."""
    ignore = np.zeros_like(united)
    notes = []
    distance = _distance_to(united)
    for link, name in enumerate(prior.link_names):
        region = prior.visible == link
        if not region.any():
            continue
        margin = float(prior.margin_px[link]) + config.slack_px
        # A link that is thinner than the pose is unsure may miss its own mask altogether.
        cover = float((distance[region] <= margin - config.slack_px).mean())
        if cover < config.min_link_cover:
            ignore |= _distance_to(region) <= margin
            notes.append(f"No mask covers {name} ({cover:.0%} of it): its outline is not used.")
    return ignore, notes


def _no_mask(asked: int, accepted: int, cover: float) -> str:
    if accepted == 0:
        return f"None of the {asked} masks agrees with the kinematics."
    return (
        f"The masks that agree with the kinematics cover {cover:.0%} of the arm as predicted: "
        "the pose or the masks are wrong, so this view is left out."
    )


def _share(mask: BoolArray, region: BoolArray) -> float:
    return float((mask & region).sum() / max(region.sum(), 1))


def _distance_to(region: BoolArray) -> NDArray[np.float32]:
    """Distance of each pixel to the nearest pixel of a region, px; large when it is empty."""
    if not region.any():
        return np.full(region.shape, np.float32(1e9))
    away = np.ascontiguousarray(~region).view(np.uint8)
    distance = cv2.distanceTransform(away, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return distance.astype(np.float32, copy=False)
