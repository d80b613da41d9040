from __future__ import annotations

from dataclasses import FrozenInstanceError, replace

import cv2
import numpy as np
import pytest

from easyhecpp.camera import Camera
from easyhecpp.errors import InputError

PLAIN = Camera(1280, 720, 908.3, 907.1, 642.96, 372.73)

# Shaped like calibrations of real lenses: webcam, RealSense colour, wide Kinect, fisheye.
LENSES = {
    "plumb_bob-4": ("plumb_bob", (-0.28, 0.09, 0.0012, -0.0007)),
    "plumb_bob-5": ("plumb_bob", (0.16, -0.51, -0.0004, 0.0009, 0.45)),
    "rational": (
        "rational_polynomial",
        (0.68, -2.71, 0.0009, -0.0003, 1.55, 0.55, -2.52, 1.47),
    ),
    "equidistant": ("equidistant", (-0.013, 0.021, -0.017, 0.004)),
}

# A fit that turns back inside what the arm can reach: at radius 0.94, where it maps to 0.62.
FOLDING = replace(PLAIN, distortion_model="plumb_bob", distortion=(-0.38, 0.0, 0.001, -0.002))
FOLDING_FISHEYE = replace(PLAIN, distortion_model="equidistant", distortion=(-0.1, -0.05, 0.0, 0.0))


@pytest.fixture(params=LENSES, ids=str)
def lens(request) -> Camera:
    model, distortion = LENSES[request.param]
    return replace(PLAIN, distortion_model=model, distortion=distortion)


def points_in_view(n: int = 200) -> np.ndarray:
    rng = np.random.default_rng(0)
    p = np.stack([rng.uniform(-0.75, 0.75, n), rng.uniform(-0.45, 0.45, n), np.ones(n)], axis=-1)
    return p * rng.uniform(0.3, 3.0, (n, 1))


def test_projection_agrees_with_opencv(lens):
    points, still = points_in_view(), np.zeros(3)
    project = cv2.fisheye.projectPoints if "equi" in lens.distortion_model else cv2.projectPoints
    expected, _ = project(points[:, None], still, still, lens.K, np.array(lens.distortion))
    np.testing.assert_allclose(lens.project(points), expected[:, 0], atol=1e-9)


def test_projection_without_distortion_is_the_pinhole():
    points = points_in_view()
    homogeneous = points @ PLAIN.K.T
    np.testing.assert_allclose(PLAIN.project(points), homogeneous[:, :2] / homogeneous[:, 2:])


def test_an_integer_pixel_coordinate_is_the_pixels_centre():
    # A point on the optical axis of a camera that is centred on its 3 x 3 picture falls on the
    # middle pixel (1, 1), not on its corner (1.5, 1.5).
    camera = Camera(3, 3, 2.0, 2.0, 1.0, 1.0)
    np.testing.assert_array_equal(camera.project([0.0, 0.0, 1.0]), (1.0, 1.0))
    picture = np.zeros((3, 3), np.uint8)
    x, y = camera.project([0.0, 0.0, 1.0]).astype(int)
    picture[y, x] = 1
    np.testing.assert_array_equal(picture, np.flip(picture))


@pytest.mark.parametrize("factor", [0.125, 0.25, 1.0 / 3.0, 0.5, 2.0])
def test_scaled_keeps_the_image_edges_in_place(factor):
    camera = replace(PLAIN, width=1296, height=720)
    small = camera.scaled(factor)
    assert (small.width, small.height) == (round(1296 * factor), round(720 * factor))
    points = points_in_view()
    # Measured from the edge of the picture, every coordinate shrinks by the same factor.
    np.testing.assert_allclose(small.project(points) + 0.5, (camera.project(points) + 0.5) * factor)


def test_scaled_matches_averaging_blocks_of_pixels():
    block = 4
    rows, columns = np.mgrid[0:720, 0:1280].astype(float)
    mean_x = columns.reshape(180, block, 320, block).mean(axis=(1, 3))
    ray = PLAIN.unproject([mean_x[7, 11], rows[28:32].mean()])
    np.testing.assert_allclose(PLAIN.scaled(1 / block).project(ray), (11.0, 7.0))


def test_scaled_keeps_lens_and_frame(lens):
    small = replace(lens, frame="left").scaled(0.5)
    assert small.distortion == lens.distortion
    assert small.distortion_model == lens.distortion_model
    assert small.frame == "left"


@pytest.mark.parametrize("camera", [PLAIN, FOLDING, FOLDING_FISHEYE], ids=["plain", "fold", "fish"])
def test_projection_jacobian_matches_finite_differences(camera):
    rng = np.random.default_rng(1)
    # Far outside of the view too, where the distortion is continued.
    points = np.concatenate([points_in_view(50), rng.uniform((-3, -3, 0.5), (3, 3, 2), (50, 3))])
    check_jacobian(camera, points)


def test_distorted_projection_jacobian_matches_finite_differences(lens):
    check_jacobian(lens, np.concatenate([points_in_view(50), [[0.0, 0.0, 1.3]]]))


