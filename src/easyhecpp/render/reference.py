"""Readable reference renderer, exact but for the number of samples.

The picture is asked at a regular grid of sample points inside every pixel: each sample's ray is
found by undoing the camera's distortion exactly, and is tested against every triangle that could be
hit, in normalised image coordinates (x / z, y / z), where triangles have straight sides whatever
the lens does. The fast kernels are judged by this module, so it is written to be read;
`easyhecpp.render.reference_compiled` is the same computation as machine code.

Conventions: an integer pixel coordinate is the pixel's centre; a sample exactly on an outline
counts as covered; the supersampling factor is odd, so that one sample lies on the pixel's centre
and no tie at one half can arise when a coverage is thresholded into a mask.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from easyhecpp.camera import Camera
from easyhecpp.errors import InputError
from easyhecpp.robot import LinkMesh

#: Surface closer to the camera's plane than this (metres) is cut away before projecting.
NEAR = 1e-3

#: Samples within this distance of an edge (normalised units, about 1e-9 px) count as inside, so
#: that rounding cannot open a crack between two triangles that share an edge.
EDGE_TOLERANCE = 1e-12

# Upper limit of samples tested at once: as many as stay in the cache.
_CHUNK_SAMPLES = 100_000


@dataclass(frozen=True)
class ProjectedTriangles:
    """Triangles in front of the camera, ready for sampling.

    Attributes:
        edges: (M, 3, 3) each edge's line as (a, b, c): a x + b y + c is the distance from the edge
            of the point (x, y) in normalised image coordinates, positive on the triangle's side.
        inverse_depths: (M, 3) the plane's (a, b, c): 1 / z = a x + b y + c in 1/m.
        links: (M,) index of the mesh that each triangle belongs to.
        boxes: (M, 4) first column, first row, one past the last column and row, in SAMPLES.
    """

    edges: NDArray[np.float64]
    inverse_depths: NDArray[np.float64]
    links: NDArray[np.int64]
    boxes: NDArray[np.int64]


def reference_coverage(
    meshes: Sequence[LinkMesh],
    camera: Camera,
    Ts_cam_link: NDArray[np.float64],
    supersample: int = 5,
) -> NDArray[np.float32]:
    """Share of every pixel that the union of the meshes covers.

    Args:
        meshes: L link meshes, vertices in their link's frame.
        camera: the camera; any distortion is honoured exactly.
        Ts_cam_link: (L, 4, 4) poses of the links in the camera's frame.
        supersample: samples per pixel and direction; odd.

    Returns:
        (H, W) coverage in [0, 1], a multiple of 1 / supersample**2.

    Raises:
        InputError: if `supersample` is even or not positive.
    """
    check_supersample(supersample)
    covered = np.zeros((camera.height * supersample, camera.width * supersample), dtype=bool)
    triangles = project_triangles(meshes, camera, Ts_cam_link, supersample)
    for hits in _hits(triangles, camera, supersample):
        covered[hits.rows, hits.columns] = True
    blocks = covered.reshape(camera.height, supersample, camera.width, supersample)
    return blocks.mean(axis=(1, 3), dtype=np.float64).astype(np.float32)


def reference_visible_links(
    meshes: Sequence[LinkMesh], camera: Camera, Ts_cam_link: NDArray[np.float64]
) -> tuple[NDArray[np.int16], NDArray[np.float32]]:
    """The nearest link at every pixel's centre, and its depth.

    Args:
        meshes: L link meshes, vertices in their link's frame.
        camera: the camera; any distortion is honoured exactly.
        Ts_cam_link: (L, 4, 4) poses of the links in the camera's frame.

    Returns:
        (H, W) index of the nearest link (-1: none) and (H, W) its depth along the optical axis in
        metres (infinite: none).
    """
    links = np.full((camera.height, camera.width), -1, dtype=np.int16)
    nearest = np.zeros((camera.height, camera.width))  # of 1 / z: larger is nearer
    triangles = project_triangles(meshes, camera, Ts_cam_link, supersample=1)
    for hits in _hits(triangles, camera, supersample=1):
        # Several triangles may hit a pixel within one chunk: write the farthest first.
        order = np.argsort(hits.inverse_depths, kind="stable")
        rows, columns = hits.rows[order], hits.columns[order]
        inverse_depths = hits.inverse_depths[order]
        nearer = inverse_depths > nearest[rows, columns]
        rows, columns = rows[nearer], columns[nearer]
        nearest[rows, columns] = inverse_depths[nearer]
        links[rows, columns] = triangles.links[hits.triangles[order][nearer]]
    depth = np.full(nearest.shape, np.inf, dtype=np.float32)
    np.divide(1.0, nearest, out=depth, where=nearest > 0, casting="same_kind")
    return links, depth


def check_supersample(supersample: int) -> None:
    """Raise InputError unless the supersampling factor is odd and positive."""
    if supersample < 1 or supersample % 2 == 0:
        raise InputError(
            f"the supersampling factor is {supersample}",
            expected="an odd number, such as 3 or 5",
            fix="even factors lose ties when a coverage is thresholded; take the next odd number",
        )


def sample_positions(first: int, last: int, supersample: int) -> NDArray[np.float64]:
    """Pixel coordinates of the samples `first` to `last - 1` along one axis.

    Sample k of pixel u lies at u - 0.5 + (k + 0.5) / supersample, because the integer u is the
    pixel's centre.
    """
    return (np.arange(first, last) + 0.5) / supersample - 0.5


def project_triangles(
    meshes: Sequence[LinkMesh],
    camera: Camera,
    Ts_cam_link: NDArray[np.float64],
    supersample: int,
) -> ProjectedTriangles:
    """Clip all triangles at the near plane, project them, and bound the samples each may hit."""
    Ts_cam_link = np.asarray(Ts_cam_link, dtype=np.float64)
    clipped = [np.empty((0, 3, 3))]
    links = [np.empty(0, dtype=np.int64)]
    for index, (mesh, T_cam_link) in enumerate(zip(meshes, Ts_cam_link, strict=True)):
        points_cam = mesh.vertices @ T_cam_link[:3, :3].T + T_cam_link[:3, 3]
        triangles_cam = clip_near(points_cam[mesh.faces])
        clipped.append(triangles_cam)
        links.append(np.full(len(triangles_cam), index))
    corners_cam = np.concatenate(clipped)
    corners = corners_cam[..., :2] / corners_cam[..., 2:]
    boxes = _sample_boxes(corners, camera, supersample)
    # A triangle seen edge-on has no inside; its neighbours cover what it could have covered.
    areas = _cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    keep = np.abs(areas) > EDGE_TOLERANCE * np.ptp(corners, axis=1).max(axis=1)
    keep &= (boxes[:, 0] < boxes[:, 2]) & (boxes[:, 1] < boxes[:, 3])
    return ProjectedTriangles(
        _edge_lines(corners[keep], np.sign(areas[keep])),
        _inverse_depth_planes(corners_cam[keep]),
        np.concatenate(links)[keep],
        boxes[keep],
    )


def clip_near(triangles: NDArray[np.float64], near: float = NEAR) -> NDArray[np.float64]:
    """Cut triangles at the plane z = near and keep what lies in front.

    Args:
        triangles: (N, 3, 3) corners in the camera's frame.
        near: depth of the cutting plane, metres.

    Returns:
        (M, 3, 3) triangles with every z >= near. A triangle with two corners in front becomes two.
    """
    in_front = triangles[..., 2] >= near
    count = in_front.sum(axis=1)
    # Roll the corners so that the single corner in front (or behind) comes first.
    odd_one = np.argmax(np.where((count == 1)[:, None], in_front, ~in_front), axis=1)
    order = (odd_one[:, None] + np.arange(3)) % 3
    rolled = np.take_along_axis(triangles, order[:, :, None], axis=1)

    def cut(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
        share = (near - a[:, 2]) / (b[:, 2] - a[:, 2])
        point = a + share[:, None] * (b - a)
        point[:, 2] = near
        return point

    a, b, c = (rolled[count == 1, i] for i in range(3))
    tips = np.stack([a, cut(a, b), cut(a, c)], axis=1)
    a, b, c = (rolled[count == 2, i] for i in range(3))
    ab, ac = cut(a, b), cut(a, c)
    quads = [np.stack([ab, b, c], axis=1), np.stack([ab, c, ac], axis=1)]
    return np.concatenate([triangles[count == 3], tips, *quads])


def _edge_lines(
    corners: NDArray[np.float64], orientations: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Lines (M, 3, 3) through the edges, normals of unit length pointing into the triangles.

    Args:
        corners: (M, 3, 2) normalised image coordinates.
        orientations: (M,) +1 counter-clockwise, -1 clockwise.
    """
    along = np.roll(corners, -1, axis=1) - corners
    normals = np.stack([-along[..., 1], along[..., 0]], axis=-1)
    normals *= orientations[:, None, None]
    normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-300)
    offsets = -(normals * corners).sum(axis=-1, keepdims=True)
    return np.concatenate([normals, offsets], axis=-1)


