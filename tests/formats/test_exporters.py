"""Every target round-trips through its consumer to 1e-9 m and 1e-9 rad."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import consumers
import numpy as np
import pytest
import yaml
from format_cases import CAMERA, make_result, poses
from scipy.spatial.transform import Rotation

from easyhecpp.camera import Camera
from easyhecpp.errors import InputError
from easyhecpp.formats.exporters import TARGETS, CameraLink, default_filename, export, render
from easyhecpp.formats.exporters._pose import euler_xyz, number
from easyhecpp.formats.result_file import ResultFile, RobotBlock

# The columns are the consumer's camera axes in the optical frame.
OPTICAL = np.eye(3)
GL = np.array([[1.0, 0, 0], [0, -1.0, 0], [0, 0, -1.0]])
BODY = np.array([[0, -1.0, 0], [0, 0, -1.0], [1.0, 0, 0]])


@dataclass(frozen=True)
class Consumer:
    target: str
    read: Callable[[Path], consumers.Read]
    axes: np.ndarray
    needs: str | None = None

    def __str__(self) -> str:
        return f"{self.target}-{self.read.__name__}"


CONSUMERS = [
    Consumer("ros2", consumers.read_ros2, OPTICAL),
    Consumer("ros2-launch", consumers.read_ros2_launch, OPTICAL),
    Consumer("ros1", consumers.read_ros1, OPTICAL),
    Consumer("easy-handeye2", consumers.read_easy_handeye2, OPTICAL),
    Consumer("easy-handeye", consumers.read_easy_handeye, OPTICAL),
    Consumer("urdf", consumers.read_urdf_with_yourdfpy, OPTICAL),
    Consumer("urdf", consumers.read_urdf_with_pinocchio, OPTICAL, "pinocchio"),
    Consumer("json", consumers.read_json, GL),
    Consumer("json", consumers.read_json_extrinsic, OPTICAL),
    Consumer("npz", consumers.read_npz, OPTICAL),
    Consumer("npy", consumers.read_npy, OPTICAL),
    Consumer("opengl", consumers.read_opengl, GL),
    Consumer("mujoco", consumers.read_mujoco, GL, "mujoco"),
    Consumer("usd", consumers.read_usd, GL, "pxr"),
    *(
        Consumer("isaaclab", consumers.read_isaaclab(convention, order), axes)
        for convention, axes in (("ros", OPTICAL), ("opengl", GL), ("world", BODY))
        for order in ("wxyz", "xyzw")
    ),
    Consumer("sapien", consumers.read_sapien, BODY),
    Consumer("droid", consumers.read_droid, OPTICAL),
]


def options(target: str) -> dict[str, Any]:
    return {"camera_name": "23404442"} if target == "droid" else {}


def assert_same_pose(found: np.ndarray, T: np.ndarray) -> None:
    assert np.linalg.norm(found[:3, 3] - T[:3, 3]) <= 1e-9
    turned = Rotation.from_matrix(found[:3, :3]) * Rotation.from_matrix(T[:3, :3]).inv()
    assert turned.magnitude() <= 1e-9


@pytest.mark.parametrize("consumer", CONSUMERS, ids=str)
def test_round_trip(consumer: Consumer, tmp_path: Path) -> None:
    if consumer.needs is not None:
        pytest.importorskip(consumer.needs, reason=f"{consumer.needs} reads what is checked here")
    for T in poses():
        path, *_ = export(make_result(T), consumer.target, tmp_path, **options(consumer.target))
        parent, child, found = consumer.read(path)
        assert (parent, child) == ("link_base", "camera_color_optical_frame")
        expected = T.copy()
        expected[:3, :3] = T[:3, :3] @ consumer.axes
        assert_same_pose(found, expected)


@pytest.mark.parametrize(
    "consumer", [c for c in CONSUMERS if not TARGETS[c.target].eye_to_hand_only], ids=str
)
def test_round_trip_on_the_arm(consumer: Consumer, tmp_path: Path) -> None:
    if consumer.needs is not None:
        pytest.importorskip(consumer.needs, reason=f"{consumer.needs} reads what is checked here")
    T = poses()[1]
    path, *_ = export(make_result(T, setup="eye-in-hand"), consumer.target, tmp_path)
    parent, child, found = consumer.read(path)
    assert (parent, child) == ("link_eef", "camera_color_optical_frame")
    expected = T.copy()
    expected[:3, :3] = T[:3, :3] @ consumer.axes
    assert_same_pose(found, expected)


def test_every_target_has_a_round_trip() -> None:
    assert {consumer.target for consumer in CONSUMERS} | {"camera-info"} == set(TARGETS)


def test_documentation_lists_every_target_with_its_file() -> None:
    page = (Path(__file__).parents[2] / "docs" / "exporting.md").read_text()
    for name, exporter in TARGETS.items():
        assert f"| `{name}` | `{exporter.suffix}`" in page
    takes_link = page.split("Targets that take a camera link:")[1].split(". The others")[0]
    assert [name for name in TARGETS if f"`{name}`" in takes_link] == [
        name for name, exporter in TARGETS.items() if exporter.takes_link
    ]


AWKWARD = 'cam\'1 "<&>" $HOME é/link'


@pytest.mark.parametrize(
    "consumer",
    [
        c
        for c in CONSUMERS
        # xacro takes a dollar for a substitution; DROID's cameras are called by a number.
        if c.target not in ("urdf", "droid")
    ],
    ids=str,
)
def test_awkward_frame_names_survive(consumer: Consumer, tmp_path: Path) -> None:
    if consumer.needs is not None:
        pytest.importorskip(consumer.needs, reason=f"{consumer.needs} reads what is checked here")
    camera = Camera(640, 480, 500.0, 500.0, 320.0, 240.0, frame=AWKWARD)
    robot = RobotBlock(name="arm", base_link="base 'x'", ee_link="tool")
    result = make_result(camera=camera, robot=robot)
    path, *_ = export(result, consumer.target, tmp_path)
    assert consumer.read(path)[:2] == ("base 'x'", AWKWARD)


class TestStatements:
    """What each file says in words."""

    @pytest.mark.parametrize("target", [t for t in TARGETS if t not in ("npz", "npy")])
    def test_states_frames_axes_and_verdict(self, target: str) -> None:
        text = render(make_result(), target, **options(target))[""].decode()
        for needed in ("link_base", "camera_color_optical_frame", "+Z forward", "verdict: ok"):
            assert needed in text

    @pytest.mark.parametrize("target", list(TARGETS))
    def test_states_both_directions(self, target: str) -> None:
        result = make_result()
        assert result.T_mount_cam is not None
        assert result.T_cam_mount is not None
        files = render(result, target, **options(target))
        if target == "npz":
            return  # both matrices are in it: test_arrays
        text = b"".join(files.values()).decode(errors="ignore")
        for transform in (result.T_mount_cam, result.T_cam_mount):
            if target == "opengl":
                # The camera's y is turned round there.
                assert f"{abs(transform.xyz_m[1])!r}" in text
            else:
                assert all(number(value) in text for value in transform.xyz_m)

    @pytest.mark.parametrize(
        ("target", "order"),
        [
            ("ros2", "xyzw"), ("ros2-launch", "xyzw"), ("ros1", "xyzw"), ("easy-handeye", "xyzw"),
            ("easy-handeye2", "xyzw"), ("mujoco", "wxyz"), ("usd", "wxyz"), ("sapien", "wxyz"),
        ],
    )  # fmt: skip
    def test_states_the_order_of_the_quaternion(self, target: str, order: str) -> None:
        assert f"Quaternions below are {order}" in render(make_result(), target)[""].decode()

    def test_doubtful_result_says_why(self) -> None:
        result = make_result(verdict="doubtful", reasons=["Two views\ndisagree -- retake 0003."])
        assert "verdict: doubtful" in render(result, "ros2")[""].decode()
        assert "#   Two views disagree -- retake 0003." in render(result, "ros2")[""].decode()
        # Two hyphens would end the comment for an XML parser.
        assert "Two views disagree - - retake 0003." in render(result, "urdf")[""].decode()

    @pytest.mark.parametrize("target", ["mujoco", "usd", "sapien", "isaaclab"])
    def test_pinhole_consumers_warn_of_lens_distortion(self, target: str) -> None:
        lens = Camera(640, 480, 500.0, 500.0, 320.0, 240.0, "plumb_bob", (0.1, 0.0, 0.0, 0.0))
        assert "lens distortion" in render(make_result(camera=lens), target)[""].decode()
        assert "lens distortion" not in render(make_result(), target)[""].decode()

    def test_npy_has_its_words_beside_it(self, tmp_path: Path) -> None:
        array, words = export(make_result(), "npy", tmp_path / "pose.npy")
        assert array == tmp_path / "pose.npy"
        assert words == tmp_path / "pose.npy.txt"
        assert "T_base_cam = T_parent_child" in words.read_text()


class TestArrays:
    @pytest.mark.parametrize(("setup", "word"), [("eye-to-hand", "base"), ("eye-in-hand", "ee")])
    def test_names_of_the_matrices_say_their_direction(
        self, setup: str, word: str, tmp_path: Path
    ) -> None:
        T = poses()[2]
        path, *_ = export(make_result(T, setup=setup), "npz", tmp_path)
        data = json.loads(render(make_result(T, setup=setup), "json")[""])
        with np.load(path, allow_pickle=False) as arrays:
            for source in (arrays, data):
                np.testing.assert_array_equal(source[f"T_{word}_cam"], T)
                np.testing.assert_allclose(
                    np.asarray(source[f"T_cam_{word}"]) @ T, np.eye(4), atol=1e-12
                )
                np.testing.assert_array_equal(source["intrinsic_cv"], CAMERA.K)
                assert np.shape(source["extrinsic_cv"]) == (3, 4)
                assert np.shape(source["cam2world_gl"]) == (4, 4)

    def test_projects_like_the_camera(self) -> None:
        data = json.loads(render(make_result(), "json")[""])
        T = poses()[0]
        points_cam = np.array([[0.1, -0.2, 1.5], [-0.3, 0.1, 0.8]])
        points = points_cam @ T[:3, :3].T + T[:3, 3]
        seen = np.hstack([points, np.ones((2, 1))]) @ np.array(data["extrinsic_cv"]).T
        px = seen @ np.array(data["intrinsic_cv"]).T
        np.testing.assert_allclose(px[:, :2] / px[:, 2:], CAMERA.project(points_cam), atol=1e-9)

    def test_same_bytes_each_time(self) -> None:
        assert render(make_result(), "npz") == render(make_result(), "npz")


class TestIntrinsics:
    """Where the consumer would draw a point, against the camera's own projection."""

    points_cam = np.array(
        [[0.0, 0.0, 1.0], [0.3, 0.0, 1.2], [0.0, 0.25, 0.9], [-0.4, 0.2, 1.5], [0.5, -0.3, 2.0]]
    )

    def test_mujoco(self, tmp_path: Path) -> None:
        mujoco = pytest.importorskip(
            "mujoco", minversion="3.6", reason="MuJoCo reads what is checked here"
        )
        path, *_ = export(make_result(), "mujoco", tmp_path)
        model = consumers.mujoco_model(path)
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        scene, view = mujoco.MjvScene(model, 10), mujoco.MjvCamera()
        view.type, view.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, 0
        mujoco.mjv_updateScene(
            model, data, mujoco.MjvOption(), None, view, mujoco.mjtCatBit.mjCAT_ALL, scene
        )
        # The frustum that glFrustum is called with, at the near plane; pixels run from its edges.
        gl = scene.camera[0]
        left, right = (gl.frustum_center + side * gl.frustum_width for side in (-1, 1))
        x, y, z = (self.points_cam @ GL).T
        u = (gl.frustum_near * x / -z - left) / (right - left) * CAMERA.width
        v = (gl.frustum_top - gl.frustum_near * y / -z) / (gl.frustum_top - gl.frustum_bottom)
        drawn = np.stack([u - 0.5, v * CAMERA.height - 0.5], axis=-1)
        np.testing.assert_allclose(drawn, CAMERA.project(self.points_cam), atol=2e-3)
        assert tuple(model.cam_resolution[0]) == (CAMERA.width, CAMERA.height)

    def test_usd(self, tmp_path: Path) -> None:
        pytest.importorskip("pxr", reason="OpenUSD reads what is checked here")
        from pxr import Gf

        path, *_ = export(make_result(), "usd", tmp_path)
        camera, _stage = consumers.usd_camera(path)
        frustum = camera.GetCamera().frustum
        matrix = frustum.ComputeViewMatrix() * frustum.ComputeProjectionMatrix()
        T = poses()[0]
        drawn = []
        for p in self.points_cam @ T[:3, :3].T + T[:3, 3]:
            ndc = matrix.Transform(Gf.Vec3d(*p.tolist()))
            drawn.append(
                [
                    (ndc[0] + 1) / 2 * CAMERA.width - 0.5,
                    (1 - ndc[1]) / 2 * CAMERA.height - 0.5,
                ]
            )
        np.testing.assert_allclose(drawn, CAMERA.project(self.points_cam), atol=2e-3)

    def test_sapien_measures_from_the_edge(self, tmp_path: Path) -> None:
        path, *_ = export(make_result(), "sapien", tmp_path)
        values = consumers.sapien_values(path)
        px = self.points_cam @ np.array(values["INTRINSIC"]).T
        drawn = px[:, :2] / px[:, 2:] - 0.5
        np.testing.assert_allclose(drawn, CAMERA.project(self.points_cam), atol=1e-9)
        assert (values["WIDTH"], values["HEIGHT"]) == (CAMERA.width, CAMERA.height)

    @pytest.mark.parametrize(
        ("model", "coefficients"),
        [
            ("none", ()),
            ("plumb_bob", (0.1, -0.2, 1e-3, 2e-3)),
            ("plumb_bob", (0.1, -0.2, 1e-3, 2e-3, 0.05)),
            ("rational_polynomial", (0.1, -0.2, 1e-3, 2e-3, 0.05, 0.01, 0.02, 0.03)),
            ("equidistant", (0.1, -0.02, 1e-3, 2e-4)),
        ],
    )
    def test_camera_info(self, model: str, coefficients: tuple[float, ...], tmp_path: Path) -> None:
        camera = Camera(640, 480, 500.5, 501.25, 320.125, 239.5, model, coefficients)
        path, *_ = export(make_result(camera=camera), "camera-info", tmp_path)
        data = yaml.safe_load(path.read_text())
        assert (data["image_width"], data["image_height"]) == (640, 480)
        np.testing.assert_array_equal(np.reshape(data["camera_matrix"]["data"], (3, 3)), camera.K)
        K, P = camera.K, np.reshape(data["projection_matrix"]["data"], (3, 4))
        np.testing.assert_array_equal(P, np.hstack([K, np.zeros((3, 1))]))
        given = data["distortion_coefficients"]
        assert given["rows"] * given["cols"] == len(given["data"])
        assert data["distortion_model"] == ("plumb_bob" if model == "none" else model)
        np.testing.assert_array_equal(given["data"][: len(coefficients)], coefficients)
        assert not any(given["data"][len(coefficients) :])

    def test_camera_info_is_read_by_our_own_reader(self, tmp_path: Path) -> None:
        from easyhecpp.capture.camera_info import read_camera_info

        path, *_ = export(make_result(), "camera-info", tmp_path)
        read = read_camera_info(path)
        np.testing.assert_array_equal(read.K, CAMERA.K)
        assert (read.width, read.height) == (CAMERA.width, CAMERA.height)


