"""Grounding DINO and SAM 3's text side: real code, tiny random weights."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from easyhecpp.errors import InputError
from easyhecpp.models import runtime
from easyhecpp.models.grounding_dino import GroundingDino
from easyhecpp.models.grounding_dino.adapter import as_caption, to_pixels, without_duplicates
from easyhecpp.models.runtime import Runtime, to_float64
from easyhecpp.models.sam import load_sam
from easyhecpp.models.sam3 import Sam3Text
from easyhecpp.segment import GroundedSegmenter, RememberingSegmenter, TextDetector, TextSegmenter

torch = pytest.importorskip("torch", reason="needs the extra 'models'")
transformers = pytest.importorskip("transformers", reason="needs the extra 'models'")


@pytest.fixture
def dino(tiny):
    return GroundingDino(tiny("grounding_dino"), threshold=0.0, duplicate_iou=1.0)


@pytest.fixture(params=["sam3", "sam3_video"])
def sam3(request, tiny):
    return Sam3Text(tiny(request.param), threshold=0.0)


def test_boxes_are_those_of_the_processor_in_transformers(dino, picture):
    """The same model, prompted and read out by transformers' own processor."""
    processor = transformers.GroundingDinoProcessor(
        transformers.GroundingDinoImageProcessorPil(), dino.tokenizer
    )
    pixels, _ = dino.preprocessing.tensor(picture)
    tokens = processor(text=[["Robot arm"]], return_tensors="pt")
    with torch.no_grad():
        output = dino.model(pixel_values=pixels, **tokens)
    wanted = processor.post_process_grounded_object_detection(
        output, tokens["input_ids"], threshold=0.0, target_sizes=[picture.shape[:2]]
    )[0]
    order = wanted["scores"].argsort(descending=True, stable=True)[: dino.at_most]
    found = dino.detect(picture, "Robot arm")
    assert isinstance(dino, TextDetector)
    assert np.allclose(found.scores, wanted["scores"][order].numpy(), atol=1e-6)
    edges = wanted["boxes"][order].double().numpy()
    last = np.array([picture.shape[1] - 1, picture.shape[0] - 1] * 2)
    # Theirs are measured from the image's edge; ours name the outermost pixels' centres.
    centres = np.clip(edges - [0, 0, 1, 1], 0, last)
    assert np.allclose(found.boxes[:, :2], centres[:, :2], atol=1e-4)
    assert np.allclose(found.boxes[:, 2:], np.maximum(centres[:, 2:], centres[:, :2]), atol=1e-4)


def test_boxes_name_the_pixels_inside():
    relative = np.array([[0.5, 0.5, 1.0, 1.0], [0.25, 0.5, 0.5, 0.2], [0.0, 0.0, 0.1, 0.1]])
    boxes = to_pixels(relative, (50, 80))
    assert boxes == pytest.approx(np.array([[0, 0, 79, 49], [0, 20, 39, 29], [0, 0, 3, 1.5]]))


def test_the_better_of_two_boxes_of_one_thing_is_kept():
    boxes = np.array([[0.0, 0, 9, 9], [0, 0, 9, 8], [20, 0, 29, 9], [0, 0, 9, 4]])
    assert without_duplicates(boxes, 0.8).tolist() == [0, 2, 3]
    assert without_duplicates(np.zeros((0, 4)), 0.8).tolist() == []


@pytest.mark.parametrize("text", ["Robot arm", " robot arm. ", "robot arm"])
def test_a_label_is_put_as_the_model_was_taught(text):
    assert as_caption(text) == "robot arm."


def test_nothing_found_is_no_error_and_costs_no_encoding(tiny, picture):
    calls = []
    sam = load_sam(tiny("sam"))
    sam.model.vision_encoder.register_forward_hook(lambda *_: calls.append(1))
    blind = GroundingDino(tiny("grounding_dino"), threshold=1.1)
    answer = GroundedSegmenter(blind, sam).segment(picture, "robot arm")
    assert answer.masks.shape == (0, *picture.shape[:2])
    assert len(answer) == 0
    assert calls == []


