"""The report's sentences: what the verdict means, why it was given, what to do next."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from easyhecpp.formats.result_file import ResultFile, Verdict

HEADLINES: dict[Verdict, tuple[str, str]] = {
    "ok": ("OK", "The pose can be used."),
    "doubtful": ("Doubtful", "There is a pose, but check it before you rely on it."),
    "failed": ("Failed", "Do not use this pose."),
}
NO_POSE = "No pose was found."

FLAGS = {
    "moving": "the arm was probably moving: its joints do not belong to this picture",
    "mask": "its mask disagrees with the other views",
    "camera-moved": "the camera seems to have moved before it was taken",
    "hidden": "most of the arm is hidden or out of the picture",
    "unusable-image": "its picture is black, of one colour, or that of another view",
    "few-contour": "too little of the arm's outline is visible to say much",
}
"""What the flags of one word mean; other flags are sentences already."""

# A sentence that begins with one of these tells the reader to do something.
_IMPERATIVE = re.compile(
    r"(add|calibrate|change|check|choose|compare|correct|delete|do|drop|export|fix|give|hold|"
    r"improve|keep|leave|let|look|lower|make|measure|move|name|open|photograph|put|raise|re-record|"
    r"record|remove|repeat|replace|retake|run|see|segment|set|show|start|take|try|turn|use|wait)\b",
    re.IGNORECASE,
)
_POINTS_BACK = re.compile(r"\b(it|its|them|their|they|these|those)\b", re.IGNORECASE)
_OF_A_VIEW = re.compile(r"(View \S+?):? ")
_OK_NEXT = (
    "Glance at the outlines below: the pink line should follow the arm in every picture.",
    "Export the pose to your system with `easyhecpp export`.",
    "Calibrate again when the camera or the robot's base has been moved, or when the camera's "
    "resolution or focus has changed.",
)
_INTRINSICS = ("focal", "cx", "cy", "k1", "k2")
_TAKE_INTRINSICS = (
    "Use the refined intrinsics wherever you use the pose: `easyhecpp export RESULT camera-info` "
    "writes them."
)
_LOOK = "Look at the outlines below, the flagged views first: does the pink line follow the arm?"


@dataclass(frozen=True)
class VerdictText:
    """The verdict for readers.

    Attributes:
        verdict: ``ok``, ``doubtful`` or ``failed``.
        word: The verdict as a heading.
        headline: What it means, one sentence.
        why: What was found, sentences.
        advice: What to do next, sentences; code in backquotes.
    """

    verdict: Verdict
    word: str
    headline: str
    why: tuple[str, ...]
    advice: tuple[str, ...]


def verdict_text(result: ResultFile) -> VerdictText:
    """Sort a result's reasons into findings and advice, and add what always holds."""
    word, headline = HEADLINES[result.verdict]
    if result.T_mount_cam is None:
        headline = NO_POSE
    why, advice = split_reasons(result.reasons)
    if any(p.name in _INTRINSICS for p in result.refined):
        advice += (_TAKE_INTRINSICS,)
    if result.verdict == "ok":
        advice += _OK_NEXT
    elif result.T_mount_cam is not None:
        advice += (_LOOK,)
    elif not advice:
        advice = (
            "Run `easyhecpp check-capture` on the capture: it lists everything that is wrong.",
        )
    numbers = _numbers(result)
    why = (*numbers, *why) if result.verdict == "ok" else (*why, *numbers)
    return VerdictText(result.verdict, word, headline, why, advice)


def split_reasons(reasons: Sequence[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Findings and advice out of reasons that mix both; nothing is said twice.

    A sentence that begins with an imperative is advice. That it is about one view, which the
    reason's beginning names, is said again; where it otherwise speaks of "them" or "it", the whole
    reason is kept as the advice, so that the reader knows of what.
    """
    why: dict[str, None] = {}
    advice: dict[str, None] = {}
    for reason in reasons:
        sentences = re.split(r"(?<=[.!?])\s+(?=[A-Z`])", reason.strip())
        is_advice = [_IMPERATIVE.match(sentence) is not None for sentence in sentences]
        todo = " ".join(s for s, yes in zip(sentences, is_advice, strict=True) if yes)
        found = " ".join(s for s, yes in zip(sentences, is_advice, strict=True) if not yes)
        if found:
            why[found] = None
        view = _OF_A_VIEW.match(reason)
        if todo and view:
            advice[f"{view[1]}: {todo[0].lower()}{todo[1:]}"] = None
        elif todo:
            advice[reason.strip() if _POINTS_BACK.search(todo) else todo] = None
    return tuple(why), tuple(advice)


def flag_text(flag: str) -> str:
    """What a view's flag means."""
    return FLAGS.get(flag, flag)


def _numbers(result: ResultFile) -> tuple[str, ...]:
    """The facts that every verdict rests on, in sentences."""
    used = [view for view in result.views if view.weight > 0]
    if result.T_mount_cam is None or not used:
        return ()
    views = f"{len(used)} of {len(result.views)} views took part"
    if len(result.views) == 1:
        views = "A single view was used"
    overlaps = [view.iou for view in used if view.iou is not None]
    if overlaps:
        views += f"; rendered arm and masks overlap by {_share(min(overlaps), max(overlaps))}"
    facts = [f"{views}."]
    if result.refined:
        refined = ", ".join(f"{p.name} by {p.correction:+.3g}" for p in result.refined)
        facts.append(f"Refined with the pose: {refined}.")
    # A pose that failed is off by more than any residual tells: its sigma would mislead.
    if result.sigma is not None and result.verdict != "failed":
        camera, arm = (
            None if sigma is None else f"±\u00a0{sigma:.2g}\u00a0mm"
            for sigma in (result.sigma.position_mm, result.sigma.workspace_mm)
        )
        subject = "The camera's position is known to"
        if result.verdict == "doubtful":
            subject = "Were nothing else wrong, the camera's position would be known to"
        at_arm = "" if arm is None else f", a point at the arm to {arm}"
        facts.append(f"{subject} {camera}{at_arm} (one standard deviation).")
    return tuple(facts)


def _share(low: float, high: float) -> str:
    a, b = round(100 * low), round(100 * high)
    return f"{a} %" if a == b else f"{a} to {b} %"
