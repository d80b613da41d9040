from __future__ import annotations

import pytest
from report_case import REASON, result_of, solved, without_pose

from easyhecpp.formats.result_blocks import RefinedParameter
from easyhecpp.report.wording import flag_text, split_reasons, verdict_text


@pytest.mark.parametrize(
    ("reason", "why", "advice"),
    [
        ("The masks are empty. Check the folder.", "The masks are empty.", "Check the folder."),
        ("Add views.", None, "Add views."),
        ("Nothing is known about 0.5 mm.", "Nothing is known about 0.5 mm.", None),
        ("One. Two. Take more views. Then go on.", "One. Two. Then go on.", "Take more views."),
        ("View 3: it moved. Take it again.", "View 3: it moved.", "View 3: take it again."),
        ("View 3 is bad. Leave it out.", "View 3 is bad.", "View 3: leave it out."),
        # Advice that speaks of "them" is kept with what it speaks of.
        (REASON, "Left out: 0002.", REASON),
    ],
)
def test_reasons_fall_apart_into_findings_and_advice(reason, why, advice):
    found = split_reasons([reason])
    assert found == (() if why is None else (why,), () if advice is None else (advice,))


def test_nothing_is_said_twice():
    why, advice = split_reasons(["A is so. Add views.", "B is so. Add views.", "A is so."])
    assert why == ("A is so.", "B is so.")
    assert advice == ("Add views.",)


@pytest.mark.parametrize("verdict", ["ok", "doubtful", "failed"])
def test_every_verdict_says_what_to_do_next(verdict):
    case = solved()
    assert case.estimate is not None
    text = verdict_text(result_of(case.capture, case.estimate, verdict=verdict))
    assert text.verdict == verdict
    assert text.advice
    assert any("4 of 4 views" in line for line in text.why)
    assert ("Do not use" in text.headline) == (verdict == "failed")


def test_a_failure_without_a_pose_gives_no_numbers():
    text = verdict_text(without_pose().result)
    assert text.headline == "No pose was found."
    assert text.why == ("The masks are empty.",)
    assert text.advice == ("Check the folder masks/.",)


def test_refined_intrinsics_are_told_and_to_be_used():
    case = solved()
    assert case.estimate is not None
    lens = RefinedParameter(name="k1", correction=0.1109, sigma=0.01, unit="coefficient")
    joint = RefinedParameter(name="joint4", correction=-0.004, sigma=0.001, unit="rad or m")
    plain, bent, turned = (
        verdict_text(result_of(case.capture, case.estimate, verdict="ok", refined=refined))
        for refined in ((), (lens,), (joint,))
    )
    assert "Refined with the pose: k1 by +0.111." in bent.why
    assert any("export RESULT camera-info" in line for line in bent.advice)
    assert "Refined with the pose: joint4 by -0.004." in turned.why
    assert not any("camera-info" in line for line in (*plain.advice, *turned.advice))
    assert not any("Refined" in line for line in plain.why)


def test_flags_of_one_word_are_explained_and_sentences_kept():
    assert "moving" in flag_text("moving")
    assert flag_text("moving") != "moving"
    assert flag_text("The lens is dirty.") == "The lens is dirty."


def test_a_failed_pose_is_given_no_uncertainty_and_a_doubtful_one_a_condition():
    case = solved()
    assert case.estimate is not None
    said = {
        verdict: " ".join(
            verdict_text(
                result_of(case.capture, case.estimate, verdict=verdict, reasons=["It is bad."])
            ).why
        )
        for verdict in ("ok", "doubtful", "failed")
    }
    assert "±" in said["ok"]
    assert "Were nothing else wrong" in said["doubtful"]
    assert said["doubtful"].startswith("It is bad.")
    assert "±" not in said["failed"]