def _inverse_depth_planes(corners_cam: NDArray[np.float64]) -> NDArray[np.float64]:
    """Coefficients (M, 3) of 1 / z over the image: from n . p = d and p = z (x, y, 1)."""
    a, b, c = corners_cam[:, 0], corners_cam[:, 1], corners_cam[:, 2]
    normals = np.cross(b - a, c - a)
    return normals / (normals * a).sum(axis=-1, keepdims=True)


def _sample_boxes(
    corners: NDArray[np.float64], camera: Camera, supersample: int
) -> NDArray[np.int64]:
    """Sample boxes that surely hold every sample which may lie in each triangle.

    With a distorting lens the outline of a triangle is curved, so its corners do not bound it. The
    triangle's rectangle in normalised coordinates, cut to what the image can see, is laid with 5x5
    points; the box of their projections, widened by their largest second difference (many times
    the bulge between neighbouring points), bounds all of it.
    """
    view_low, view_high = _view_rectangle(camera)
    # Short axes come first: numpy is slow at reducing them otherwise.
    by_corner = np.moveaxis(corners, 1, 0)
    lowest, highest = by_corner.min(axis=0), by_corner.max(axis=0)
    low, high = np.clip(lowest, view_low, view_high), np.clip(highest, view_low, view_high)
    outside = (highest < view_low) | (lowest > view_high)

    steps = np.linspace(0.0, 1.0, 5 if camera.is_distorted else 2)
    grid = np.stack(np.meshgrid(steps, steps), axis=-1)[:, :, None]
    xy = low + grid * (high - low)
    pixels = camera.project(np.concatenate([xy, np.ones_like(xy[..., :1])], axis=-1))
    margin = np.full((len(corners), 2), 1e-6)
    if camera.is_distorted:
        for axis in (0, 1):
            margin += np.abs(np.diff(pixels, n=2, axis=axis)).max(axis=(0, 1))
    first = np.ceil(_to_samples(pixels.min(axis=(0, 1)) - margin, supersample))
    last = np.floor(_to_samples(pixels.max(axis=(0, 1)) + margin, supersample))
    size = np.array([camera.width, camera.height]) * supersample
    first = np.clip(first, 0, size)
    last = np.clip(last + 1, 0, size)
    last[outside.any(axis=1)] = 0
    return np.concatenate([first, last], axis=1).astype(np.int64)


