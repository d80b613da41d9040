from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from easyhecpp.camera import Camera
from easyhecpp.errors import InputError
from easyhecpp.geometry import exp_se3, make_transform
from easyhecpp.render.reference import clip_near, reference_coverage, reference_visible_links
from easyhecpp.render.reference_compiled import reference_coverage_compiled
from easyhecpp.robot import LinkMesh

CAMERA = Camera(width=64, height=48, fx=50.0, fy=60.0, cx=31.0, cy=24.5)
PLUMB_BOB = Camera(
    width=160,
    height=120,
    fx=110.0,
    fy=112.0,
    cx=78.3,
    cy=61.0,
    distortion_model="plumb_bob",
    distortion=(-0.28, 0.09, 0.002, -0.001, 0.0),
)
FISHEYE = Camera(
    width=160,
    height=120,
    fx=60.0,
    fy=60.0,
    cx=79.5,
    cy=59.5,
    distortion_model="equidistant",
    distortion=(0.02, -0.01, 0.003, 0.0),
)

Coverage = Callable[..., NDArray[np.float32]]


@pytest.fixture(params=[reference_coverage, reference_coverage_compiled])
def coverage(request: pytest.FixtureRequest) -> Coverage:
    return request.param


def flat(corners_px: list[tuple[float, float]], camera: Camera = CAMERA, depth: float = 1.0):
    """A convex polygon at constant depth whose corners project to the given pixels."""
    vertices = camera.unproject(np.array(corners_px)) * depth
    faces = [(0, i, i + 1) for i in range(1, len(corners_px) - 1)]
    return LinkMesh.from_triangles(vertices, np.array(faces))


def rectangle(left: float, top: float, right: float, bottom: float, depth: float = 1.0):
    return flat([(left, top), (right, top), (right, bottom), (left, bottom)], depth=depth)


def sphere(radius: float, steps: int = 40) -> LinkMesh:
    """A latitude-longitude sphere around the origin."""
    polar, azimuth = np.meshgrid(
        np.linspace(0, np.pi, steps), np.linspace(0, 2 * np.pi, 2 * steps), indexing="ij"
    )
    vertices = np.stack(
        [np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], axis=-1
    )
    corner = np.arange(polar.size).reshape(polar.shape)
    a, b, c, d = corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]
    faces = np.concatenate([np.stack(t, axis=-1).reshape(-1, 3) for t in ((a, b, c), (a, c, d))])
    return LinkMesh.from_triangles(radius * vertices.reshape(-1, 3), faces)


def at(x: float, y: float, z: float) -> NDArray[np.float64]:
    return make_transform(np.eye(3), [x, y, z])[None]


IDENTITY = np.eye(4)[None]


def test_integer_coordinates_are_pixel_centres(coverage: Coverage) -> None:
    # From the left edge of pixel 10 (9.5) to the right edge of pixel 12 (12.5): three pixels.
    result = coverage([rectangle(9.5, 19.5, 12.5, 20.5)], CAMERA, IDENTITY)
    rows, columns = np.nonzero(result)
    assert set(rows) == {20}
    assert set(columns) == {10, 11, 12}
    np.testing.assert_array_equal(result[20, 10:13], 1.0)


@pytest.mark.parametrize("supersample", [1, 3, 5, 25])
def test_half_plane_edge_at_sub_pixel_positions(coverage: Coverage, supersample: int) -> None:
    for edge in np.linspace(29.5, 30.5, 14)[1:-1] + 1e-4:
        mesh = rectangle(-100.0, -100.0, edge, 100.0)
        result = coverage([mesh], CAMERA, IDENTITY, supersample)
        np.testing.assert_array_equal(result[:, :30], 1.0)
        np.testing.assert_array_equal(result[:, 31:], 0.0)
        exact = edge - 29.5
        assert np.abs(result[:, 30] - exact).max() <= 0.5 / supersample + 1e-6


def test_half_plane_edge_is_unbiased(coverage: Coverage) -> None:
    edges = np.random.default_rng(0).uniform(29.5, 30.5, 400)
    errors = [
        coverage([rectangle(-9, -9, edge, 99)], CAMERA, IDENTITY, 5)[24, 30] - (edge - 29.5)
        for edge in edges
    ]
    assert abs(np.mean(errors)) < 0.01  # standard error 0.2 / sqrt(12 * 400) = 0.003


def test_area_of_a_rectangle_and_of_a_triangle(coverage: Coverage) -> None:
    result = coverage([rectangle(10.2, 8.7, 41.9, 30.4)], CAMERA, IDENTITY, 9)
    assert result.sum() == pytest.approx((41.9 - 10.2) * (30.4 - 8.7), abs=3.0)
    result = coverage([flat([(5.3, 4.1), (57.7, 13.2), (22.4, 44.9)])], CAMERA, IDENTITY, 9)
    area = 0.5 * abs((57.7 - 5.3) * (44.9 - 4.1) - (22.4 - 5.3) * (13.2 - 4.1))
    assert result.sum() == pytest.approx(area, rel=1e-3)


