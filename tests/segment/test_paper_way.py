"""The paper's way from pictures to pose: text, first pose, AutoSAM, solve, AutoSAM again.

Once with stand-ins that see perfectly, where the pose must come out right, and once with the real
code of Grounding DINO and SAM, whose random weights see nothing: then it must say so.
"""

from __future__ import annotations

import shutil

import numpy as np
import pytest
from stage import LINKS, OTHER_POSES, POSES, AllArms, PerfectSam, urdf

from easyhecpp.capture.write import RobotSource, write_capture
from easyhecpp.cli import main
from easyhecpp.errors import CalibrationError, InputError
from easyhecpp.geometry import pose_error
from easyhecpp.models import registry
from easyhecpp.models.grounding_dino import GroundingDino
from easyhecpp.models.prompted import PromptedImage
from easyhecpp.segment import AutoSam, GroundedSegmenter, PoseBelief, RememberingSegmenter
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


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """Tiny Grounding DINO and SAM: real code, random weights."""
    pytest.importorskip("torch", reason="needs the extra 'models'")
    pytest.importorskip("transformers", reason="needs the extra 'models'")
    import tiny_models

    root = tmp_path_factory.mktemp("checkpoints")
    return {
        "text_weights": tiny_models.save_grounding_dino(root / "dino"),
        "box_weights": tiny_models.save_sam(root / "sam"),
    }


@pytest.fixture(scope="module")
def on_disk(stage, tmp_path_factory):
    """The stage's capture as a folder, without its masks."""
    root = tmp_path_factory.mktemp("stage")
    (root / "stick.urdf").write_text(urdf())
    folder = root / "capture"
    write_capture(folder, stage.capture(), robot=RobotSource(root / "stick.urdf"))
    shutil.rmtree(folder / "masks")
    return folder


@pytest.fixture
def asked(monkeypatch):
    """What was asked of the real models: texts, and numbers of prompts."""
    found = {"texts": [], "prompts": []}
    detect, predict = GroundingDino.detect, PromptedImage.predict

    def detect_and_tell(self, image, text):
        found["texts"].append(text)
        return detect(self, image, text)

    def predict_and_tell(self, prompts):
        found["prompts"].append(prompts)
        return predict(self, prompts)

    monkeypatch.setattr(GroundingDino, "detect", detect_and_tell)
    monkeypatch.setattr(PromptedImage, "predict", predict_and_tell)
    return found


def calibrate_on_disk(on_disk, folders, out, *words):
    words = ("calibrate", on_disk, "--segmenter", "grounded-sam", "--out", out, *words)
    options = [(f"--{name.replace('_', '-')}", path) for name, path in folders.items()]
    return main([str(word) for word in (*words, *sum(options, ()))])


def test_random_weights_end_in_one_sentence(on_disk, folders, asked, tmp_path, capsys):
    code = calibrate_on_disk(on_disk, folders, tmp_path / "out", "--text", "stick robot", "--quiet")
    err = capsys.readouterr().err
    assert code == 3
    assert err.count("easyhecpp: ") == 1
    assert "Nothing that the text model found moves as the joints say" in err
    assert asked["texts"] == ["stick robot"] * len(POSES)


@pytest.mark.parametrize(("variant", "points"), [("e", False), ("b", True)])
def test_prompts_reach_the_real_box_model(
    on_disk, folders, asked, tmp_path, capsys, monkeypatch, variant, points
):
    """As above, with first masks that are right, so that the calibration gets as far as prompts."""
    eyes = AllArms()
    monkeypatch.setattr(
        GroundedSegmenter, "segment", lambda _, image, text: eyes.segment(image, text)
    )
    words = ("--prompts", variant, "--precision", "bfloat16", "--device", "cpu", "--quiet")
    code = calibrate_on_disk(on_disk, folders, tmp_path / "out", *words)
    err = capsys.readouterr().err
    assert code == 2
    assert err.count("easyhecpp: ") == 1
    assert "SAM (sam) gave a usable mask in 0 of 5 views" in err
    assert len(asked["prompts"]) == len(POSES)
    for prompts in asked["prompts"]:
        assert (prompts.points is not None) == points
        assert len(prompts) > len(LINKS) if variant == "e" else len(prompts) == 1


def test_models_that_see_nothing_say_so(stage, folders):
    loaded = registry.load("grounded-sam", **folders)
    source = AutoSam(loaded.boxes, loaded.text, first_pose=lambda *_: [stage.T_mount_cam])
    with pytest.raises((CalibrationError, InputError), match="--segmenter classical"):
        source.masks(stage.capture())
    with pytest.raises(InputError, match=r"SAM \(sam\) gave a usable mask in 0 of 5 views"):
        source.masks(stage.capture(), PoseBelief(stage.T_mount_cam))