def _view_rectangle(camera: Camera) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Smallest and largest normalised coordinates that any sample of the image can have.

    They lie on the image's border; the margin of 5 % covers the spacing of the border points. In
    a fisheye's corners there may be no ray at all, and close by rays may point anywhere.
    """
    columns = np.linspace(-0.5, camera.width - 0.5, 65)
    rows = np.linspace(-0.5, camera.height - 0.5, 65)
    border = np.concatenate(
        [np.stack([columns, np.full(65, row)], axis=-1) for row in (rows[0], rows[-1])]
        + [np.stack([np.full(65, column), rows], axis=-1) for column in (columns[0], columns[-1])]
    )
    xy = camera.unproject(border)[:, :2]
    if np.isnan(xy).any():
        return np.full(2, -1.0 / NEAR), np.full(2, 1.0 / NEAR)
    low, high = xy.min(axis=0), xy.max(axis=0)
    margin = 0.05 * (high - low)
    return low - margin, high + margin


def _to_samples(pixels: NDArray[np.float64], supersample: int) -> NDArray[np.float64]:
    """Inverse of `sample_positions`: sample index, not rounded, of a pixel coordinate."""
    return (pixels + 0.5) * supersample - 0.5


@dataclass(frozen=True)
class _Hits:
    """Samples found inside triangles: parallel arrays (K,)."""

    rows: NDArray[np.int64]
    columns: NDArray[np.int64]
    triangles: NDArray[np.int64]
    inverse_depths: NDArray[np.float64]


def _hits(triangles: ProjectedTriangles, camera: Camera, supersample: int) -> Iterator[_Hits]:
    """Test every sample in every triangle's box, some million pairs at a time."""
    if not len(triangles.boxes):
        return
    left, top = triangles.boxes[:, :2].min(axis=0)
    right, bottom = triangles.boxes[:, 2:].max(axis=0)
    rays = sample_rays(camera, supersample, (left, top, right, bottom))
    rays_x, rays_y = rays[..., 0].ravel(), rays[..., 1].ravel()

    owners, boxes = _bands(triangles.boxes)
    widths = boxes[:, 2] - boxes[:, 0]
    areas = widths * (boxes[:, 3] - boxes[:, 1])
    for first, last in _chunks(areas):
        # One entry per (box, sample in it).
        repeats = areas[first:last]
        within = np.arange(repeats.sum()) - np.repeat(np.cumsum(repeats) - repeats, repeats)
        row, column = np.divmod(within, np.repeat(widths[first:last], repeats))
        row += np.repeat(boxes[first:last, 1], repeats)
        column += np.repeat(boxes[first:last, 0], repeats)
        ray = (row - top) * (right - left) + (column - left)
        x, y = rays_x[ray], rays_y[ray]

        owner = owners[first:last]
        inside = np.ones(len(ray), dtype=bool)
        for edge in range(3):
            a, b, c = np.repeat(triangles.edges[owner, edge].T, repeats, axis=1)
            inside &= a * x + b * y + c >= -EDGE_TOLERANCE
        hit = np.repeat(owner, repeats)[inside]
        a, b, c = triangles.inverse_depths[hit].T
        yield _Hits(row[inside], column[inside], hit, a * x[inside] + b * y[inside] + c)


