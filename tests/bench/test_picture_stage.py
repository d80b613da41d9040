"""From pictures, step by step: which pictures tell the background, and which carry the pose."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from easyhecpp.bench import stages
from easyhecpp.bench.stages import PictureStage
from easyhecpp.errors import CalibrationError
from easyhecpp.segment.classical.search import Scored
from easyhecpp.segment.protocols import ViewMask
from easyhecpp.sim.studio import PREVIEW

T_BEFORE, T_NEW = np.eye(4), np.diag([1.0, -1.0, -1.0, 1.0])


class Cell:
    """Takes empty pictures and remembers where the arm was."""

    rig, camera, T_mount_cam, poses = "rig", "camera", T_NEW, None

    def __init__(self) -> None:
        self.taken: list[tuple[int, float]] = []

    def capture(self, joints: np.ndarray, *, quality: Any, first_index: int) -> list[Any]:
        self.taken.append((first_index, float(joints[0])))
        return [SimpleNamespace(image=np.zeros((4, 4, 3), np.uint8))]


class Segmenter:
    """Finds one first pose, or none; takes the best of what it is given."""

    scene = changes = None
    blind = False

    def __init__(self, rig: Any, camera: Any, images: Any, joints: Any, *, ids: Any) -> None:
        self.ids = ids

    def first_pose(self) -> list[Scored]:
        if self.blind:
            raise CalibrationError("no pose explains the motion")
        return [Scored(T_NEW, 0.5)]

    def settle(self, candidates: list[Scored]) -> list[Scored]:
        return candidates

    def masks_at(self, T: np.ndarray) -> list[ViewMask]:
        return [ViewMask(view, mask=np.ones((4, 4), bool)) for view in self.ids]

    def solve(self, T: np.ndarray, masks: list[ViewMask]) -> Any:
        self.counted = [m.mask is not None for m in masks]
        return SimpleNamespace(T_mount_cam=T, counted=self.counted)

    def backgrounds(self, T: np.ndarray) -> None:
        return None


@pytest.fixture
def stage(monkeypatch: pytest.MonkeyPatch) -> PictureStage:
    def refine(backgrounds: None, start: Any, *, ids: Any, weights: list[float]) -> Any:
        start.weights = weights
        return SimpleNamespace(estimate=start)

    monkeypatch.setattr(stages, "ClassicalSegmenter", Segmenter)
    monkeypatch.setattr(stages, "refine_edges", refine)
    monkeypatch.setattr(stages, "PairScore", lambda *arguments: lambda T: 0.4)
    monkeypatch.setattr(Segmenter, "blind", False)
    return PictureStage(Cell(), replace(PREVIEW), np.array([[10.0], [11.0]]))


def test_extra_pictures_come_first_and_do_not_count(stage: PictureStage):
    stage.look(np.array([1.0]))
    estimate = stage.estimate()
    assert stage.cell.taken == [(0, 10.0), (1, 11.0), (2, 1.0)]
    assert stage.extra_views == 2
    assert estimate.counted == [False, False, True]
    assert estimate.weights == [0.0, 0.0, 1.0]


def test_the_pose_found_before_is_one_more_candidate(stage: PictureStage):
    stage.look(np.array([1.0]))
    stage.found = T_BEFORE
    assert stage.estimate().T_mount_cam is T_NEW  # scored 0.5 against 0.4


def test_it_is_all_there_is_when_the_search_finds_nothing(
    stage: PictureStage, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(Segmenter, "blind", True)
    with pytest.raises(CalibrationError, match="no pose explains"):
        stage.estimate()
    stage.found = T_BEFORE
    assert stage.estimate().T_mount_cam is T_BEFORE
