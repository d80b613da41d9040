"""The fast silhouette against the readable reference, finite differences and geometry."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from solids import (
    ARM,
    ARM_POSES,
    CAMERAS,
    F64,
    FISHEYE,
    PINHOLE,
    PLUMB_BOB,
    at,
    ball,
    box,
    random_poses,
    rectangle,
    tube,
)

from easyhecpp.camera import Camera
from easyhecpp.geometry import perturb_about
from easyhecpp.render import SilhouetteRenderer
from easyhecpp.render.reference import reference_visible_links
from easyhecpp.render.reference_compiled import reference_coverage_compiled
from easyhecpp.robot import LinkMesh

IDENTITY = np.eye(4)[None]
CENTRE = np.array([0.02, 0.0, 1.0])

every_camera = pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS.keys())


def errors(
    meshes: list[LinkMesh] | tuple[LinkMesh, ...], camera: Camera, Ts: F64, supersample: int = 9
) -> F64:
    """Fast minus exact coverage on the pixels that the outline runs through."""
    fast = SilhouetteRenderer(meshes, camera).coverage(Ts)
    exact = reference_coverage_compiled(meshes, camera, Ts, supersample)
    boundary = ((exact > 0) & (exact < 1)) | ((fast > 0) & (fast < 1))
    np.testing.assert_allclose(fast[~boundary], exact[~boundary])
    return (fast - exact)[boundary].astype(np.float64)


# Coverage


@every_camera
def test_coverage_of_an_arm(camera: Camera) -> None:
    rng = np.random.default_rng(1)
    poses = [ARM_POSES, *(random_poses(rng, len(ARM)) for _ in range(2))]
    found = [errors(ARM, camera, Ts) for Ts in poses]
    assert np.abs(np.concatenate(found)).mean() <= 0.02
    assert abs(np.concatenate(found).mean()) <= 0.002  # no bias of the area
    assert all(abs(e.sum()) < 0.003 * len(e) + 0.5 for e in found)


def test_half_plane_edges_are_exact_along_x_and_fine_along_y() -> None:
    for shift in np.linspace(0.0, 1.0, 11) + 1e-4:
        upright = [rectangle(-500, -500, 100.0 + shift, 500)]
        coverage = SilhouetteRenderer(upright, PINHOLE).coverage(IDENTITY)
        assert coverage.sum(axis=1) == pytest.approx(100.5 + shift, abs=1e-4)
        lying = [rectangle(-500, -500, 500, 70.0 + shift)]
        coverage = SilhouetteRenderer(lying, PINHOLE).coverage(IDENTITY)
        assert coverage.sum(axis=0) == pytest.approx(70.5 + shift, abs=0.125 + 1e-4)


def test_integer_coordinates_are_pixel_centres() -> None:
    coverage = SilhouetteRenderer([rectangle(9.5, 19.5, 12.5, 20.5)], PINHOLE).coverage(IDENTITY)
    expected = np.zeros_like(coverage)
    expected[20, 10:13] = 1.0
    np.testing.assert_allclose(coverage, expected, atol=1e-6)


def test_union_counts_no_pixel_twice() -> None:
    """Two sheets that share an edge inside a pixel column, and two that overlap."""
    sides = [rectangle(20, 20, 50.3, 60), rectangle(50.3, 20, 80, 60, depth=2.0)]
    coverage = SilhouetteRenderer(sides, PINHOLE).coverage(np.repeat(IDENTITY, 2, axis=0))
    np.testing.assert_allclose(coverage[21:60, 21:80], 1.0, atol=1e-6)
    # Both end at the same place within a pixel: min(1, sum) would make 1.0 of 0.6 twice.
    same = [rectangle(20, 20, 50.1, 60), rectangle(30, 20, 50.1, 60, depth=1.5)]
    coverage = SilhouetteRenderer(same, PINHOLE).coverage(np.repeat(IDENTITY, 2, axis=0))
    np.testing.assert_allclose(coverage[21:60, 50], 0.6, atol=1e-6)
    alone = SilhouetteRenderer(same[:1], PINHOLE).coverage(IDENTITY)
    np.testing.assert_allclose(coverage, alone, atol=1e-6)


def test_a_link_does_not_change_what_it_is_hidden_behind() -> None:
    meshes = [ball(0.2), ball(0.05), box(0.02, 0.02, 0.3)]
    Ts = np.stack([at(0, 0, 1.0), at(0.01, 0.02, 1.0), at(0, 0, 1.2)])
    alone = SilhouetteRenderer(meshes[:1], PINHOLE).coverage(Ts[:1])
    np.testing.assert_allclose(SilhouetteRenderer(meshes, PINHOLE).coverage(Ts), alone, atol=1e-6)


def test_open_meshes_and_either_winding() -> None:
    wall = tube(0.1, 0.3)
    turned = LinkMesh.from_triangles(wall.vertices, wall.faces[:, ::-1])
    half = LinkMesh.from_triangles(wall.vertices, wall.faces[: len(wall.faces) // 3])
    patchy = LinkMesh.from_triangles(
        wall.vertices, np.where(np.arange(len(wall.faces))[:, None] % 3, wall.faces,
                                wall.faces[:, ::-1])
    )  # fmt: skip
    assert wall.n_open_edges > 0
    for turn in ((0.1, 0.2, 0.3), (1.3, 0.2, 0.0), (1.6, 1.0, 0.4)):
        Ts = at(0.03, 0.02, 0.9, turn)[None]
        for mesh in (wall, turned, half, patchy):
            assert np.abs(errors([mesh], PINHOLE, Ts)).mean() <= 0.02
        outside = SilhouetteRenderer([wall], PINHOLE).coverage(Ts)
        inside_out = SilhouetteRenderer([turned], PINHOLE).coverage(Ts)
        np.testing.assert_allclose(outside, inside_out, atol=1e-6)


@every_camera
def test_links_that_reach_behind_the_camera_are_cut(camera: Camera) -> None:
    cases = [
        ([box(0.4, 0.3, 2.0)], at(0.5, 0.1, 0.3)),
        ([box(0.2, 0.2, 2.0)], at(0.15, 0.12, 0.3, (0.3, 0.2, 0.1))),
        ([ball(0.3)], at(0.1, 0.25, 0.2)),
        ([tube(0.2, 1.5)], at(0.05, 0.1, 0.2, (0.1, 0.2, 0.0))),
    ]
    for meshes, T in cases if camera is PINHOLE else cases[1:3]:
        found = errors(meshes, camera, T[None], 3 if camera is FISHEYE else 5)
        assert len(found) > 50
        assert np.abs(found).mean() <= 0.04
    # Part of the arm behind the camera, part in front.
    Ts = ARM_POSES.copy()
    Ts[0, :3, 3] = -0.3, 0.2, -0.5
    Ts[3, :3, 3] = 0.05, -0.1, 0.05
    assert np.abs(errors(ARM, camera, Ts, 5)).mean() <= 0.04


@every_camera
def test_nothing_in_front_of_the_camera(camera: Camera) -> None:
    behind = ARM_POSES.copy()
    behind[:, 2, 3] *= -1.0
    beside = ARM_POSES.copy()
    beside[:, 0, 3] += 30.0
    renderer = SilhouetteRenderer(ARM, camera)
    for Ts in (behind, beside):
        assert renderer.coverage(Ts).sum() == 0.0
        coverage, jacobian = renderer.coverage_with_jacobian(Ts, CENTRE)
        assert coverage.sum() == 0.0
        assert not jacobian.any()
        assert len(renderer.contour(Ts, CENTRE)[0]) == 0
        assert (renderer.visible_links(Ts) == -1).all()
        assert np.isinf(renderer.depth(Ts)).all()
        assert np.isnan(renderer.boxes(Ts)).all()
        assert renderer.link_coverage(Ts).sum() == 0.0


def test_no_meshes_and_empty_meshes() -> None:
    nothing = SilhouetteRenderer([], PINHOLE)
    assert nothing.coverage(np.zeros((0, 4, 4))).sum() == 0.0
    assert nothing.boxes(np.zeros((0, 4, 4))).shape == (0, 4)
    empty = LinkMesh.from_triangles(np.zeros((3, 3)), np.array([[0, 1, 2]]))
    one = SilhouetteRenderer([empty, ARM[2]], PINHOLE).coverage(ARM_POSES[:2])
    other = SilhouetteRenderer([ARM[2]], PINHOLE).coverage(ARM_POSES[1:2])
    np.testing.assert_array_equal(one, other)


def test_camera_inside_a_closed_mesh_sees_it_everywhere() -> None:
    coverage = SilhouetteRenderer([ball(0.5)], PINHOLE).coverage(at(0, 0, 0.1)[None])
    np.testing.assert_allclose(coverage, 1.0, atol=1e-6)


def test_more_contour_than_the_work_space_holds() -> None:
    """The room for segments grows, and a later small picture is right too."""
    many = [ball(0.02, 8)] * 400
    rng = np.random.default_rng(0)
    renderer = SilhouetteRenderer(many, PLUMB_BOB)
    Ts = random_poses(rng, 400, spread=0.2)
    exact = reference_coverage_compiled(many, PLUMB_BOB, Ts, 3)
    assert np.abs(renderer.coverage(Ts) - exact).mean() < 0.01
    Ts[1:, :3, 3] = -1.0
    alone = SilhouetteRenderer(many[:1], PLUMB_BOB).coverage(Ts[:1])
    np.testing.assert_array_equal(renderer.coverage(Ts), alone)


@every_camera
def test_projection_is_the_cameras_own(camera: Camera) -> None:
    """The centroid of a small sheet against `Camera.project`."""
    mesh = box(0.1, 0.1, 0.0002)
    renderer = SilhouetteRenderer([mesh], camera)
    for x, y in ((0.0, 0.0), (0.35, 0.25), (-0.4, 0.2), (0.3, -0.3), (-0.4, -0.3)):
        contour, coverage = renderer.contour(at(x, y, 1.0)[None], np.array([x, y, 1.0]))
        rows, columns = np.mgrid[: camera.height, : camera.width]
        centre = [(coverage * columns).sum(), (coverage * rows).sum()] / coverage.sum()
        np.testing.assert_allclose(centre, camera.project(np.array([x, y, 1.0])), atol=0.15)
        assert np.isfinite(contour.points).all()


# Derivatives


def difference(render, T: F64, centre: F64, steps: F64) -> F64:
    """Central differences of ``render(Ts)`` by `perturb_about`, ``(H, W, 6)``."""
    out = []
    for axis in range(6):
        delta = np.zeros(6)
        delta[axis] = steps[axis]
        plus, minus = (
            render(perturb_about(T, centre, delta)),
            render(perturb_about(T, centre, -delta)),
        )
        out.append((plus - minus).astype(np.float64) / (2.0 * steps[axis]))
    return np.stack(out, axis=-1)


# Turned so that no face is seen edge-on: there the outline has a kink and no derivative.
TURNED = perturb_about(ARM_POSES, CENTRE, np.array([0.0, 0.0, 0.0, 0.3, -0.4, 0.2]))


@every_camera
def test_coverage_jacobian(camera: Camera) -> None:
    """Summed over blocks of pixels, where the sample lines' own steps even out."""
    Ts, centre = TURNED.copy(), CENTRE.copy()
    if camera is FISHEYE:  # for the arm to fill more than a few pixels
        Ts[:, 2, 3] -= 0.5
        centre[2] -= 0.5
    renderer = SilhouetteRenderer(ARM, camera)
    _, jacobian = renderer.coverage_with_jacobian(Ts, centre)
    steps = np.array([4e-3, 4e-3, 8e-3, 16e-3, 16e-3, 16e-3])

    def blocks(image: F64) -> F64:
        return image.reshape(6, camera.height // 6, 8, camera.width // 8, 6).sum(axis=(1, 3))

    def disagreement(numeric: F64) -> F64:
        """Root mean square over the blocks, relative, per component."""
        apart = blocks(jacobian) - blocks(numeric)
        return np.sqrt((apart**2).sum((0, 1)) / (blocks(numeric) ** 2).sum((0, 1)))

    assert (disagreement(difference(renderer.coverage, Ts, centre, steps)) < 0.15).all()
    if camera is PINHOLE:
        exact = difference(
            lambda Ts: reference_coverage_compiled(ARM, camera, Ts, 9), Ts, centre, steps
        )
        assert (disagreement(exact) < 0.1).all()


def test_coverage_jacobian_of_outlines_along_rows_and_columns() -> None:
    """A sheet that is moved across its upright and its lying edges."""
    mesh = [rectangle(20.25, 30.25, 80.25, 60.25)]
    _, jacobian = SilhouetteRenderer(mesh, PINHOLE).coverage_with_jacobian(IDENTITY, CENTRE)
    expected = np.zeros(jacobian.shape[:2])
    expected[31:60, 20], expected[31:60, 80] = -PINHOLE.fx, PINHOLE.fx
    np.testing.assert_allclose(jacobian[31:60, :, 0], expected[31:60], atol=1e-6)
    expected = np.zeros(jacobian.shape[:2])
    expected[30, 21:80], expected[60, 21:80] = -PINHOLE.fy, PINHOLE.fy
    np.testing.assert_allclose(jacobian[:, 21:80, 1], expected[:, 21:80], atol=1e-6)


def test_coverage_jacobian_says_nothing_inside_and_outside() -> None:
    renderer = SilhouetteRenderer(ARM, PINHOLE)
    coverage, jacobian = renderer.coverage_with_jacobian(ARM_POSES, CENTRE)
    flat = (coverage < 1e-6) | (coverage > 1.0 - 1e-6)
    # A pixel that the outline just touches may move though it is full.
    assert np.abs(jacobian[flat]).sum() < 0.06 * np.abs(jacobian).sum()


@every_camera
def test_contour_jacobian(camera: Camera) -> None:
    """The point of the surface under each sample, moved and projected by the camera itself."""
    contour, _ = SilhouetteRenderer(ARM, camera).contour(ARM_POSES, CENTRE, spacing=2.0)
    np.testing.assert_allclose(camera.project(contour.points_cam), contour.points, atol=0.02)
    numeric = []
    for axis in range(6):
        delta = np.zeros(6)
        delta[axis] = 1e-6
        T = perturb_about(np.eye(4), CENTRE, delta), perturb_about(np.eye(4), CENTRE, -delta)
        plus, minus = (camera.project(contour.points_cam @ t[:3, :3].T + t[:3, 3]) for t in T)
        numeric.append(np.einsum("ni,ni->n", contour.normals, (plus - minus) / 2e-6))
    np.testing.assert_allclose(contour.jacobians, np.stack(numeric, axis=-1), rtol=1e-4, atol=0.01)


# Contours


@every_camera
def test_contour_is_the_outer_boundary_with_normals_pointing_out(camera: Camera) -> None:
    contour, _ = SilhouetteRenderer(ARM, camera).contour(ARM_POSES, CENTRE)
    exact = reference_coverage_compiled(ARM, camera, ARM_POSES, 5)
    np.testing.assert_allclose(np.linalg.norm(contour.normals, axis=1), 1.0)

    def look(offset: float) -> F64:
        x, y = np.rint(contour.points + offset * contour.normals).astype(int).T
        return exact[y, x]

    assert len(contour) > 40
    assert np.mean(look(2.0) < 0.5) > 0.97
    assert np.mean(look(-1.5) > 0.5) > 0.97
    # The arm's inner outlines (a ball before a box) give no sample.
    near = reference_coverage_compiled(ARM, camera, ARM_POSES, 1)
    x, y = np.rint(contour.points).astype(int).T
    blocks = np.stack([near[y + dy, x + dx] for dy in (-2, 0, 2) for dx in (-2, 0, 2)])
    assert (blocks.min(axis=0) < 0.5).all()


def test_contour_names_the_link_that_forms_it() -> None:
    contour, _ = SilhouetteRenderer(ARM, PINHOLE).contour(ARM_POSES, CENTRE)
    alone = SilhouetteRenderer(ARM, PINHOLE).link_coverage(ARM_POSES)
    x, y = np.rint(contour.points - 0.8 * contour.normals).astype(int).T
    assert np.mean(alone[contour.links, y, x] > 0.2) > 0.97


@pytest.mark.parametrize("spacing", [0.5, 1.0, 3.0])
def test_length_of_a_balls_outline(spacing: float) -> None:
    radius, distance = 0.25, 1.2
    camera = Camera(200, 150, 200.0, 200.0, 99.5, 74.5)
    contour, _ = SilhouetteRenderer([ball(radius, 80)], camera).contour(
        at(0, 0, distance)[None], np.array([0, 0, distance]), spacing=spacing
    )
    length = 2 * np.pi * 200.0 * radius / np.sqrt(distance**2 - radius**2)
    assert contour.spacing == spacing
    assert len(contour) * spacing == pytest.approx(length, rel=0.01)
    from_middle = contour.points - [99.5, 74.5]
    np.testing.assert_allclose(np.linalg.norm(from_middle, axis=1), length / (2 * np.pi), atol=0.15)
    assert (np.einsum("ni,ni->n", from_middle, contour.normals) > 0).all()
    # A ball that turns about its own middle looks the same, however its edges move.
    moved = contour.jacobians[:, 3:].mean(axis=0)
    assert np.abs(moved).max() < 1.0
    np.testing.assert_allclose(
        contour.jacobians[:, :2], 200.0 / distance * contour.normals, rtol=0.06, atol=2.0
    )


def test_contour_of_a_cut_link_counts_every_part_once() -> None:
    """A ball that touches the camera's plane beside the view: the same outline as a whole one."""
    whole = ball(0.25, 60)
    needle = LinkMesh.from_triangles(
        np.array([[9.0, 9.0, -3.0], [9.0, 9.1, -3.0], [9.0, 9.0, -1.0]]), np.array([[0, 1, 2]])
    )
    joined = LinkMesh.from_triangles(
        np.concatenate([whole.vertices, needle.vertices]),
        np.concatenate([whole.faces, needle.faces + len(whole.vertices)]),
    )
    T = at(0.02, 0.01, 1.1)[None]
    plain, seen = SilhouetteRenderer([whole], PINHOLE).contour(T, CENTRE)
    cut, seen_cut = SilhouetteRenderer([joined], PINHOLE).contour(T, CENTRE)
    np.testing.assert_allclose(seen_cut, seen, atol=1e-6)
    assert abs(len(cut) - len(plain)) <= 3
    radius = np.linalg.norm(cut.points - cut.points.mean(axis=0), axis=1)
    assert np.ptp(radius) < 1.5


def test_contour_keeps_to_the_picture() -> None:
    Ts = at(0.55, 0.4, 1.0)[None]
    contour, coverage = SilhouetteRenderer([ball(0.3)], PINHOLE).contour(Ts, CENTRE)
    assert coverage[-1, -1] == 1.0
    assert len(contour) > 20
    assert (contour.points >= 1.0).all()
    assert (contour.points <= [PINHOLE.width - 2, PINHOLE.height - 2]).all()


# Links, depth, boxes


def test_coverage_of_each_link_alone() -> None:
    alone = SilhouetteRenderer(ARM, PINHOLE).link_coverage(ARM_POSES)
    for i, (mesh, T) in enumerate(zip(ARM, ARM_POSES, strict=True)):
        one = SilhouetteRenderer([mesh], PINHOLE).coverage(T[None])
        np.testing.assert_allclose(alone[i], one, atol=1e-6)


@every_camera
def test_visible_links_depth_and_boxes(camera: Camera) -> None:
    rng = np.random.default_rng(5)
    for Ts in (ARM_POSES, random_poses(rng, len(ARM))):
        renderer = SilhouetteRenderer(ARM, camera)
        links, depth = reference_visible_links(ARM, camera, Ts)
        found, found_depth = renderer.visible_links(Ts), renderer.depth(Ts)
        # Triangles are drawn in short straight pieces: an outline moves by 0.05 px at most, past
        # the centre of hardly a pixel.
        assert (found != links).sum() <= (2 if camera.is_distorted else 0)
        both = (found == links) & (links >= 0)
        np.testing.assert_allclose(found_depth[both], depth[both], rtol=5e-3)
        np.testing.assert_array_equal(np.isfinite(found_depth), found >= 0)
        for link, limits in enumerate(renderer.boxes(Ts)):
            rows, columns = np.nonzero(found == link)
            if len(rows):
                expected = columns.min(), rows.min(), columns.max(), rows.max()
                np.testing.assert_array_equal(limits, expected)
            else:
                assert np.isnan(limits).all()


LONG = box(0.6, 0.25, 0.25)
CLOSE = at(0.02, 0.05, 0.34, (0.2, 0.3, 0.1))
"""A box of few long edges that reaches close to the camera and out of the picture."""
LENSES = {
    "plumb_bob": Camera(
        320, 180, 160.0, 160.0, 159.5, 89.5, "plumb_bob", (-0.25, 0.06, 0.001, -0.001, 0.0)
    ),
    "fisheye": Camera(320, 180, 110.0, 110.0, 159.5, 89.5, "equidistant", (0.0, 0.0, 0.0, 0.0)),
}
close_up = pytest.mark.parametrize("camera", LENSES.values(), ids=LENSES.keys())


@close_up
def test_links_and_boxes_of_large_triangles_agree_with_the_reference(camera: Camera) -> None:
    renderer = SilhouetteRenderer([LONG], camera)
    links, depth = reference_visible_links([LONG], camera, CLOSE[None])
    found, found_depth = renderer.visible_links(CLOSE[None]), renderer.depth(CLOSE[None])
    assert (links >= 0).mean() > 0.2
    wrong = found != links
    assert wrong.sum() <= 0.001 * (links >= 0).sum()
    # What differs lies on the outline: no cracks between the pieces.
    coverage = renderer.coverage(CLOSE[None])
    assert ((coverage[wrong] > 0.05) & (coverage[wrong] < 0.95)).all()
    both = (found >= 0) & (links >= 0)
    np.testing.assert_allclose(found_depth[both], depth[both], rtol=5e-3)
    rows, columns = np.nonzero(coverage > 0.5)
    limits = columns.min(), rows.min(), columns.max(), rows.max()
    np.testing.assert_allclose(renderer.boxes(CLOSE[None])[0], limits, atol=1)


@close_up
@pytest.mark.parametrize("scale", [1, 4, 12])
def test_no_piece_of_an_edge_bends_at_any_resolution(camera: Camera, scale: int) -> None:
    camera = camera.scaled(scale)
    seg = SilhouetteRenderer([LONG], camera)._project(CLOSE[None])
    ends, segments = seg.ends[: seg.count], seg.segments[: seg.count]
    share = np.linspace(0.0, 1.0, 21)[:, None, None]
    pixels = camera.project(ends[:, :3] + share * (ends[:, 3:] - ends[:, :3]))
    size = camera.width, camera.height
    inside = ((pixels > -1) & (pixels < size)).all(axis=-1)
    along = segments[:, 2:] - segments[:, :2]
    length = np.linalg.norm(along, axis=1)
    offset = pixels - segments[:, :2]
    bend = np.abs(along[:, 0] * offset[..., 1] - along[:, 1] * offset[..., 0]) / length
    assert inside.sum() > 1000
    assert bend[inside].max() < 0.015  # at the shortest of focal lengths


def test_a_hidden_link_has_no_box() -> None:
    meshes = [ball(0.2), ball(0.05)]
    boxes = SilhouetteRenderer(meshes, PINHOLE).boxes(np.stack([at(0, 0, 1), at(0, 0, 1)]))
    assert np.isfinite(boxes[0]).all()
    assert np.isnan(boxes[1]).all()


def test_depth_of_a_cut_link() -> None:
    Ts = at(0.5, 0.1, 0.3)[None]
    meshes = [box(0.4, 0.3, 2.0)]
    links, depth = reference_visible_links(meshes, PINHOLE, Ts)
    found = SilhouetteRenderer(meshes, PINHOLE).depth(Ts)
    both = np.isfinite(found) & np.isfinite(depth)
    assert (np.isfinite(found) != np.isfinite(depth)).sum() <= 2
    np.testing.assert_allclose(found[both], depth[both], rtol=1e-4)
    assert (links >= 0).sum() > 1000


# Threads and caches


def test_threads_share_a_renderer() -> None:
    rng = np.random.default_rng(2)
    renderer = SilhouetteRenderer(ARM, PLUMB_BOB)
    poses = [random_poses(rng, len(ARM)) for _ in range(24)]
    one_by_one = [renderer.contour(Ts, CENTRE) for Ts in poses]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda Ts: renderer.contour(Ts, CENTRE), poses))
    for (a, seen_a), (b, seen_b) in zip(one_by_one, together, strict=True):
        np.testing.assert_array_equal(seen_a, seen_b)
        np.testing.assert_array_equal(a.points, b.points)
        np.testing.assert_array_equal(a.jacobians, b.jacobians)


def test_camera_can_be_changed() -> None:
    small = PINHOLE.scaled(0.5)
    changed = SilhouetteRenderer(ARM, PINHOLE).with_camera(small).coverage(ARM_POSES)
    np.testing.assert_array_equal(changed, SilhouetteRenderer(ARM, small).coverage(ARM_POSES))


def test_fisheye_sees_what_stands_beside_the_camera() -> None:
    """65 deg off the axis, where a pinhole's picture would have to be much wider."""
    direction = np.array([np.sin(np.deg2rad(65)), 0.0, np.cos(np.deg2rad(65))])
    coverage = SilhouetteRenderer([ball(0.1)], FISHEYE).coverage(at(*direction)[None])
    rows, columns = np.nonzero(coverage > 0.5)
    expected = FISHEYE.project(direction)
    assert abs(columns.mean() - expected[0]) < 1.0
    assert abs(rows.mean() - expected[1]) < 1.0