def _bands(boxes: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Cut large boxes into bands of rows; returns the triangle of each band, and the bands."""
    heights = boxes[:, 3] - boxes[:, 1]
    band_heights = np.maximum(1, _CHUNK_SAMPLES // 4 // (boxes[:, 2] - boxes[:, 0]))
    counts = -(-heights // band_heights)
    owners = np.repeat(np.arange(len(boxes)), counts)
    number = np.arange(len(owners)) - np.repeat(np.cumsum(counts) - counts, counts)
    bands = boxes[owners]
    bands[:, 1] += number * band_heights[owners]
    bands[:, 3] = np.minimum(bands[:, 3], bands[:, 1] + band_heights[owners])
    return owners, bands


def sample_rays(
    camera: Camera, supersample: int, box: tuple[int, int, int, int]
) -> NDArray[np.float64]:
    """Normalised image coordinates (rows, columns, 2) of the samples in a box of samples."""
    left, top, right, bottom = box
    columns = sample_positions(left, right, supersample)
    rows = sample_positions(top, bottom, supersample)
    rays = np.empty((len(rows), len(columns), 2))
    for first in range(0, len(rows), 256):  # in bands of rows, to bound the memory
        band = rows[first : first + 256]
        pixels = np.stack(np.broadcast_arrays(columns[None, :], band[:, None]), axis=-1)
        rays[first : first + 256] = camera.unproject(pixels)[..., :2]
    return rays


def _chunks(areas: NDArray[np.int64]) -> Iterator[tuple[int, int]]:
    """Ranges of triangles whose boxes together hold at most `_CHUNK_SAMPLES` (at least one)."""
    ends = np.cumsum(areas)
    first = 0
    while first < len(areas):
        done = ends[first - 1] if first else 0
        last = int(np.searchsorted(ends, done + _CHUNK_SAMPLES, side="right"))
        last = max(last, first + 1)
        yield first, last
        first = last


def _cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
