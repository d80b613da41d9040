"""AutoSAM's prompts: boxes and points that the kinematic model projects into an image.

The paper (section on automatic segmentation, table on prompts) compares six ways to ask SAM for the
arm; all are here, and (e), a box for each link and for each pair of adjacent links, is the default.
Unlike the paper, a box surrounds only what is VISIBLE of a link, and grows with the pose's
uncertainty.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from easyhecpp.camera import Camera
from easyhecpp.errors import InputError
from easyhecpp.geometry import hat, transform_points
from easyhecpp.robot import LinkMesh
from easyhecpp.segment.protocols import FloatArray, Prompts

# SAM was trained with boxes that are off by up to a tenth of their side, 20 px at most; a pose that
# is so unsure that a box would grow by more than half its side points at nothing in particular.
_LARGEST_PADDING = 0.5
_SIGMAS = 2.0
_VERTICES_PER_LINK = 200


@dataclass(frozen=True)
class Variant:
    """A row of the paper's table on prompts.

    Attributes:
        letter: ``a`` to ``f``.
        per_link: a box for each link, not one for the arm.
        points: each box comes with its centre point.
        connectors: a box for each pair of adjacent links, too.
        paper_iou: mask IoU in the paper, percent (xArm, eye-to-hand, synthetic).
    """

    letter: str
    per_link: bool
    points: bool
    connectors: bool
    paper_iou: float


VARIANTS = {
    variant.letter: variant
    for variant in (
        Variant("a", per_link=False, points=False, connectors=False, paper_iou=92.3),
        Variant("b", per_link=False, points=True, connectors=False, paper_iou=93.0),
        Variant("c", per_link=True, points=False, connectors=False, paper_iou=93.7),
        Variant("d", per_link=True, points=True, connectors=False, paper_iou=94.2),
        Variant("e", per_link=True, points=False, connectors=True, paper_iou=98.2),
        Variant("f", per_link=True, points=True, connectors=True, paper_iou=98.2),
    )
}
DEFAULT_VARIANT = "e"


@dataclass(frozen=True)
class ArmPrompts:
    """The prompts of one view.

    Attributes:
        prompts: what the segmenter is asked; None when no link is visible.
        targets: for each prompt the links (indices) that it is about.
        labels: for each prompt its name in messages.
        skipped: sentences about links that got no prompt.
    """

    prompts: Prompts | None
    targets: tuple[tuple[int, ...], ...]
    labels: tuple[str, ...]
    skipped: tuple[str, ...]


def find_variant(letter: str) -> Variant:
    """The variant of a letter.

    Raises:
        InputError: there is none.
    """
    if letter not in VARIANTS:
        raise InputError(
            f"unknown prompt variant {letter!r}",
            expected=f"one of {', '.join(VARIANTS)} (the paper's table on prompts)",
            fix=f"{DEFAULT_VARIANT} is the default",
        )
    return VARIANTS[letter]


def arm_prompts(
    boxes: FloatArray,
    visible: NDArray[np.integer],
    link_names: Sequence[str],
    parents: Sequence[int],
    variant: str = DEFAULT_VARIANT,
    padding_px: FloatArray | float = 0.0,
    min_visible_px: int = 25,
) -> ArmPrompts:
    """The prompts of one view, from what a renderer says is visible.

    Args:
        boxes: (L, 4) ``x0 y0 x1 y1`` of each link's visible part, px; nan for none
            (``SilhouetteRenderer.boxes``).
        visible: (H, W) index of the nearest link at each pixel, -1 for none
            (``SilhouetteRenderer.visible_links``).
        link_names: the L links.
        parents: (L,) for each link the next link with geometry towards the base, -1 for none.
        variant: row of the paper's table.
        padding_px: by how much the boxes grow on each side: a number, (L, 1), or (L, 2) for x
            and y.
        min_visible_px: links that show fewer pixels get no prompt.

    Raises:
        InputError: unknown variant.
    """
    rule = find_variant(variant)
    pixels = np.bincount(visible[visible >= 0].ravel(), minlength=len(link_names))
    shown = [i for i in range(len(link_names)) if pixels[i] >= max(min_visible_px, 1)]
    skipped = tuple(
        _why_skipped(name, int(pixels[i])) for i, name in enumerate(link_names) if i not in shown
    )
    if not shown:
        return ArmPrompts(None, (), (), skipped)
    padded = _padded(boxes, padding_px, visible.shape)
    targets = [(i,) for i in shown] if rule.per_link else [tuple(shown)]
    if rule.connectors:
        targets += [(parents[i], i) for i in shown if parents[i] in shown]
    asked = np.stack([_hull(padded[list(links)]) for links in targets])
    points = (asked[:, None, :2] + asked[:, None, 2:]) / 2 if rule.points else None
    labels = tuple(" + ".join(link_names[i] for i in links) for links in targets)
    if not rule.per_link:
        labels = ("the whole arm",)
    return ArmPrompts(Prompts(boxes=asked, points=points), tuple(targets), labels, skipped)


def padding_from_covariance(
    camera: Camera,
    meshes: Sequence[LinkMesh],
    Ts_cam_link: FloatArray,
    covariance: FloatArray,
) -> FloatArray:
    """How far the links may be from where the pose puts them, in px.

    Args:
        camera: the camera.
        meshes: the L links.
        Ts_cam_link: (L, 4, 4).
        covariance: (6, 6) of the tangent of ``T_mount_cam @ exp([v, w])``.

    Returns:
        (L, 2) along x and y: two standard deviations of the link's least certain vertex.
    """
    padding = np.zeros((len(meshes), 2))
    for i, (mesh, T_cam_link) in enumerate(zip(meshes, Ts_cam_link, strict=True)):
        step = max(1, len(mesh.vertices) // _VERTICES_PER_LINK)
        points = transform_points(T_cam_link, mesh.vertices[::step])
        # What is behind the camera is not in the image, and what nearly is has no linear error.
        points = points[points[:, 2] > 0.05]
        if len(points) == 0:
            continue
        # A camera moved by exp([v, w]) sees a point moved by -v - w x p.
        motion = np.concatenate([np.broadcast_to(-np.eye(3), (len(points), 3, 3)), hat(points)], 2)
        to_pixels = camera.project_with_jacobian(points)[1] @ motion
        variances = np.einsum("nij,jk,nik->ni", to_pixels, covariance, to_pixels)
        padding[i] = _SIGMAS * np.sqrt(variances.max(axis=0))
    return padding


def _padded(
    boxes: FloatArray, padding_px: FloatArray | float, image_size: tuple[int, ...]
) -> FloatArray:
    sides = boxes[:, 2:] - boxes[:, :2] + 1
    grow = np.minimum(np.asarray(padding_px, dtype=np.float64), _LARGEST_PADDING * sides)
    last = np.array([image_size[1] - 1, image_size[0] - 1])
    low = np.clip(boxes[:, :2] - grow, 0, last)
    high = np.clip(boxes[:, 2:] + grow, 0, last)
    return np.concatenate([low, high], axis=1)


def _hull(boxes: FloatArray) -> FloatArray:
    return np.concatenate([boxes[:, :2].min(axis=0), boxes[:, 2:].max(axis=0)])


def _why_skipped(name: str, pixels: int) -> str:
    if pixels == 0:
        return f"{name} is out of view or hidden: no prompt."
    return f"{name} shows {pixels} px only: no prompt."
