"""The paper's way from pictures to pose: text, first pose, AutoSAM, solve, AutoSAM again.

Once with stand-ins that see perfectly, where the pose must come out right, and once with the real
code of Grounding DINO and SAM, whose random weights see nothing: then it must say so.
"""

from __future__ import annotations

import numpy as np
import pytest
from stage import OTHER_POSES, POSES, AllArms, PerfectSam

from easyhecpp.errors import CalibrationError, InputError
from easyhecpp.geometry import pose_error
from easyhecpp.models import registry
from easyhecpp.segment import AutoSam, PoseBelief, RememberingSegmenter
from easyhecpp.session import CalibrationConfig, calibrate

TABLE = (slice(150, 240), slice(0, 320))


def test_models_that_see_give_the_pose(stage, monkeypatch):
    sam = PerfectSam()
    loaded = registry.LoadedSegmenter("grounded-sam", AllArms(), RememberingSegmenter(sam))
    monkeypatch.setattr(registry, "load", lambda *_, **__: loaded)
    capture = stage.capture(others=list(OTHER_POSES), table=TABLE)
    done = calibrate(capture, CalibrationConfig(segmenter="grounded-sam"))
    metres, radians = pose_error(done.T_mount_cam, stage.T_mount_cam)
    assert metres < 0.004
    assert np.rad2deg(radians) < 0.15
    assert done.result.verdict in ("ok", "doubtful")
    assert len(sam.encoded) == len(POSES), "later rounds use the first round's encodings"
    assert len(sam.asked) >= len(POSES)


def test_models_that_see_nothing_say_so(stage, tmp_path):
    pytest.importorskip("torch", reason="needs the extra 'models'")
    pytest.importorskip("transformers", reason="needs the extra 'models'")
    import tiny_models

    loaded = registry.load(
        "grounded-sam",
        text_weights=tiny_models.save_grounding_dino(tmp_path / "dino"),
        box_weights=tiny_models.save_sam(tmp_path / "sam"),
    )
    source = AutoSam(loaded.boxes, loaded.text, first_pose=lambda *_: [stage.T_mount_cam])
    with pytest.raises((CalibrationError, InputError), match="--segmenter classical"):
        source.masks(stage.capture())
    with pytest.raises(InputError, match=r"SAM \(sam\) gave a usable mask in 0 of 5 views"):
        source.masks(stage.capture(), PoseBelief(stage.T_mount_cam))