def test_winding_does_not_matter(coverage: Coverage) -> None:
    corners = [(5.3, 4.1), (57.7, 13.2), (22.4, 44.9)]
    one = coverage([flat(corners)], CAMERA, IDENTITY)
    other = coverage([flat(corners[::-1])], CAMERA, IDENTITY)
    np.testing.assert_array_equal(one, other)


def test_shared_edges_leave_no_cracks(coverage: Coverage) -> None:
    # The diagonal of this square runs through sample points, where rounding could lose them.
    result = coverage([rectangle(10.0, 10.0, 40.0, 40.0)], CAMERA, IDENTITY)
    np.testing.assert_array_equal(result[11:40, 11:40], 1.0)


def test_sphere_covers_the_disc_of_its_tangent_cone(coverage: Coverage) -> None:
    radius, distance = 0.3, 1.2
    result = coverage([sphere(radius, 120)], CAMERA, at(0, 0, distance), 9)
    tangent = radius / np.sqrt(distance**2 - radius**2)
    assert result.sum() == pytest.approx(np.pi * tangent**2 * CAMERA.fx * CAMERA.fy, rel=1e-3)
    rows, columns = np.mgrid[: CAMERA.height, : CAMERA.width]
    assert (result * columns).sum() / result.sum() == pytest.approx(CAMERA.cx, abs=0.01)
    assert (result * rows).sum() / result.sum() == pytest.approx(CAMERA.cy, abs=0.01)


def test_union_counts_overlaps_once(coverage: Coverage) -> None:
    # Every edge lies half way between two samples, so the areas come out exact.
    a = rectangle(5.1, 5.1, 30.3, 30.1)
    b = rectangle(20.1, 10.1, 50.7, 40.1, depth=2.0)
    both = coverage([a, b], CAMERA, np.repeat(IDENTITY, 2, axis=0))
    one = coverage([a], CAMERA, IDENTITY)
    other = coverage([b], CAMERA, IDENTITY)
    assert (both >= np.maximum(one, other) - 1e-6).all()
    assert (both <= np.minimum(1.0, one + other) + 1e-6).all()
    assert one.sum() == pytest.approx(25.2 * 25.0)
    assert both.sum() == pytest.approx(one.sum() + other.sum() - 10.2 * 20.0)


def test_nothing_to_see(coverage: Coverage) -> None:
    assert coverage([], CAMERA, np.zeros((0, 4, 4))).sum() == 0.0
    assert coverage([sphere(0.2)], CAMERA, at(0, 0, -1.0)).sum() == 0.0  # behind the camera
    assert coverage([sphere(0.2)], CAMERA, at(5.0, 0, 1.0)).sum() == 0.0  # beside the picture
    edge_on = LinkMesh.from_triangles(
        np.array([[0.1, 0, 1], [0.2, 0, 2], [0.1, 0, 3]], dtype=float), np.array([[0, 1, 2]])
    )
    assert coverage([edge_on], CAMERA, IDENTITY).sum() == 0.0


def test_camera_inside_a_closed_mesh_sees_it_everywhere(coverage: Coverage) -> None:
    np.testing.assert_array_equal(coverage([sphere(0.5)], CAMERA, at(0, 0, 0.1)), 1.0)


def test_ground_plane_passing_below_the_camera_is_cut_at_the_horizon(coverage: Coverage) -> None:
    # A floor 1 m below the camera, from 50 m behind it to 50 m in front: rows below the horizon.
    floor = LinkMesh.from_triangles(
        np.array([[-50, 1, -50], [50, 1, -50], [50, 1, 50], [-50, 1, 50]], dtype=float),
        np.array([[0, 1, 2], [0, 2, 3]]),
    )
    result = coverage([floor], CAMERA, IDENTITY, 5)
    far_edge = CAMERA.cy + CAMERA.fy / 50.0
    np.testing.assert_array_equal(result[int(np.ceil(far_edge + 0.5)) :], 1.0)
    np.testing.assert_array_equal(result[: int(np.floor(far_edge - 0.5))], 0.0)


def test_clipping_keeps_the_area_in_front() -> None:
    one_in_front = np.array([[[0, 0, 1], [2, 0, -1], [0, 2, -1]]], dtype=float)
    two_in_front = np.array([[[0, 0, -1], [2, 0, 1], [0, 2, 1]]], dtype=float)
    behind = np.array([[[0, 0, -1], [2, 0, -1], [0, 2, -1]]], dtype=float)

    def area(triangles: NDArray[np.float64]) -> float:
        a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
        return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)

    # Cutting half way along both edges leaves a quarter, or three quarters.
    assert area(clip_near(one_in_front, 0.0)) == pytest.approx(area(one_in_front) / 4)
    assert area(clip_near(two_in_front, 0.0)) == pytest.approx(3 * area(two_in_front) / 4)
    assert len(clip_near(behind, 0.0)) == 0
    assert (clip_near(one_in_front, 1e-3)[..., 2] >= 1e-3).all()


