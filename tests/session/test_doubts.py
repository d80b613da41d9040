"""What mask making says against its own masks reaches the verdict, the notes and the files."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
from stage import Stage

import easyhecpp.segment.classical as classical
import easyhecpp.session.calibration as calibration
from easyhecpp.models import registry
from easyhecpp.segment import CaptureMasks, PoseBelief, ViewMask
from easyhecpp.segment.quality import LinkQuality, ViewQuality
from easyhecpp.session import Calibration, CalibrationConfig, calibrate
from easyhecpp.session.mask_notes import mask_results, short_mask_notes
from easyhecpp.session.masks import ChosenSource, choose_source


@pytest.fixture(scope="module")
def stage(tmp_path_factory: pytest.TempPathFactory) -> Stage:
    return Stage.build(tmp_path_factory.mktemp("stage"))


@dataclass
class Source:
    """The true masks in every round; the first time with whatever is to be said of them."""

    first: CaptureMasks
    name: str = "stand-in"

    def masks(self, capture, belief=None):
        views = tuple(ViewMask(v.id, v.mask) for v in capture.views)
        if belief is None:
            return replace(self.first, views=views)
        views = (replace(views[0], score=0.7, notes=("The mask of fore is rejected.",)), *views[1:])
        return CaptureMasks(views, belief, notes=("Said in the last round.",))


def calibrated(stage: Stage, monkeypatch: pytest.MonkeyPatch, **first) -> Calibration:
    source = Source(CaptureMasks((), PoseBelief(stage.T_mount_cam), **first))
    chosen = ChosenSource(source, source.name, "as asked", True)
    monkeypatch.setattr(calibration, "choose_source", lambda *_, **__: chosen)
    return calibrate(stage.capture(), CalibrationConfig(edges=False))


def test_a_sure_choice_is_ok_and_the_first_rounds_notes_are_kept(stage, monkeypatch):
    found = calibrated(stage, monkeypatch, notes=("Said in the first round.",))
    assert found.result.verdict == "ok"
    said = ("Said in the first round.", "Said in the last round.")
    assert [note for note in found.notes if note in said] == list(said)
    assert "view 0000: The mask of fore is rejected." in found.notes
    assert found.result.notes == found.notes
    assert [mask.id for mask in found.result.masks] == [v.id for v in found.capture.views]
    assert found.result.masks[0].score == 0.7
    assert found.result.masks[0].notes == ("The mask of fore is rejected.",)


def test_a_doubt_of_the_first_round_makes_the_verdict_doubtful(stage, monkeypatch):
    found = calibrated(stage, monkeypatch, doubts=("Two things fit alike.",))
    assert found.result.verdict == "doubtful"
    assert "Two things fit alike." in found.result.reasons


def test_a_rival_arm_that_fits_almost_as_well_makes_the_verdict_doubtful(stage, monkeypatch):
    found = calibrated(stage, monkeypatch, margin=0.02)
    assert found.result.verdict == "doubtful"
    assert "explains the masks almost as well (by 2.0 % of overlap)" in found.result.reasons[0]


def test_a_first_pose_from_the_classical_way_brings_its_doubts(stage, monkeypatch):
    loaded = registry.LoadedSegmenter("sam", None, SimpleNamespace(name="sam"))
    monkeypatch.setattr(registry, "load", lambda *_, **__: loaded)
    found = SimpleNamespace(
        masks=(),
        T_mount_cam=np.eye(4),
        estimate=SimpleNamespace(covariance=np.eye(6)),
        reasons=("The arm covers only 0.5% of the images.",),
        margin=0.12,
    )
    monkeypatch.setattr(classical, "calibrate_from_images", lambda *_, **__: found)
    source = choose_source("sam", stage.capture()).source
    assert source is not None
    masks = source.masks(stage.capture())
    assert masks.doubts == found.reasons
    assert masks.margin == found.margin


def masks_with_notes(*notes: tuple[str, float, tuple[str, ...]]) -> CaptureMasks:
    some = np.ones((2, 2), bool)
    views = [
        ViewMask(name, None if score < 0 else some, score=max(score, 0.0), notes=said)
        for name, score, said in notes
    ]
    return CaptureMasks(tuple(views))


def test_the_worst_notes_are_shown_and_the_others_counted():
    masks = masks_with_notes(
        ("a", 0.9, ("A bit.", "Detail.")),
        ("b", -1.0, ("No mask here.", "More of it.")),
        ("c", 0.4, ("Bad.",)),
        ("d", 0.8, ("Meh.",)),
        ("e", 1.0, ()),
    )
    assert short_mask_notes(masks, ()) == (
        "view b: No mask here.",
        "view c: Bad.",
        "view d: Meh.",
        "and 3 more on the masks, listed by view on the written page",
    )
    assert short_mask_notes(masks_with_notes(("e", 1.0, ())), ()) == ()


@pytest.mark.parametrize(
    ("count", "named"),
    [(2, "views 0 and 1"), (3, "views 0, 1 and 2"), (6, "views 0, 1, 2 and 3 more")],
)
def test_what_several_views_share_is_said_once(count, named):
    masks = masks_with_notes(
        *[(str(i), 0.9 - 0.1 * i, ("Wrist is hidden.",)) for i in range(count)]
    )
    assert short_mask_notes(masks, ()) == (f"{named}: Wrist is hidden.",)


def test_every_view_and_link_has_its_numbers():
    masks = masks_with_notes(("a", 0.9, ("Said.",)), ("b", -1.0, ("None.",)))
    link = LinkQuality("fore", 200.0, 0.05, 0.5, float("nan"), 0.1)
    quality = (ViewQuality("a", (link,), 0.8, 0.4, 1.0, ("Link fore hardly agrees.",)),)
    a, b = mask_results(masks, quality)
    assert (a.score, b.score) == (0.9, None)
    assert a.notes == ("Said.", "Link fore hardly agrees.")
    assert (a.links[0].link, a.links[0].score, a.links[0].offset_px) == ("fore", 0.1, None)
    assert b.links == ()
    assert short_mask_notes(masks, quality)[1] == "view a: Link fore hardly agrees."
