"""One view as the report shows it: its picture, the two outlines, the worst place enlarged."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from easyhecpp._parallel import parallel_map
from easyhecpp.capture import Capture, View
from easyhecpp.render import SilhouetteRenderer
from easyhecpp.report.outline import outline, simplify

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
Mask = NDArray[np.bool_]
Picture = NDArray[np.uint8]

_TOLERANCE_PX = 0.12
_WIDTH_PX, _WIDTH_OF_MANY_PX, _MANY = 960, 640, 24
_QUALITY, _ZOOM_QUALITY = 80, 90
# The enlarged window's share of the picture's width, and its shape.
_ZOOM_SHARE, _ZOOM_ASPECT = 0.11, 0.75


@dataclass(frozen=True)
class Zoom:
    """The window in which rendered arm and mask differ most; pixels of the full picture.

    Attributes:
        x: Left column.
        y: Top row.
        width: Columns.
        height: Rows.
        gap_px: Width of the widest difference in it.
        uri: That part of the picture as a data URI, "" when the view has no picture.
    """

    x: int
    y: int
    width: int
    height: int
    gap_px: float
    uri: str


@dataclass(frozen=True)
class ViewPicture:
    """What the report shows of one view.

    Attributes:
        id: Name of the view.
        uri: The picture as a data URI, reduced; "" when the view has none.
        arm: The rendered arm's outline as SVG path data in pixels of the full picture.
        mask: The same of the mask.
        zoom: The worst place; None without a pose, without a mask, or without any difference.
        lines: The rendered arm's outline, ``(N, 2)`` each, not simplified.
    """

    id: str
    uri: str
    arm: str
    mask: str
    zoom: Zoom | None
    lines: Sequence[F64]


def view_pictures(
    capture: Capture, T_mount_cam: F64 | None, masks: Mapping[str, Mask]
) -> list[ViewPicture]:
    """Prepare every view of a capture.

    Args:
        capture: Pictures, joints, robot, camera.
        T_mount_cam: ``(4, 4)``, None when there is no pose to render.
        masks: By view id.
    """
    renderer = SilhouetteRenderer(capture.robot.meshes, capture.camera)
    width = _WIDTH_PX if len(capture.views) <= _MANY else _WIDTH_OF_MANY_PX

    def prepare(view: View) -> ViewPicture:
        coverage = None
        if T_mount_cam is not None:
            coverage = renderer.coverage(capture.rig.Ts_cam_link(T_mount_cam, view.joints))
        image, mask = view.image, masks.get(view.id)
        lines = [] if coverage is None else outline(coverage)
        zoom = None
        if coverage is not None and mask is not None:
            zoom = _worst_place(coverage, mask, image)
        return ViewPicture(
            id=view.id,
            uri="" if image is None else _data_uri(_reduced(image, width), _QUALITY),
            arm=path_data(lines),
            mask="" if mask is None else path_data(outline(mask)),
            zoom=zoom,
            lines=lines,
        )

    return parallel_map(prepare, capture.views)


def path_data(lines: Sequence[F64]) -> str:
    """Polylines as the ``d`` of an SVG path, to a tenth of a pixel."""
    parts: list[str] = []
    for line in simplify(lines, _TOLERANCE_PX):
        numbers = " ".join(f"{value:.1f}" for value in line.ravel().tolist())
        parts.append(f"M{numbers}")
    return "".join(parts)


def _worst_place(coverage: F32, mask: Mask, image: Picture | None) -> Zoom | None:
    differs = ((coverage > 0.5) != mask).astype(np.uint8)
    rows, columns = differs.shape
    width = min(columns, max(64, round(_ZOOM_SHARE * columns)))
    height = min(rows, round(_ZOOM_ASPECT * width))
    # Depth inside of the difference counts broad differences more than long thin ones.
    depth = cv2.distanceTransform(differs, cv2.DIST_L2, cv2.DIST_MASK_3)
    total = cv2.boxFilter(
        depth, cv2.CV_32F, (width, height), normalize=False, borderType=cv2.BORDER_CONSTANT
    )
    best = int(np.argmax(total))
    if total.flat[best] <= 0:
        return None
    row, column = divmod(best, columns)
    x = int(np.clip(column - width // 2, 0, columns - width))
    y = int(np.clip(row - height // 2, 0, rows - height))
    window = slice(y, y + height), slice(x, x + width)
    return Zoom(
        x=x,
        y=y,
        width=width,
        height=height,
        gap_px=2.0 * float(depth[window].max()) - 1.0,
        uri="" if image is None else _data_uri(image[window], _ZOOM_QUALITY),
    )


def _reduced(image: Picture, width: int) -> Picture:
    if image.shape[1] <= width:
        return image
    height = max(1, round(image.shape[0] * width / image.shape[1]))
    return cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)  # type: ignore[return-value]


def _data_uri(image: Picture, quality: int) -> str:
    options = [cv2.IMWRITE_JPEG_QUALITY, quality]
    _, data = cv2.imencode(".jpg", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), options)
    return as_uri(data, "image/jpeg")


def as_uri(data: Any, kind: str) -> str:
    """A file's content as a URI that needs no network.

    Args:
        data: Bytes, or an array of them.
        kind: MIME type.
    """
    return f"data:{kind};base64,{base64.b64encode(bytes(data)).decode('ascii')}"
