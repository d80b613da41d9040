"""The SAM family: real model code with tiny random weights, loaded as a user's folder would be."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from easyhecpp.errors import InputError
from easyhecpp.models.pixels import Preprocessing
from easyhecpp.models.prompted import PromptedImage, PromptedSegmenter
from easyhecpp.models.runtime import Runtime
from easyhecpp.models.sam import load_sam
from easyhecpp.models.sam2 import load_sam2
from easyhecpp.models.sam3 import load_sam3
from easyhecpp.models.sam_hq import load_sam_hq
from easyhecpp.segment.protocols import PromptableSegmenter, Prompts

torch = pytest.importorskip("torch", reason="needs the extra 'models'")
pytest.importorskip("transformers", reason="needs the extra 'models'")

MODELS = {
    "sam": load_sam,
    "sam_hq": load_sam_hq,
    "sam2": load_sam2,
    "sam2_video": load_sam2,
    "sam3_tracker": load_sam3,
    "sam3_video": load_sam3,
}
BOXES = np.array(
    [[3.0, 4, 40, 30], [10, 2, 70, 40], [0, 0, 76, 44], [50, 20, 60, 41], [5, 5, 9, 9]]
)
POINTS = BOXES.reshape(-1, 2, 2).mean(axis=1, keepdims=True)


@pytest.fixture(params=MODELS)
def loaded(request, tiny):
    return MODELS[request.param](tiny(request.param))


def test_boxes_points_and_both_give_one_mask_each(loaded, picture):
    assert isinstance(loaded, PromptableSegmenter)
    encoded = loaded.encode(picture)
    assert encoded.size == picture.shape[:2]
    for prompts in (
        Prompts(boxes=BOXES),
        Prompts(points=POINTS),
        Prompts(boxes=BOXES, points=POINTS),
        Prompts(points=np.repeat(POINTS, 2, axis=1), on_object=np.array([[True, False]] * 5)),
    ):
        answer = encoded.predict(prompts)
        assert answer.masks.shape == (5, *picture.shape[:2])
        assert answer.masks.dtype == bool
        assert answer.scores.shape == (5,)
        assert np.isfinite(answer.scores).all()


def test_one_encoding_serves_all_prompts(loaded, picture):
    calls = []
    loaded.model.vision_encoder.register_forward_hook(lambda *_: calls.append(1))
    encoded = loaded.encode(picture)
    for variant in (Prompts(boxes=BOXES), Prompts(boxes=BOXES, points=POINTS)):
        encoded.predict(variant)
    assert len(calls) == 1


def test_prompts_go_through_in_chunks_with_the_same_result(loaded, picture):
    sizes = []
    loaded.model.mask_decoder.register_forward_hook(
        lambda _, __, output: sizes.append(output[0].shape[1])
    )
    together = loaded.encode(picture).predict(Prompts(boxes=BOXES))
    loaded.prompts_at_once = 2
    apart = loaded.encode(picture).predict(Prompts(boxes=BOXES))
    assert sizes == [5, 2, 2, 1]
    assert np.allclose(together.scores, apart.scores, atol=1e-5)
    assert (together.masks != apart.masks).mean() < 1e-3  # logits near zero


def test_the_answer_is_that_of_the_whole_model(loaded, picture):
    """Encoding apart and cutting into chunks changes nothing against a plain call of the model."""
    pixels, frame = loaded.preprocessing.tensor(picture)
    boxes = torch.from_numpy(frame.boxes_to_model(BOXES)).float()[None]
    with torch.no_grad():
        output = loaded.model(pixel_values=pixels, input_boxes=boxes, multimask_output=True)
        best = output.iou_scores[0].argmax(dim=1)
        wanted = frame.logits_to_image(output.pred_masks[0][torch.arange(5), best]) > 0
    answer = loaded.encode(picture).predict(Prompts(boxes=BOXES))
    assert np.allclose(answer.scores, output.iou_scores[0].amax(dim=1).numpy(), atol=1e-5)
    assert (answer.masks != wanted.numpy()).mean() < 1e-3


def test_half_precision_is_for_the_image_encoder_alone(tiny, picture):
    for name, load in MODELS.items():
        exact, half = load(tiny(name)), load(tiny(name), Runtime("cpu", "bfloat16"))
        full, rough = exact.encode(picture), half.encode(picture)
        for key, value in _tensors(rough.embedding):
            assert value.dtype == torch.float32, key
        assert all(p.dtype == torch.float32 for p in half.model.parameters())
        a, b = (e.predict(Prompts(boxes=BOXES)).scores for e in (full, rough))
        assert np.allclose(a, b, atol=0.05)
        assert not np.array_equal(a, b), "nothing ran in half precision"


def _tensors(embedding):
    for key, value in embedding.items():
        yield from ((key, v) for v in (value if isinstance(value, list) else [value]))


def test_settings_of_the_checkpoint_are_used(tiny):
    rule = load_sam(tiny("sam")).preprocessing
    assert rule == Preprocessing("longest", 64, mean=(0.5, 0.4, 0.3), std=(0.2, 0.3, 0.4))
    assert load_sam3(tiny("sam3_video")).preprocessing.mean == (0.5, 0.5, 0.5)


def test_an_unknown_device_or_precision_is_said(tiny):
    with pytest.raises(InputError, match=r"unknown device 'tpu'\. Expected: auto, cpu, cuda"):
        Runtime("tpu")
    with pytest.raises(InputError, match=r"unknown precision 'int8'\. Expected: float32, bfl"):
        Runtime(precision="int8")
    if not torch.cuda.is_available():
        with pytest.raises(InputError, match="device 'cuda' cannot be used"):
            load_sam(tiny("sam"), Runtime("cuda"))


@dataclass
class EchoSegmenter(PromptedSegmenter):
    """Everything of ``PromptedSegmenter`` but the network: a mask is the box that was asked for.

    The logits are the distance to the box along one axis, which bilinear resampling keeps exact.
    """

    preprocessing: Preprocessing
    axis: int
    grid: int
    prompts_at_once: int = 2

    runtime = Runtime("cpu")
    device = torch.device("cpu")
    name = "echo"

    def embed(self, pixels):
        return {"shape": tuple(pixels.shape[-2:])}

    def decode(self, embedding, input_boxes, **_):
        stride = embedding["shape"][0] / self.grid
        samples = torch.arange(self.grid) * stride + (stride - 1) / 2
        # A box names the centres of its outermost pixels; its edge is half an image pixel outside.
        half = 0.5 * self.pixel
        low, high = input_boxes[0, :, self.axis, None], input_boxes[0, :, 2 + self.axis, None]
        inside = torch.minimum(samples - (low - half), (high + half) - samples)
        logits = inside[:, None, None, :].expand(-1, 1, self.grid, self.grid)
        logits = logits if self.axis == 0 else logits.transpose(2, 3)
        # The second of three candidates is right, and scored best.
        return torch.cat([-logits, logits, -logits], dim=1), torch.tensor([[0.1, 0.9, 0.2]]).expand(
            len(low), 3
        )


@pytest.mark.parametrize("size", [(90, 160), (160, 90), (128, 128), (75, 201)], ids=str)
@pytest.mark.parametrize("rule", ["longest", "stretch"])
@pytest.mark.parametrize("axis", [0, 1])
def test_a_mask_is_its_box_to_the_pixel(size, rule, axis):
    segmenter = EchoSegmenter(Preprocessing(rule, 256), axis, grid=64)
    image = np.zeros((*size, 3), dtype=np.uint8)
    encoded = segmenter.encode(image)
    assert isinstance(encoded, PromptedImage)
    segmenter.pixel = float(encoded.frame.scale_xy[axis])
    width, height = size[1], size[0]
    rng = np.random.default_rng(11)
    low = rng.integers(6, [width // 2, height // 2], (5, 2))
    high = low + rng.integers(12, [width // 2 - 6, height // 2 - 6], (5, 2))
    boxes = np.concatenate([low, high], axis=1).astype(float)
    answer = encoded.predict(Prompts(boxes=boxes))
    assert np.allclose(answer.scores, 0.9)
    for box, mask in zip(boxes.astype(int), answer.masks, strict=True):
        wanted = np.zeros(size, dtype=bool)
        span = slice(box[axis], box[axis + 2] + 1)
        wanted[(slice(None), span) if axis == 0 else (span, slice(None))] = True
        assert np.array_equal(mask, wanted)