def test_jacobian_by_k_matches_finite_differences(lens):
    px = lens.project(points_in_view(50))
    rays, step = lens.unproject(px), 1e-6
    for index in range(2):
        ahead, behind = list(lens.distortion), list(lens.distortion)
        ahead[index] += step
        behind[index] -= step
        moved = [replace(lens, distortion=tuple(k)).project(rays) for k in (ahead, behind)]
        numeric = (moved[0] - moved[1]) / (2.0 * step)
        np.testing.assert_allclose(
            lens.jacobian_by_k(px)[..., index], numeric, rtol=1e-5, atol=1e-4
        )


def check_jacobian(camera: Camera, points: np.ndarray) -> None:
    px, J = camera.project_with_jacobian(points)
    np.testing.assert_array_equal(px, camera.project(points))
    step = 1e-6
    for axis in range(3):
        d = np.zeros(3)
        d[axis] = step
        numeric = (camera.project(points + d) - camera.project(points - d)) / (2.0 * step)
        np.testing.assert_allclose(J[..., axis], numeric, rtol=1e-5, atol=2e-4)


def test_unproject_inverts_project_over_the_whole_picture(lens):
    px = np.stack(np.meshgrid(np.linspace(-0.5, 1279.5, 65), np.linspace(-0.5, 719.5, 37)), -1)
    rays = lens.unproject(px)
    np.testing.assert_array_equal(rays[..., 2], 1.0)
    np.testing.assert_allclose(lens.project(rays), px, atol=1e-9)
    points = points_in_view()
    np.testing.assert_allclose(
        lens.unproject(lens.project(points)) * points[:, 2:], points, rtol=1e-9, atol=1e-9
    )


@pytest.mark.parametrize("camera", [FOLDING, FOLDING_FISHEYE], ids=["polynomial", "fisheye"])
def test_unproject_inverts_project_beyond_the_valid_radius(camera):
    bearing = np.linspace(0.0, 6.0, 13)
    for radius in np.array([0.5, 0.99, 1.01, 2.0, 5.0]) * camera.valid_radius:
        points = np.stack([radius * np.cos(bearing), radius * np.sin(bearing), np.ones(13)], -1)
        np.testing.assert_allclose(
            camera.unproject(camera.project(points)), points, rtol=1e-9, atol=1e-9
        )


def test_pixels_outside_a_fisheyes_circle_have_no_ray():
    fisheye = Camera(1000, 1000, 250.0, 250.0, 499.5, 499.5, "equidistant", (0.0,) * 4)
    # Ninety degrees off axis lie at 250 pixels times pi / 2 = 393 from the middle.
    inside, outside = fisheye.unproject([[499.5 + 390.0, 499.5], [0.0, 0.0]])
    np.testing.assert_allclose(inside, (np.tan(390.0 / 250.0), 0.0, 1.0), rtol=1e-9)
    assert np.all(np.isnan(outside))


def test_points_not_in_front_of_the_camera_have_no_pixel(lens):
    for camera in (PLAIN, lens):
        points = np.array([[0.1, 0.1, 0.0], [0.1, 0.1, -1.0], [0.1, 0.1, 1.0]])
        px, J = camera.project_with_jacobian(points)
        np.testing.assert_array_equal(np.isnan(px).all(axis=-1), [True, True, False])
        np.testing.assert_array_equal(np.isnan(J).any(axis=(-2, -1)), [True, True, False])


@pytest.mark.parametrize("camera", [FOLDING, FOLDING_FISHEYE], ids=["polynomial", "fisheye"])
def test_points_far_outside_the_view_never_fold_back(camera):
    radius = np.linspace(0.01, 60.0, 6000)
    for bearing in np.linspace(0.0, 6.0, 13):
        direction = np.array([np.cos(bearing), np.sin(bearing)])
        points = np.concatenate([radius[:, None] * direction, np.ones((6000, 1))], axis=-1)
        outward = (camera.project(points) - (camera.cx, camera.cy)) @ direction
        assert np.all(np.diff(outward) > 0.0)


def test_the_continuation_starts_where_opencvs_polynomial_is_about_to_turn():
    still = np.zeros(3)

    def opencv(radius: float) -> float:
        px, _ = cv2.projectPoints(
            np.array([[[radius, 0.0, 1.0]]]), still, still, np.eye(3), np.array(FOLDING.distortion)
        )
        return px[0, 0, 0]

    limit = FOLDING.valid_radius
    assert 0.7 < limit < 0.94
    ours = (FOLDING.project([limit, 0.0, 1.0])[0] - FOLDING.cx) / FOLDING.fx
    assert ours == pytest.approx(opencv(limit), abs=1e-12)
    slope = (opencv(limit + 1e-5) - opencv(limit - 1e-5)) / 2e-5
    beyond = (FOLDING.project([3.0 * limit, 0.0, 1.0])[0] - FOLDING.cx) / FOLDING.fx
    assert beyond == pytest.approx(opencv(limit) + slope * 2.0 * limit, abs=1e-6)
    assert opencv(3.0 * limit) < 0.0  # what OpenCV makes of that point: inside, on the other side


