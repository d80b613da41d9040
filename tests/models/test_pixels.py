"""Coordinates and pixels between an image and a model's input."""

from __future__ import annotations

import numpy as np
import pytest

from easyhecpp.errors import InputError
from easyhecpp.models.pixels import Preprocessing

torch = pytest.importorskip("torch", reason="needs the extra 'models'")

RULES = {
    "padded": Preprocessing("longest", size=96),
    "stretched": Preprocessing("stretch", size=96),
    "kept": Preprocessing("shortest", size=96, longest=160),
}
SIZES = [(60, 100), (100, 60), (64, 64), (37, 211)]


@pytest.mark.parametrize("rule", RULES.values(), ids=RULES)
@pytest.mark.parametrize("size", SIZES, ids=str)
def test_a_white_blob_lands_where_its_coordinate_says(rule, size):
    height, width = size
    spot = np.array([width / 3, height / 2.5])
    rows, columns = np.mgrid[:height, :width]
    blob = np.exp(-((columns - spot[0]) ** 2 + (rows - spot[1]) ** 2) / 18.0)
    image = np.repeat((255 * blob).astype(np.uint8)[..., None], 3, axis=2)
    tensor, frame = rule.tensor(image)
    assert tensor.shape == (1, 3, *frame.padded)
    seen = tensor[0, 0].double().numpy() * rule.std[0] + rule.mean[0]
    seen = seen[: frame.resized[0], : frame.resized[1]]
    rows, columns = np.mgrid[: seen.shape[0], : seen.shape[1]]
    centre = np.array([(seen * columns).sum(), (seen * rows).sum()]) / seen.sum()
    assert np.abs(centre - frame.to_model(spot)).max() < 0.05


@pytest.mark.parametrize("rule", RULES.values(), ids=RULES)
@pytest.mark.parametrize("size", SIZES, ids=str)
def test_the_whole_image_is_the_whole_input_but_for_the_padding(rule, size):
    height, width = size
    frame = rule.frame(size)
    corners = frame.to_model(np.array([[-0.5, -0.5], [width - 0.5, height - 0.5]]))
    assert corners[0] == pytest.approx([-0.5, -0.5])
    assert corners[1] == pytest.approx([frame.resized[1] - 0.5, frame.resized[0] - 0.5])