class TestCameraLink:
    T_link_optical = consumers.from_quat_xyzw([0.0, 0.0149, 0.0002], [-0.5, 0.5, -0.5, 0.5])

    @pytest.mark.parametrize(
        "consumer", [c for c in CONSUMERS if TARGETS[c.target].takes_link], ids=str
    )
    def test_driver_and_calibration_together_give_the_optical_pose(
        self, consumer: Consumer, tmp_path: Path
    ) -> None:
        if consumer.needs is not None:
            pytest.importorskip(
                consumer.needs, reason=f"{consumer.needs} reads what is checked here"
            )
        for T in poses():
            path, *_ = export(
                make_result(T),
                consumer.target,
                tmp_path,
                camera_link=CameraLink(self.T_link_optical),
            )
            parent, child, T_base_link = consumer.read(path)
            assert (parent, child) == ("link_base", "camera_link")
            assert_same_pose(T_base_link @ self.T_link_optical, T)

    @pytest.mark.parametrize("target", [t for t in TARGETS if not TARGETS[t].takes_link])
    def test_refused_where_the_camera_itself_is_placed(self, target: str) -> None:
        with pytest.raises(InputError, match="ros2, ros2-launch, ros1"):
            render(make_result(), target, camera_link=CameraLink(np.eye(4)), **options(target))

    def test_file_says_that_the_link_was_derived(self) -> None:
        text = render(make_result(), "ros2", camera_link=CameraLink(self.T_link_optical))[""]
        assert b"calibrated was camera_color_optical_frame" in text

    @pytest.mark.parametrize(
        "text",
        [
            "[0.0, 0.0149, 0.0002, 0.5, -0.5, 0.5, -0.5]",
            "{xyz: [0.0, 0.0149, 0.0002], quat_wxyz: [0.5, -0.5, 0.5, -0.5]}",
            "{xyz_m: [0.0, 0.0149, 0.0002], quat_wxyz: [0.5, -0.5, 0.5, -0.5]}",
            "{xyz: [0.0, 0.0149, 0.0002], rotation: optical}",
            "[[0, 0, 1, 0], [-1, 0, 0, 0.0149], [0, -1, 0, 0.0002], [0, 0, 0, 1]]",
            '{"matrix": [[0, 0, 1, 0], [-1, 0, 0, 0.0149], [0, -1, 0, 0.0002], [0, 0, 0, 1]]}',
            "translation: {x: 0.0, y: 0.0149, z: 0.0002}\n"
            "rotation: {x: -0.5, y: 0.5, z: -0.5, w: 0.5}",
            "header: {frame_id: camera_link}\nchild_frame_id: camera_color_optical_frame\n"
            "transform:\n  translation: {x: 0.0, y: 0.0149, z: 0.0002}\n"
            "  rotation: {x: -0.5, y: 0.5, z: -0.5, w: 0.5}",
        ],
    )
    def test_every_spelling(self, text: str, tmp_path: Path) -> None:
        path = tmp_path / "link.yaml"
        path.write_text(text)
        link = CameraLink.read(path)
        np.testing.assert_allclose(link.T_link_optical, self.T_link_optical, atol=1e-12)
        assert link.frame == "camera_link"

    @pytest.mark.parametrize(
        ("text", "words"),
        [
            ("[[2, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]", "not a rotation"),
            ("[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1, 0], [0, 0, 0, 1]]", "reflection"),
            ("[0, 0, 0, 0.5, -0.5, 0.5, 0.6]", "is no rotation"),
            ("[0, 0, 0, 1]", "not understood"),
            ("camera_link", "not understood"),
            ("{xyz: [0, 0, 0]}", "rotation: optical"),
            ("{rotation: optical}", "has no translation"),
            ("{translation: {x: 0, y: 0}, rotation: {x: 0, y: 0, z: 0, w: 1}}", "not understood"),
            ("{xyz: [0, 0, .nan], rotation: optical}", "not understood"),
            ("[1, 2", "not YAML or JSON"),
        ],
    )
    def test_nonsense(self, text: str, words: str, tmp_path: Path) -> None:
        path = tmp_path / "link.yaml"
        path.write_text(text)
        with pytest.raises(InputError) as caught:
            CameraLink.read(path)
        assert words in str(caught.value)
        assert "link.yaml" in str(caught.value)

    def test_missing_file(self, tmp_path: Path) -> None:
        with pytest.raises(InputError, match="No such file"):
            CameraLink.read(tmp_path / "link.yaml")

    def test_other_direction_is_noticed_by_the_names(self) -> None:
        link = CameraLink(np.eye(4), "camera_color_optical_frame", "camera_link")
        with pytest.raises(InputError, match="other direction"):
            render(make_result(), "ros2", camera_link=link)

    def test_transform_of_another_camera_is_noticed(self) -> None:
        link = CameraLink(np.eye(4), "camera_link", "camera_depth_optical_frame")
        with pytest.raises(InputError, match="camera_depth_optical_frame"):
            render(make_result(), "ros2", camera_link=link)