def test_grounded_sam_outlines_each_box_and_encodes_once(tiny, dino, picture):
    calls = []
    sam = load_sam(tiny("sam"))
    sam.model.vision_encoder.register_forward_hook(lambda *_: calls.append(1))
    remembering = RememberingSegmenter(sam)
    grounded = GroundedSegmenter(dino, remembering)
    assert isinstance(grounded, TextSegmenter)
    assert grounded.name == "Grounding DINO (grounding_dino) + SAM (sam)"
    answer = grounded.segment(picture, "robot arm")
    found = dino.detect(picture, "robot arm")
    assert answer.masks.shape == (len(found), *picture.shape[:2])
    assert np.array_equal(answer.scores, found.scores)
    remembering.encode(picture)  # AutoSAM, later
    assert len(calls) == 1


def test_sam3_reads_out_as_its_processor_does(sam3, picture):
    assert isinstance(sam3, TextSegmenter)
    answer = sam3.segment(picture, "robot arm")
    pixels, _ = sam3.preprocessing.tensor(picture)
    with torch.no_grad():
        output = sam3.model(pixel_values=pixels, **sam3._tokens("robot arm"))
    scores = output.pred_logits[0].sigmoid() * output.presence_logits[0].sigmoid()
    order = scores.argsort(descending=True)
    assert np.allclose(answer.scores, scores[order].numpy(), atol=1e-6)
    probability = torch.nn.functional.interpolate(
        output.pred_masks[:, order].sigmoid(), picture.shape[:2], mode="bilinear"
    )[0]
    # They blend probabilities, we blend logits: the same but within a pixel of the outline.
    assert (answer.masks != (probability > 0.5).numpy()).mean() < 0.1
    assert sam3._tokens("robot arm")["input_ids"].shape == (1, 32)


def test_sam3_drops_what_scores_low(tiny, picture):
    answer = Sam3Text(tiny("sam3"), threshold=1.0).segment(picture, "robot arm")
    assert answer.masks.shape == (0, *picture.shape[:2])


@pytest.mark.parametrize("precision", ["bfloat16", "float16"])
def test_text_models_run_in_half_precision(tiny, picture, precision):
    half = Runtime("cpu", precision)
    found = GroundingDino(tiny("grounding_dino"), half, threshold=0.0).detect(picture, "robot arm")
    assert np.isfinite(found.boxes).all()
    assert len(Sam3Text(tiny("sam3"), half, threshold=0.0).segment(picture, "robot arm")) > 0


def test_of_grounding_dino_only_the_image_encoder_runs_in_half_precision(tiny, picture):
    dino = GroundingDino(tiny("grounding_dino"), Runtime("cpu", "bfloat16"), threshold=0.0)
    seen = {}
    for name, module in dino.model.named_modules():
        if isinstance(module, torch.nn.Linear):
            module.register_forward_hook(
                lambda _, __, output, name=name: seen.update({name: output.dtype})
            )
    dino.detect(picture, "robot arm")
    half = {name for name, dtype in seen.items() if dtype == torch.bfloat16}
    assert half
    assert all(name.startswith("model.backbone.conv_encoder.") for name in half)
    assert seen["bbox_embed.1.layers.2"] == torch.float32


def test_a_long_text_is_cut_to_what_the_model_reads(dino, sam3, picture):
    for text in ("robot arm " * 40, "a"):
        assert dino.detect(picture, text).boxes.shape[1:] == (4,)
        assert sam3.segment(picture, text).masks.shape[1:] == picture.shape[:2]


def test_numbers_leave_the_device_before_they_become_float64():
    """MPS has no float64; a stand-in, for no machine of the tests has MPS."""

    class OnMps:
        def cpu(self):
            return torch.tensor([0.5], dtype=torch.bfloat16)

        def double(self):
            raise TypeError("Cannot convert a MPS Tensor to float64 dtype")

    assert to_float64(OnMps()).tolist() == [0.5]
    sources = Path(runtime.__file__).parent.rglob("*.py")
    assert sum(source.read_text().count(".double()") for source in sources) == 1


def test_a_checkpoint_without_its_tokenizer(tiny, tmp_path):
    folder = tmp_path / "dino"
    shutil.copytree(tiny("grounding_dino"), folder)
    for file in ("vocab.txt", "tokenizer.json", "tokenizer_config.json"):
        (folder / file).unlink(missing_ok=True)
    with pytest.raises(
        InputError, match=r"no checkpoint of Grounding DINO: its tokenizer is missing"
    ):
        GroundingDino(folder)
