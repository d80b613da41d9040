"""Which source of masks a name stands for, and what becomes of the settings of pretrained ones."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from stage import Stage

from easyhecpp.capture import Capture, View
from easyhecpp.errors import InputError
from easyhecpp.models import checkpoint
from easyhecpp.segment import AutoSam
from easyhecpp.session.masks import PretrainedConfig, choose_source, segmenter_for_images

pytest.importorskip("torch", reason="needs the extra 'models'")
pytest.importorskip("transformers", reason="needs the extra 'models'")

ALL = ("auto", "given", "classical", "grounded-sam", "sam")


@pytest.fixture(scope="module")
def stage(tmp_path_factory: pytest.TempPathFactory) -> Stage:
    return Stage.build(tmp_path_factory.mktemp("stage"))


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Folders of tiny checkpoints."""
    import tiny_models

    root = tmp_path_factory.mktemp("checkpoints")
    return {
        name: getattr(tiny_models, f"save_{name}")(root / name)
        for name in ("grounding_dino", "sam", "sam_hq")
    }


@pytest.fixture
def nothing_cached(monkeypatch: pytest.MonkeyPatch) -> None:
    real = checkpoint.find
    monkeypatch.setattr(checkpoint, "find", lambda w: real(w) if Path(w).is_dir() else None)


@pytest.fixture
def unmasked(stage: Stage) -> Capture:
    capture = stage.capture()
    views = tuple(View(v.id, v.joints, image=v.image) for v in capture.views)
    return replace(capture, views=views)


@pytest.fixture
def folders(tiny):
    return {"text_weights": tiny["grounding_dino"], "box_weights": tiny["sam"]}


def test_auto_takes_masks_then_weights_then_the_classical_way(
    stage, unmasked, folders, nothing_cached
):
    config = PretrainedConfig(**folders)
    given = choose_source("auto", stage.capture(), config)
    assert given.name == "given"
    assert given.why == "masks from the capture; the weights that were named are not used"
    assert choose_source("auto", unmasked).name == "classical"
    assert choose_source("auto", unmasked, config).name == "grounded-sam"


def test_auto_goes_on_without_a_pair_of_which_a_file_is_missing(
    unmasked, tiny, tmp_path, monkeypatch
):
    """A download that was interrupted before the tokenizer came."""
    half = tmp_path / "half"
    shutil.copytree(tiny["grounding_dino"], half)
    cached = {"IDEA-Research/grounding-dino-base": half, "facebook/sam-vit-huge": tiny["sam"]}
    monkeypatch.setattr(checkpoint, "find", lambda weights: cached.get(str(weights)))
    assert segmenter_for_images("auto") == "grounded-sam"
    for file in ("vocab.txt", "tokenizer.json"):
        (half / file).unlink()
    assert segmenter_for_images("auto") == "classical"
    assert choose_source("auto", unmasked).name == "classical"


def test_the_settings_reach_the_models(unmasked, folders, nothing_cached):
    config = PretrainedConfig(
        **folders, device="cpu", precision="bfloat16", prompts="f", text="grey gripper"
    )
    for name in ("auto", "grounded-sam"):
        source = choose_source(name, unmasked, config).source
        assert isinstance(source, AutoSam)
        assert source.config.variant == "f"
        assert source.config.text == "grey gripper"
        assert source.text is not None
        assert source.text.name == "Grounding DINO (grounding_dino) + SAM (sam)"
        for model in (source.segmenter.segmenter, source.text.detector):  # type: ignore[attr-defined]
            assert (model.runtime.device, model.runtime.precision) == ("cpu", "bfloat16")


def test_weights_of_a_box_model_alone_are_taken_by_auto(unmasked, tiny, nothing_cached):
    chosen = choose_source("auto", unmasked, PretrainedConfig(box_weights=tiny["sam_hq"]))
    assert chosen.name == "sam-hq"


def test_auto_says_why_weights_that_were_named_cannot_be_used(unmasked, tiny, nothing_cached):
    config = PretrainedConfig(text_weights=tiny["grounding_dino"])
    for choose in (
        lambda: choose_source("auto", unmasked, config),
        lambda: segmenter_for_images("auto", config),
    ):
        with pytest.raises(InputError) as caught:
            choose()
        text = str(caught.value)
        assert "No segmenter is ready to run with the weights that were named" in text
        assert "grounded-sam lacks the weights facebook/sam-vit-huge" in text
        assert "--segmenter grounded-sam" in text


BAD = {
    "text folder": ({"text_weights": "./nowhere"}, "'./nowhere'"),
    "box folder": ({"box_weights": "/nowhere/sam"}, "'/nowhere/sam'"),
    "device": ({"device": "tpu"}, "unknown device 'tpu'. Expected: auto, cpu, cuda"),
    "absent device": ({"device": "cuda:99"}, "device 'cuda:99' cannot be used"),
    "precision": ({"precision": "int8"}, "unknown precision 'int8'"),
    "prompts": ({"prompts": "g"}, "unknown prompt variant 'g'. Expected: one of a, b, c"),
    "text": ({"text": " "}, "The text that names the arm is empty"),
}


@pytest.mark.parametrize("name", ALL)
@pytest.mark.parametrize("case", BAD)
def test_settings_that_cannot_be_used_are_refused_whatever_is_taken(
    stage, folders, nothing_cached, name, case
):
    settings, phrase = BAD[case]
    config = PretrainedConfig(**{**folders, **settings})
    with pytest.raises(InputError) as caught:
        choose_source(name, stage.capture(), config)
    assert phrase in str(caught.value)


def test_an_unknown_name_comes_before_its_weights(stage):
    with pytest.raises(InputError, match=r"unknown segmenter 'yolo'\. Expected: one of auto"):
        choose_source("yolo", stage.capture(), PretrainedConfig(box_weights="lab/yolo"))