class TestRefusals:
    def test_unknown_target_lists_the_targets(self) -> None:
        with pytest.raises(InputError) as caught:
            export(make_result(), "ros3")
        assert all(target in str(caught.value) for target in TARGETS)

    def test_failed_result_is_not_exported_by_accident(self) -> None:
        failed = make_result(verdict="failed", reasons=["The views contradict each other."])
        with pytest.raises(InputError, match="verdict is failed"):
            render(failed, "ros2")
        text = render(failed, "ros2", allow_failed=True)[""].decode()
        assert "verdict: failed" in text
        assert "The views contradict each other." in text

    def test_result_without_a_pose(self) -> None:
        nothing = ResultFile.build(
            setup="eye-to-hand",
            robot=RobotBlock(name="arm", base_link="base"),
            camera=CAMERA,
            verdict="failed",
            T_mount_cam=None,
        )
        with pytest.raises(InputError, match="no pose to export"):
            render(nothing, "ros2", allow_failed=True)

    def test_droid_wants_a_serial_number_and_a_fixed_camera(self) -> None:
        with pytest.raises(InputError, match="serial number"):
            render(make_result(), "droid")
        with pytest.raises(InputError, match="beside the arm only"):
            render(make_result(setup="eye-in-hand"), "droid", camera_name="1")

    @pytest.mark.parametrize("name", ["", "a\nb"])
    def test_camera_name_that_cannot_be_written(self, name: str) -> None:
        with pytest.raises(InputError, match="camera name"):
            render(make_result(), "ros2", camera_name=name)

    def test_camera_link_name_that_cannot_be_written(self) -> None:
        with pytest.raises(InputError, match="camera link's name"):
            CameraLink(np.eye(4), "a\nimport os")

    def test_unwritable_place(self, tmp_path: Path) -> None:
        (tmp_path / "file").write_text("")
        with pytest.raises(InputError, match="Cannot write"):
            export(make_result(), "ros2", tmp_path / "file" / "x.sh")