@pytest.mark.parametrize("name", ["padded", "stretched"])
@pytest.mark.parametrize("size", SIZES, ids=str)
@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("grid", [24, 96, 120])
def test_a_half_plane_returns_to_the_pixel(name, size, axis, grid):
    """Logits that are the distance to an edge: the mask ends exactly at that edge in the image."""
    frame = RULES[name].frame(size)
    last = size[1 - axis] - 1
    for edge in (0, 1, last // 2, last - 1, last):
        corner = np.zeros(2)
        corner[axis] = edge + 0.5  # between two pixels
        model_edge = frame.to_model(corner)[axis]
        stride = frame.padded[0] / grid
        samples = torch.arange(grid, dtype=torch.float64) * stride + (stride - 1) / 2
        logits = (model_edge - samples).float().expand(grid, grid)
        logits = logits if axis == 0 else logits.T
        mask = (frame.logits_to_image(logits[None])[0] > 0).numpy()
        wanted = np.zeros(size, dtype=bool)
        wanted[(slice(None), slice(edge + 1))[:: 1 if axis == 0 else -1]] = True
        # Bilinear resampling is constant within half a sample of the border, on both grids.
        flat = (stride / 2 + 0.5) / frame.scale_xy[axis]
        if flat < min(edge, last - edge) + 0.5:
            assert np.array_equal(mask, wanted)
        else:
            assert (mask ^ wanted).any(axis=axis).sum() <= np.ceil(flat)


@pytest.mark.parametrize("size", SIZES, ids=str)
def test_padding_is_as_in_the_processor_of_sam(size):
    transformers = pytest.importorskip("transformers", reason="needs the extra 'models'")
    theirs = transformers.SamImageProcessorPil(
        size={"longest_edge": 96}, pad_size={"height": 96, "width": 96}
    )
    image = np.random.default_rng(3).integers(0, 256, (*size, 3), dtype=np.uint8)
    wanted = theirs(image, return_tensors="pt")
    tensor, frame = RULES["padded"].tensor(image)
    assert tuple(wanted["reshaped_input_sizes"][0].tolist()) == frame.resized
    assert torch.allclose(tensor, wanted["pixel_values"].float(), atol=1e-5)

    logits = torch.randn(2, 24, 24, generator=torch.Generator().manual_seed(1))
    masks = theirs.post_process_masks(
        [logits[None]],
        [size],
        [frame.resized],
        binarize=False,
        pad_size={"height": 96, "width": 96},
    )
    assert torch.allclose(frame.logits_to_image(logits), masks[0][0], atol=1e-5)


@pytest.mark.parametrize("size", SIZES, ids=str)
def test_shortest_edge_is_as_in_the_processor_of_grounding_dino(size):
    transformers = pytest.importorskip("transformers", reason="needs the extra 'models'")
    theirs = transformers.GroundingDinoImageProcessorPil(
        size={"shortest_edge": 96, "longest_edge": 160}
    )
    image = np.random.default_rng(4).integers(0, 256, (*size, 3), dtype=np.uint8)
    wanted = theirs(image, return_tensors="pt")["pixel_values"].float()
    tensor, _ = RULES["kept"].tensor(image)
    # They truncate sizes where we round: one row or column may differ.
    assert np.abs(np.subtract(tensor.shape, wanted.shape)).max() <= 1
    if tensor.shape == wanted.shape:
        assert torch.allclose(tensor, wanted, atol=1e-5)


@pytest.mark.parametrize("size", SIZES, ids=str)
def test_stretching_is_as_in_torch(size):
    """The processors of SAM 2 and 3 resize with torchvision, which for tensors is this call."""
    image = np.random.default_rng(6).integers(0, 256, (*size, 3), dtype=np.uint8)
    planes = torch.from_numpy(image).permute(2, 0, 1)[None].float()
    resized = torch.nn.functional.interpolate(planes, (96, 96), mode="bilinear", antialias=True)
    rule = RULES["stretched"]
    mean, std = (torch.tensor(v)[:, None, None] for v in (rule.mean, rule.std))
    wanted = (resized / 255 - mean) / std
    # Pillow rounds to grey levels twice, once along each axis.
    assert (rule.tensor(image)[0] - wanted).abs().max() < 1.01 / 255 / min(rule.std)


@pytest.mark.parametrize("processor", ["Sam2ImageProcessor", "Sam3ImageProcessor"])
def test_stretching_is_as_in_the_processors_that_need_torchvision(processor):
    pytest.importorskip(
        "torchvision",
        reason="transformers' own processor, to compare with, needs torchvision; we do without it",
    )
    transformers = pytest.importorskip("transformers", reason="needs the extra 'models'")
    theirs = getattr(transformers, processor)(size={"height": 96, "width": 96})
    image = np.random.default_rng(5).integers(0, 256, (60, 100, 3), dtype=np.uint8)
    rule = Preprocessing("stretch", 96, mean=theirs.image_mean, std=theirs.image_std)
    wanted = theirs(image, return_tensors="pt")["pixel_values"].float()
    # One grey level: two implementations of the same filter round differently.
    assert (rule.tensor(image)[0] - wanted).abs().max() < 1.01 / 255 / min(theirs.image_std)


@pytest.mark.parametrize(
    "image",
    [
        np.zeros((4, 5), np.uint8),
        np.zeros((4, 5, 4), np.uint8),
        np.zeros((4, 5, 3), np.uint16),
        np.zeros((0, 5, 3), np.uint8),
    ],
    ids=["grey", "alpha", "16 bit", "empty"],
)
def test_images_of_another_kind_are_refused(image):
    with pytest.raises(
        InputError, match=r"shape .* Expected: \(height, width, 3\) RGB with 8 bits"
    ):
        RULES["padded"].tensor(image)
