"""Segmenters by name."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from easyhecpp.errors import InputError
from easyhecpp.models import checkpoint, registry
from easyhecpp.segment import Prompts


def test_an_unknown_name_lists_those_that_exist():
    with pytest.raises(InputError) as caught:
        registry.find("grounded_sam", ("auto", "given", "classical"))
    text = str(caught.value)
    assert "unknown segmenter 'grounded_sam'" in text
    assert "did you mean grounded-sam?" in text
    for name in (*registry.names(), "auto", "given", "classical"):
        assert name in text
    with pytest.raises(InputError) as caught:
        registry.load("classical")
    assert "unknown pretrained segmenter 'classical'. Expected: one of grou" in str(caught.value)
    assert "auto" not in str(caught.value)


def test_the_paper_s_pair_is_there_and_first():
    entry = registry.find("grounded-sam")
    assert registry.names()[0] == "grounded-sam"
    assert entry.text is not None
    assert "grounding-dino" in entry.text.weights
    assert entry.boxes.weights == "facebook/sam-vit-huge"


@pytest.mark.parametrize("name", registry.names())
def test_every_entry_names_a_loader_that_exists(name):
    entry = registry.find(name)
    for model in (entry.text, entry.boxes):
        if model is not None:
            assert callable(model.loader)
            assert model.spec.option == (
                "--text-weights" if model is entry.text else "--box-weights"
            )


PAIRS = {
    "grounded-sam": ("grounding_dino", "sam"),
    "grounded-sam2": ("grounding_dino", "sam2_video"),
    "grounded-sam-hq": ("grounding_dino", "sam_hq"),
    "sam3": ("sam3_video", "sam3_video"),
    "sam": (None, "sam"),
}


@pytest.mark.parametrize("name", PAIRS)
def test_pairs_run_from_a_user_s_folders(tiny, picture, name):
    text, boxes = PAIRS[name]
    folders = {"text_weights": tiny(text) if text else None, "box_weights": tiny(boxes)}
    assert registry.missing(name, **folders) == ()
    loaded = registry.load(name, **folders)
    assert loaded.boxes.encode(picture) is loaded.boxes.encode(picture)
    mask = loaded.boxes.encode(picture).predict(Prompts(boxes=np.array([[5.0, 5, 30, 30]]))).masks
    assert mask.shape == (1, *picture.shape[:2])
    if text is None:
        assert loaded.text is None
    else:
        assert loaded.text.segment(picture, "robot arm").masks.shape[1:] == picture.shape[:2]
        assert registry.load(name, with_text=False, **folders).text is None


def test_what_is_missing_is_named_without_loading_or_network(tmp_path, monkeypatch):
    hub = pytest.importorskip("huggingface_hub", reason="needs the extra 'models'")
    monkeypatch.setattr(hub.constants, "HF_HUB_CACHE", str(tmp_path))
    assert registry.missing("grounded-sam") == (
        "the weights IDEA-Research/grounding-dino-base",
        "the weights facebook/sam-vit-huge",
    )
    assert registry.missing("sam3") == ("the weights facebook/sam3 (gated)",)
    assert registry.first_ready() is None


def test_auto_takes_the_first_pair_that_is_complete(tiny, monkeypatch):
    have = {
        "IDEA-Research/grounding-dino-base": tiny("grounding_dino"),
        "facebook/sam2.1-hiera-large": tiny("sam2"),
        "facebook/sam3": tiny("sam3_video"),
    }
    find = checkpoint.find
    monkeypatch.setattr(checkpoint, "find", lambda w: find(w) if Path(w).is_dir() else have.get(w))
    assert registry.first_ready() == "grounded-sam2"
    assert registry.first_ready(box_weights=tiny("sam")) == "grounded-sam"
    del have["IDEA-Research/grounding-dino-base"]
    assert registry.first_ready() == "sam3"
    have["facebook/sam-vit-huge"] = tiny("sam")
    assert registry.first_ready() == "sam3", "a box model alone cannot start"
    assert registry.first_ready(text_weights=tiny("grounding_dino")) == "grounded-sam"
    assert registry.first_ready(box_weights=tiny("sam_hq")) == "sam-hq", "unless it was named"
    both = {"text_weights": tiny("grounding_dino"), "box_weights": tiny("sam_hq")}
    assert registry.first_ready(**both) == "grounded-sam-hq"


@pytest.mark.parametrize("lost", ["tokenizer.json", "model.safetensors", "config.json"])
def test_a_pair_of_which_a_file_is_missing_is_not_ready(tiny, tmp_path, lost):
    text = tmp_path / "dino"
    shutil.copytree(tiny("grounding_dino"), text)
    folders = {"text_weights": text, "box_weights": tiny("sam")}
    (text / "vocab.txt").unlink()
    assert registry.first_ready(**folders) == "grounded-sam"
    (text / lost).unlink()
    assert registry.first_ready(**folders) is None
    (lacking,) = registry.missing("grounded-sam", **folders)
    assert lacking.startswith(f"a part of the weights {text} (it")
    assert lost.partition(".")[0] in lacking


def test_without_the_extra_the_pip_line_is_what_is_missing(monkeypatch):
    monkeypatch.setattr(registry, "available", lambda package: False)
    monkeypatch.setattr(checkpoint, "available", lambda package: False)
    assert registry.missing("sam")[0] == 'the package torch (pip install "easyhecpp[models]")'
    assert registry.first_ready() is None
