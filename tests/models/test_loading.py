"""Checkpoints in other precisions, and checkpoints with holes."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest

from easyhecpp.errors import InputError
from easyhecpp.models.grounding_dino import GroundingDino
from easyhecpp.models.runtime import Runtime
from easyhecpp.models.sam import load_sam
from easyhecpp.models.sam2 import load_sam2
from easyhecpp.models.sam3 import Sam3Text, load_sam3
from easyhecpp.models.sam_hq import load_sam_hq
from easyhecpp.segment import Prompts

torch = pytest.importorskip("torch", reason="needs the extra 'models'")
pytest.importorskip("transformers", reason="needs the extra 'models'")

BOX = Prompts(boxes=np.array([[5.0, 5, 30, 30]]))
LOADERS = {
    "sam": load_sam,
    "sam_hq": load_sam_hq,
    "sam2_video": load_sam2,
    "sam3_video": load_sam3,
    "grounding_dino": GroundingDino,
    "sam3": Sam3Text,
}


def answer(model, picture):
    """Numbers that depend on the whole model."""
    if isinstance(model, GroundingDino):
        model.threshold, model.duplicate_iou = 0.0, 1.0
        return model.detect(picture, "robot arm").boxes
    if isinstance(model, Sam3Text):
        model.threshold = 0.0
        return model.segment(picture, "robot arm").scores
    return model.encode(picture).predict(BOX).scores


@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16], ids=str)
@pytest.mark.parametrize("name", LOADERS)
def test_weights_in_half_precision_are_computed_with_in_float32(
    tiny, tmp_path, picture, name, dtype
):
    from tiny_models import in_half

    folder = in_half(tiny(name), tmp_path / "half", dtype)
    model = LOADERS[name](folder)
    tensors = [*model.model.parameters(), *model.model.buffers()]
    assert {t.dtype for t in tensors if t.is_floating_point()} == {torch.float32}
    assert np.isfinite(answer(model, picture)).all()


@pytest.mark.parametrize("precision", ["bfloat16", "float16"])
def test_the_precision_asked_for_is_used_whatever_the_weights_are_in(
    tiny, tmp_path, picture, precision
):
    from tiny_models import in_half

    folder = in_half(tiny("sam"), tmp_path / "half", torch.float16)
    exact = load_sam(folder).encode(picture).predict(BOX).scores
    model = load_sam(folder, Runtime("cpu", precision))
    seen = []
    model.model.vision_encoder.layers[0].mlp.lin1.register_forward_hook(
        lambda _, __, output: seen.append(output.dtype)
    )
    rough = model.encode(picture).predict(BOX).scores
    assert set(seen) == {getattr(torch, precision)}
    assert rough == pytest.approx(exact, abs=0.05)


@pytest.mark.parametrize(
    ("name", "lost"),
    [
        ("sam", ("mask_decoder", "prompt_encoder", "shared_image")),
        ("sam", ("mask_decoder.iou_token",)),
        ("sam_hq", ("mask_decoder.hq_token",)),
        ("sam2", ("mask_decoder",)),
        ("sam2", ("shared_image_embedding", "prompt_encoder.shared_embedding")),
        ("sam3_tracker", ("tracker_model.no_memory_embedding",)),
        ("grounding_dino", ("bbox_embed", "model.decoder.bbox_embed")),
        ("sam3", ("detector_model.presence", "detr_decoder.presence")),
    ],
)
def test_a_checkpoint_without_a_part_is_refused_however_small_the_part(tiny, tmp_path, name, lost):
    from tiny_models import without

    load = {"sam2": load_sam2, "sam3_tracker": load_sam3}.get(name) or LOADERS[name]
    folder = without(tiny(name), tmp_path / "holes", *lost)
    with pytest.raises(InputError, match=r"tensors are missing or misshapen, e\.g\. ") as caught:
        load(folder)
    assert str(folder) in str(caught.value)


@pytest.mark.parametrize("name", ["sam", "sam2", "sam2_video", "sam3_tracker"])
@pytest.mark.parametrize("lost", ["prompt_encoder.shared_embedding", "shared_image_embedding"])
def test_the_matrix_that_goes_by_two_names_may_be_stored_under_one(
    tiny, tmp_path, picture, name, lost
):
    from tiny_models import load_file, save_file, without

    names = {"prompt_encoder.shared_embedding", "shared_image_embedding"}
    prefix = "tracker_model." if name.startswith("sam3") else ""
    (kept,) = (f"{prefix}{n}.positional_embedding" for n in names - {lost})
    whole = tmp_path / "whole"
    shutil.copytree(tiny(name), whole)
    tensors = load_file(whole / "model.safetensors")
    matrix = next(v for k, v in tensors.items() if k.endswith("positional_embedding"))
    both = {f"{prefix}{n}.positional_embedding": matrix.clone() for n in names}
    save_file({**tensors, **both}, whole / "model.safetensors", metadata={"format": "pt"})
    folder = without(whole, tmp_path / "one", f"{prefix}{lost}")
    assert kept in load_file(folder / "model.safetensors")
    load = {"sam": load_sam, "sam3_tracker": load_sam3}.get(name, load_sam2)
    assert answer(load(folder), picture) == pytest.approx(answer(load(whole), picture), abs=1e-6)


def test_weights_of_another_size_than_their_config(tiny, tmp_path):
    folder = tmp_path / "sam"
    shutil.copytree(tiny("sam"), folder)
    config = json.loads((folder / "config.json").read_text())
    config["mask_decoder_config"]["mlp_dim"] = 24
    (folder / "config.json").write_text(json.dumps(config))
    with pytest.raises(InputError, match="checkpoint of SAM cannot be loaded: "):
        load_sam(folder)
