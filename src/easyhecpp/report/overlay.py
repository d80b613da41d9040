"""Pictures with the rendered arm's outline drawn over them."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from easyhecpp._atomic import write_bytes
from easyhecpp._parallel import parallel_map
from easyhecpp.capture import Capture, View
from easyhecpp.errors import InputError
from easyhecpp.render import SilhouetteRenderer
from easyhecpp.report.outline import outline

F64 = NDArray[np.float64]
Mask = NDArray[Any]
RGB = tuple[int, int, int]

ARM: RGB = (255, 43, 149)
"""Colour of the rendered arm: a pink that neither robots nor rooms tend to have."""

MASK: RGB = (40, 225, 255)
"""Colour of the mask's outline; lighter than `ARM`, so that they differ without colour too."""

HALO: RGB = (12, 12, 20)
"""Drawn on both sides of a line, so that it shows on any background."""

_SHIFT = 4
_QUALITY = 92


def write_overlays(
    folder: str | os.PathLike[str],
    capture: Capture,
    T_mount_cam: F64,
    ids: Iterable[str] | None = None,
    masks: Mapping[str, Mask] | None = None,
) -> list[Path]:
    """Write ``<id>.jpg`` for every view that has a picture: the rendered arm's outline over it.

    Args:
        folder: Where to; it is made if need be.
        capture: Pictures, joints, robot and camera.
        T_mount_cam: ``(4, 4)`` pose of the camera in its mount.
        ids: The views to draw; all when left out.
        masks: Masks ``(H, W)`` by view id, bool or in [0, 1]; their outlines are drawn in a second
            colour.

    Returns:
        The files written, in the order of the views.

    Raises:
        InputError: The pose is no rigid transform, an id is unknown, a picture cannot be read, or
            the folder cannot be written.
    """
    T = check_pose(T_mount_cam)
    views = capture.views if ids is None else capture.subset(ids).views
    renderer = SilhouetteRenderer(capture.robot.meshes, capture.camera)

    def write(view: View) -> Path:
        coverage = renderer.coverage(capture.rig.Ts_cam_link(T, view.joints))
        image = view.image
        assert image is not None
        picture = draw_overlay(image, coverage, None if masks is None else masks.get(view.id))
        path = Path(folder) / f"{view.id}.jpg"
        write_bytes(path, jpeg(picture, _QUALITY))
        return path

    return parallel_map(write, [view for view in views if view.has_image])


def draw_overlay(
    image: NDArray[np.uint8], coverage: NDArray[np.float32], mask: Mask | None = None
) -> NDArray[np.uint8]:
    """The picture with the outline of the rendered arm, and below it that of a mask.

    Args:
        image: ``(H, W, 3)`` RGB; not changed.
        coverage: ``(H, W)`` in [0, 1].
        mask: ``(H, W)``, or None.
    """
    picture = np.ascontiguousarray(image).copy()
    if mask is not None:
        draw_lines(picture, outline(mask), MASK)
    draw_lines(picture, outline(coverage), ARM)
    return picture


def draw_lines(picture: NDArray[np.uint8], lines: Sequence[F64], colour: RGB) -> None:
    """Draw thin anti-aliased polylines with a dark rim, in place."""
    if not lines:
        return
    # OpenCV's fixed-point coordinates have the pixel's centre at integers, as ours.
    fixed = [np.rint(line * (1 << _SHIFT)).astype(np.int32)[:, None] for line in lines]
    rim = picture.copy()
    cv2.polylines(rim, fixed, False, HALO, 3, cv2.LINE_AA, _SHIFT)
    cv2.addWeighted(rim, 0.5, picture, 0.5, 0.0, dst=picture)
    for _ in range(2):  # once would be dull where a line runs between two rows of pixels
        cv2.polylines(picture, fixed, False, colour, 1, cv2.LINE_AA, _SHIFT)


def check_pose(T_mount_cam: F64) -> F64:
    """The pose as float64.

    Raises:
        InputError: It is no finite rigid ``(4, 4)`` transform.
    """
    T = np.asarray(T_mount_cam, np.float64)
    rigid = (
        T.shape == (4, 4)
        and bool(np.isfinite(T).all())
        and bool(np.allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-6))
        and bool(np.linalg.det(T[:3, :3]) > 0)
        and bool(np.allclose(T[3], (0.0, 0.0, 0.0, 1.0)))
    )
    if not rigid:
        raise InputError(
            "The pose T_mount_cam is no rigid transform",
            expected="a (4, 4) matrix with a rotation and a translation in metres",
        )
    return T


def jpeg(picture: NDArray[np.uint8], quality: int) -> bytes:
    """A JPEG file of an RGB picture with full colour resolution, so that thin lines stay crisp."""
    options = [
        cv2.IMWRITE_JPEG_QUALITY,
        quality,
        cv2.IMWRITE_JPEG_SAMPLING_FACTOR,
        cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444,
    ]
    _, data = cv2.imencode(".jpg", np.ascontiguousarray(picture[..., ::-1]), options)
    return data.tobytes()