@pytest.mark.parametrize("camera", [PLUMB_BOB, FISHEYE], ids=["plumb_bob", "fisheye"])
def test_distortion_is_exact(coverage: Coverage, camera: Camera) -> None:
    """Against the lens model itself: rays at pixel centres, and the area of the bent outline."""
    low, high = np.array([-0.45, -0.35]), np.array([0.42, 0.38])
    mesh = LinkMesh.from_triangles(
        np.array([[*low, 1], [high[0], low[1], 1], [*high, 1], [low[0], high[1], 1]]),
        np.array([[0, 1, 2], [0, 2, 3]]),
    )
    rows, columns = np.mgrid[: camera.height, : camera.width]
    rays = camera.unproject(np.stack([columns, rows], axis=-1).astype(float))[..., :2]
    inside = ((rays > low) & (rays < high)).all(axis=-1)
    np.testing.assert_array_equal(coverage([mesh], camera, IDENTITY, 1) > 0, inside)
    # The area by integrating the projected outline (shoelace over a dense polygon).
    t = np.linspace(0, 1, 4000, endpoint=False)[:, None]
    corners = [low, [high[0], low[1]], high, [low[0], high[1]]]
    outline = np.concatenate(
        [a + t * (np.asarray(b) - a) for a, b in zip(corners, np.roll(corners, -1, 0), strict=True)]
    )
    px = camera.project(np.concatenate([outline, np.ones((len(outline), 1))], axis=1))
    x, y = px.T
    area = 0.5 * abs((x * np.roll(y, -1) - y * np.roll(x, -1)).sum())
    result = coverage([mesh], camera, IDENTITY, 5)
    assert result.sum() == pytest.approx(area, rel=2e-3)


@pytest.mark.parametrize("camera", [CAMERA, PLUMB_BOB, FISHEYE])
def test_compiled_equals_readable(camera: Camera) -> None:
    rng = np.random.default_rng(3)
    meshes = [sphere(0.2, 12), sphere(0.05, 8), rectangle(3, 3, 90, 20), sphere(0.4, 9)]
    for _ in range(2):
        Ts_cam_link = at(0, 0, 0.7) @ exp_se3(rng.normal(0, 0.4, (len(meshes), 6)))
        for supersample in (1, 3):
            np.testing.assert_array_equal(
                reference_coverage_compiled(meshes, camera, Ts_cam_link, supersample),
                reference_coverage(meshes, camera, Ts_cam_link, supersample),
            )


def test_even_supersampling_is_refused(coverage: Coverage) -> None:
    with pytest.raises(InputError, match=r"factor is 4.*odd number"):
        coverage([], CAMERA, np.zeros((0, 4, 4)), 4)


def test_nearest_link_and_depth() -> None:
    near, far = rectangle(10, 10, 30, 30, depth=1.0), rectangle(20, 20, 50, 40, depth=2.0)
    links, depth = reference_visible_links([far, near], CAMERA, np.repeat(IDENTITY, 2, axis=0))
    assert links[15, 15] == 1
    assert links[25, 25] == 1
    assert links[35, 40] == 0
    assert links[5, 5] == -1
    assert depth[25, 25] == pytest.approx(1.0)
    assert depth[35, 40] == pytest.approx(2.0)
    assert np.isinf(depth[5, 5])


def test_depth_of_a_sphere() -> None:
    radius, distance = 0.3, 1.2
    links, depth = reference_visible_links([sphere(radius, 200)], CAMERA, at(0, 0, distance))
    rows, columns = np.nonzero(links == 0)
    rays = CAMERA.unproject(np.stack([columns, rows], axis=-1).astype(float))
    # |z ray - centre| = radius, nearer root.
    b, a = distance, (rays**2).sum(axis=-1)
    exact = (b - np.sqrt(np.maximum(b**2 - a * (distance**2 - radius**2), 0))) / a
    inner = a < 1 + 0.9 * (radius / distance) ** 2
    np.testing.assert_allclose(depth[rows, columns][inner], exact[inner], atol=1e-3)


def test_visibility_agrees_with_coverage_at_pixel_centres() -> None:
    meshes = [sphere(0.3, 20), sphere(0.2, 10)]
    Ts_cam_link = np.concatenate([at(0.1, 0, 1.0), at(-0.2, 0.1, 0.6)])
    links, depth = reference_visible_links(meshes, CAMERA, Ts_cam_link)
    covered = reference_coverage(meshes, CAMERA, Ts_cam_link, supersample=1) > 0
    np.testing.assert_array_equal(links >= 0, covered)
    np.testing.assert_array_equal(np.isfinite(depth), covered)