def test_folder_gets_a_file_of_the_usual_name(tmp_path: Path) -> None:
    (path,) = export(make_result(), "usd", tmp_path)
    assert path == tmp_path / "camera_color_optical_frame.usda"
    names = {default_filename(make_result(), target) for target in TARGETS}
    assert len(names) == len(TARGETS)


def test_easy_handeye2_takes_its_name_from_the_file(tmp_path: Path) -> None:
    (path,) = export(make_result(), "easy-handeye2", tmp_path / "front.calib")
    assert yaml.safe_load(path.read_text())["parameters"]["name"] == "front"


def test_easy_handeye_says_where_its_launch_file_looks(tmp_path: Path) -> None:
    (path,) = export(make_result(), "easy-handeye", tmp_path / "front_eye_on_base.yaml")
    assert "/front_eye_on_base/" in path.read_text()
    assert "~/.ros/easy_handeye/front_eye_on_base.yaml" in path.read_text()


def test_numbers_read_back_to_the_same_double_and_have_no_exponent() -> None:
    rng = np.random.default_rng(3)
    values = rng.normal(size=300) * 10.0 ** rng.integers(-18, 6, size=300)
    for value in (*values.tolist(), 0.0, -0.0, 1e-5, 123456789.0):
        text = number(value)
        assert float(text) == value
        assert "e" not in text
        assert yaml.safe_load(text) == value


def test_angles_are_exact_at_and_near_a_right_angle_of_pitch() -> None:
    rng = np.random.default_rng(5)
    for _ in range(300):
        off = 10.0 ** rng.uniform(-17, 0)
        pitch = rng.choice([-1, 1]) * (np.pi / 2 - off)
        R = Rotation.from_euler("xyz", [rng.uniform(-3, 3), pitch, rng.uniform(-3, 3)])
        back = Rotation.from_euler("xyz", euler_xyz(R.as_matrix()))
        assert (back * R.inv()).magnitude() < 1e-14