def test_a_rational_model_is_continued_before_its_pole():
    # The denominator 1 - 0.5 r^2 vanishes at r = 1.414.
    camera = replace(
        PLAIN,
        distortion_model="rational_polynomial",
        distortion=(0.0, 0.0, 0.0, 0.0, 0.0, -0.5, 0.0, 0.0),
    )
    assert camera.valid_radius == pytest.approx(0.99 * np.sqrt(2.0))
    radius = np.linspace(0.0, 10.0, 2001)
    points = np.stack([radius, np.zeros(2001), np.ones(2001)], axis=-1)
    assert np.all(np.diff(camera.project(points)[:, 0]) > 0.0)


def test_without_a_turning_point_every_radius_is_valid():
    assert PLAIN.valid_radius == np.inf
    growing = replace(PLAIN, distortion_model="plumb_bob", distortion=(0.1, 0.1, 0.0, 0.0))
    assert growing.valid_radius == np.inf
    fisheye = replace(PLAIN, distortion_model="equidistant", distortion=(0.0,) * 4)
    assert fisheye.valid_radius == np.inf


def test_is_distorted_asks_the_numbers_not_the_name():
    assert not PLAIN.is_distorted
    assert not replace(PLAIN, distortion_model="plumb_bob", distortion=(0.0,) * 5).is_distorted
    assert replace(PLAIN, distortion_model="plumb_bob", distortion=(0, 0, 0, 0, 1e-9)).is_distorted
    assert replace(PLAIN, distortion_model="equidistant", distortion=(0.0,) * 4).is_distorted


def test_numba_params_spell_out_the_camera(lens):
    focal, code, coefficients, radius = lens.numba_params()
    np.testing.assert_array_equal(focal, (lens.fx, lens.fy, lens.cx, lens.cy))
    assert code == (2 if lens.distortion_model == "equidistant" else 1)
    n = len(lens.distortion)
    np.testing.assert_array_equal(coefficients, (*lens.distortion, *[0.0] * (8 - n)))
    assert coefficients.dtype == np.float64
    assert radius == lens.valid_radius


def test_numba_params_call_a_lens_of_zeros_a_pinhole():
    camera = replace(PLAIN, distortion_model="plumb_bob", distortion=(0.0,) * 5)
    _, code, coefficients, radius = camera.numba_params()
    assert (code, radius) == (0, np.inf)
    np.testing.assert_array_equal(coefficients, np.zeros(8))


def test_numbers_of_any_kind_become_plain_ones_and_the_camera_is_frozen():
    camera = Camera(
        np.int64(640), np.int32(480), np.float32(500), 500, 320, 240, "plumb_bob", [0, 0, 0, 1e-3]
    )
    assert camera == Camera(
        640, 480, 500.0, 500.0, 320.0, 240.0, "plumb_bob", (0.0, 0.0, 0.0, 1e-3)
    )
    assert {type(camera.width), type(camera.height)} == {int}
    assert {type(camera.fx), type(camera.cx), type(camera.distortion[0])} == {float}
    with pytest.raises(FrozenInstanceError):
        camera.fx = 1.0


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"width": 0}, "The camera's width is 0. Expected: a whole number of pixels above 0."),
        ({"height": 720.5}, "The camera's height is 720.5."),
        ({"fx": -908.0}, "The camera's fx is -908.0. Expected: a focal length in pixels above 0."),
        ({"fy": 0}, "The camera's fy is 0.0."),
        ({"cx": float("nan")}, "The camera's cx is nan. Expected: a finite number."),
        ({"cy": "middle"}, "The camera's cy is 'middle'."),
        (
            {"distortion_model": "brown"},
            "Unknown distortion model 'brown'. "
            "Expected: one of none, plumb_bob, rational_polynomial, equidistant.",
        ),
        (
            {"distortion_model": "plumb_bob", "distortion": (0.1, 0.2, 0.3)},
            "The distortion model 'plumb_bob' was given 3 coefficients. Expected: 4 or 5.",
        ),
        ({"distortion": (0.1,)}, "The distortion model 'none' was given 1 coefficients."),
        (
            {"distortion_model": "equidistant", "distortion": (0.1, 0.2, float("inf"), 0.0)},
            "The camera's distortion coefficient is inf.",
        ),
        ({"distortion": None}, "The camera's distortion is None. Expected: a list of numbers."),
    ],
)
def test_bad_values_are_named(change, words):
    with pytest.raises(InputError) as caught:
        replace(PLAIN, **change)
    assert str(caught.value).startswith(words)


@pytest.mark.parametrize("factor", [0.0, -1.0, float("nan")])
def test_a_camera_cannot_be_scaled_to_nothing(factor):
    with pytest.raises(InputError, match="Cannot scale a camera by"):
        PLAIN.scaled(factor)
