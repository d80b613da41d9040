from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from format_cases import CAMERA, COVARIANCE, make_result, pose, poses
from scipy.spatial.transform import Rotation

from easyhecpp import __version__
from easyhecpp.camera import Camera
from easyhecpp.errors import InputError
from easyhecpp.formats.result_file import ResultFile, RobotBlock, Sigma, Transform, ViewResult


def edited(tmp_path: Path, **changes: Any) -> Path:
    """A result file in which keys, dotted with double underscores, hold other values."""
    data = json.loads(make_result().to_text())
    for dotted, value in changes.items():
        *path, last = dotted.split("__")
        block = data
        for key in path:
            block = block[key]
        block[last] = value
    file = tmp_path / "result.json"
    file.write_text(json.dumps(data))
    return file


def read_error(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        ResultFile.read(path)
    assert path.name in str(caught.value)
    return str(caught.value)


class TestRoundTrip:
    def test_reads_back_what_was_written(self, tmp_path: Path) -> None:
        result = make_result()
        result.write(tmp_path / "result.json")
        assert ResultFile.read(tmp_path / "result.json") == result

    @pytest.mark.parametrize("T", poses())
    def test_keeps_every_bit_of_the_pose(self, T: np.ndarray, tmp_path: Path) -> None:
        make_result(T).write(tmp_path / "result.json")
        stored = ResultFile.read(tmp_path / "result.json").T_mount_cam
        assert stored is not None
        np.testing.assert_array_equal(stored.array, T)

    @pytest.mark.parametrize("T", poses())
    def test_spellings_of_the_pose_agree_with_scipy(self, T: np.ndarray) -> None:
        result = make_result(T)
        assert result.T_mount_cam is not None
        assert result.T_cam_mount is not None
        w, x, y, z = result.T_mount_cam.quat_wxyz
        turned = Rotation.from_quat([x, y, z, w]) * Rotation.from_matrix(T[:3, :3]).inv()
        assert turned.magnitude() < 1e-12
        np.testing.assert_array_equal(result.T_mount_cam.xyz_m, T[:3, 3])
        np.testing.assert_allclose(result.T_cam_mount.array @ T, np.eye(4), atol=1e-12)

    def test_same_result_gives_the_same_bytes(self) -> None:
        assert make_result().to_text() == make_result().to_text()

    def test_keys_come_in_the_order_of_the_format(self) -> None:
        assert list(json.loads(make_result().to_text())) == [
            "schema", "package", "command", "setup", "segmenter", "created", "verdict", "reasons",
            "notes", "T_mount_cam", "T_cam_mount", "covariance", "sigma", "camera", "robot",
            "refined", "views", "masks", "timings_s", "config",
        ]  # fmt: skip

    def test_matrix_is_written_one_row_a_line(self) -> None:
        assert "      [0.0, 0.0, 0.0, 1.0]\n" in make_result().to_text()

    def test_created_is_written_in_utc(self) -> None:
        assert json.loads(make_result().to_text())["created"] == "2026-03-04T05:06:07Z"

    def test_settings_that_json_cannot_hold_become_text(self) -> None:
        assert make_result().config == {"levels": [8, 4, 2, 1], "prior": "inf"}

    def test_failed_result_may_lack_the_pose(self, tmp_path: Path) -> None:
        result = ResultFile.build(
            setup="eye-to-hand",
            robot=RobotBlock(name="arm", base_link="base"),
            camera=CAMERA,
            verdict="failed",
            T_mount_cam=None,
            reasons=["No arm was found in any image."],
        )
        result.write(tmp_path / "result.json")
        assert ResultFile.read(tmp_path / "result.json").T_mount_cam is None

    def test_camera_survives_with_its_lens(self) -> None:
        camera = Camera(640, 480, 500.0, 501.0, 320.0, 240.0, "plumb_bob", (0.1, -0.2, 1e-3, 2e-3))
        assert make_result(camera=camera).camera.to_camera() == camera

    def test_eye_in_hand_hangs_on_the_tool_link(self) -> None:
        result = make_result(setup="eye-in-hand")
        assert result.T_mount_cam is not None
        assert result.T_mount_cam.parent == "link_eef"


class TestSigma:
    def test_matches_a_sample_of_poses(self) -> None:
        T = poses()[3]
        point = np.array([0.4, 0.1, 0.2])
        sigma = Sigma.from_covariance(T, COVARIANCE, tuple(point))
        rng = np.random.default_rng(0)
        steps = rng.multivariate_normal(np.zeros(6), COVARIANCE, size=20000)
        # By scipy, to first order in the step, as the covariance itself is.
        seen = np.linalg.inv(T)[:3] @ np.append(point, 1.0)
        moved = steps[:, :3] + np.cross(steps[:, 3:], seen)
        turned = Rotation.from_rotvec(steps[:, 3:]).magnitude()
        assert sigma.position_mm == pytest.approx(
            1e3 * np.sqrt((steps[:, :3] ** 2).sum(1).mean()), rel=0.02
        )
        assert sigma.rotation_deg == pytest.approx(
            np.degrees(np.sqrt((turned**2).mean())), rel=0.02
        )
        assert sigma.workspace_mm == pytest.approx(
            1e3 * np.sqrt((moved**2).sum(1).mean()), rel=0.02
        )


class TestBadFiles:
    def test_missing(self, tmp_path: Path) -> None:
        assert "does not exist" in read_error(tmp_path / "nothing.json")

    def test_folder(self, tmp_path: Path) -> None:
        assert "Name the result.json inside it" in read_error(tmp_path)

    def test_not_text(self, tmp_path: Path) -> None:
        path = tmp_path / "result.json"
        path.write_bytes(b"\xff\xfe\x00")
        assert "not text" in read_error(path)

    def test_not_json_names_line_and_column(self, tmp_path: Path) -> None:
        path = tmp_path / "result.json"
        path.write_text('{"schema": 1,\n  "setup" }')
        assert "line 2, column 11" in read_error(path)

    def test_nan_is_not_json(self, tmp_path: Path) -> None:
        path = tmp_path / "result.json"
        path.write_text('{"schema": 1, "sigma": NaN}')
        assert "NaN" in read_error(path)

    @pytest.mark.parametrize("text", ["[1, 2]", "{}", '{"k": [1]}'])
    def test_other_json(self, text: str, tmp_path: Path) -> None:
        path = tmp_path / "result.json"
        path.write_text(text)
        assert "not a calibration result" in read_error(path)

    def test_newer_schema_says_who_wrote_it_and_to_upgrade(self, tmp_path: Path) -> None:
        text = read_error(edited(tmp_path, schema=2, package__version="7.1.0", surprise=1))
        assert "schema 2" in text
        assert "easyhecpp 7.1.0" in text
        assert f"easyhecpp {__version__} reads up to schema 1" in text
        assert "pip install --upgrade easyhecpp" in text

    @pytest.mark.parametrize("schema", ["1", 0, True, None])
    def test_schema_that_is_no_number(self, schema: object, tmp_path: Path) -> None:
        assert "schema is" in read_error(edited(tmp_path, schema=schema))

    def test_misspelt_key_is_named(self, tmp_path: Path) -> None:
        assert "sigma.postion_mm: this key is not known" in read_error(
            edited(tmp_path, sigma__postion_mm=1.0)
        )

    def test_missing_key_is_named(self, tmp_path: Path) -> None:
        path = edited(tmp_path)
        data = json.loads(path.read_text())
        del data["camera"]["fx"]
        path.write_text(json.dumps(data))
        assert "camera.fx: Field required" in read_error(path)

    def test_unknown_verdict(self, tmp_path: Path) -> None:
        assert "verdict" in read_error(edited(tmp_path, verdict="good"))

    def test_every_problem_is_listed(self, tmp_path: Path) -> None:
        text = read_error(edited(tmp_path, verdict="good", camera__fx=-1.0))
        assert "verdict" in text
        assert "camera.fx" in text


class TestNonsense:
    """Edits by hand that keep the file well formed."""

    def test_rotation_scaled(self, tmp_path: Path) -> None:
        matrix = poses()[0]
        matrix[:3, :3] *= 1.001
        text = read_error(edited(tmp_path, T_mount_cam__matrix=matrix.tolist()))
        assert "not a rotation" in text

    def test_rotation_mirrored(self, tmp_path: Path) -> None:
        matrix = poses()[0] @ np.diag([1.0, 1.0, -1.0, 1.0])
        text = read_error(edited(tmp_path, T_mount_cam__matrix=matrix.tolist()))
        assert "reflection" in text

    def test_last_row(self, tmp_path: Path) -> None:
        matrix = poses()[0]
        matrix[3, 0] = 0.5
        assert "last row" in read_error(edited(tmp_path, T_mount_cam__matrix=matrix.tolist()))

    def test_matrix_of_wrong_size(self, tmp_path: Path) -> None:
        matrix = poses()[0][:3].tolist()
        assert "T_mount_cam.matrix" in read_error(edited(tmp_path, T_mount_cam__matrix=matrix))

    def test_one_direction_moved(self, tmp_path: Path) -> None:
        moved = poses()[0]
        moved[0, 3] += 1e-3
        block = Transform.from_matrix("link_base", CAMERA.frame, moved).model_dump()
        text = read_error(edited(tmp_path, T_mount_cam=block))
        assert "T_cam_mount is not the inverse of T_mount_cam" in text

    def test_both_directions_the_same(self, tmp_path: Path) -> None:
        block = make_result().T_mount_cam
        assert block is not None
        text = read_error(edited(tmp_path, T_cam_mount=block.model_dump()))
        assert "turned round" in text

    def test_quaternion_of_another_rotation(self, tmp_path: Path) -> None:
        text = read_error(edited(tmp_path, T_mount_cam__quat_wxyz=[1, 0, 0, 0]))
        assert "deg away from the matrix" in text

    def test_quaternion_in_the_other_order(self, tmp_path: Path) -> None:
        result = make_result()
        assert result.T_mount_cam is not None
        w, x, y, z = result.T_mount_cam.quat_wxyz
        text = read_error(edited(tmp_path, T_mount_cam__quat_wxyz=[x, y, z, w]))
        assert "look like xyzw, and wxyz is meant" in text

    def test_quaternion_not_of_unit_length(self, tmp_path: Path) -> None:
        text = read_error(edited(tmp_path, T_mount_cam__quat_wxyz=[1, 1, 0, 0]))
        assert "length is 1.414" in text

    def test_position_apart_from_the_matrix(self, tmp_path: Path) -> None:
        text = read_error(edited(tmp_path, T_mount_cam__xyz_m=[0, 0, 0]))
        assert "xyz_m" in text

    def test_covariance_not_symmetric(self, tmp_path: Path) -> None:
        C = COVARIANCE.copy()
        C[0, 1] *= -1.0
        assert "not symmetric" in read_error(edited(tmp_path, covariance__matrix=C.tolist()))

    def test_covariance_with_a_negative_direction(self, tmp_path: Path) -> None:
        C = COVARIANCE.copy()
        C[0, 1] = C[1, 0] = 5e-7
        text = read_error(edited(tmp_path, covariance__matrix=C.tolist()))
        assert "negative eigenvalue" in text

    def test_covariance_with_a_negative_variance(self, tmp_path: Path) -> None:
        text = read_error(edited(tmp_path, covariance__matrix=(-COVARIANCE).tolist()))
        assert "negative variance" in text

    def test_singular_covariance_is_fine(self) -> None:
        along = np.array([1e-3, 2e-3, 0.0, 0.0, 0.0, 1e-4])
        make_result(covariance=np.outer(along, along))

    def test_sigma_that_does_not_follow(self, tmp_path: Path) -> None:
        text = read_error(edited(tmp_path, sigma__position_mm=0.01))
        assert "sigma.position_mm is 0.01, but the covariance makes it 1.265" in text

    def test_parent_renamed(self, tmp_path: Path) -> None:
        path = edited(tmp_path, T_mount_cam__parent="world", T_cam_mount__child="world")
        assert "robot.base_link is 'link_base'" in read_error(path)

    def test_child_renamed(self, tmp_path: Path) -> None:
        path = edited(tmp_path, T_mount_cam__child="camera_link", T_cam_mount__parent="camera_link")
        text = read_error(path)
        assert "camera.frame is 'camera_color_optical_frame'" in text
        assert "easyhecpp export" in text

    def test_good_verdict_without_a_pose(self, tmp_path: Path) -> None:
        text = read_error(edited(tmp_path, T_mount_cam=None, T_cam_mount=None))
        assert "the verdict is 'ok', but there is no pose" in text

    def test_view_listed_twice(self) -> None:
        views = [ViewResult(id="0001", weight=1.0), ViewResult(id="0001", weight=1.0)]
        with pytest.raises(InputError, match="'0001' is listed twice"):
            make_result(views=views)

    def test_frame_name_with_a_line_break(self) -> None:
        with pytest.raises(InputError, match="cannot be printed"):
            make_result(robot=RobotBlock(name="arm", base_link="base\nimport os"))

    def test_lens_coefficients_that_do_not_fit(self, tmp_path: Path) -> None:
        path = edited(tmp_path, camera__distortion_model="plumb_bob", camera__distortion=[1, 2])
        assert "camera" in read_error(path)

    def test_eye_in_hand_without_a_tool_link(self) -> None:
        with pytest.raises(InputError, match="ee_link"):
            make_result(setup="eye-in-hand", robot=RobotBlock(name="arm", base_link="base"))

    def test_pose_that_is_not_rigid_cannot_be_built(self) -> None:
        with pytest.raises(InputError, match="not a rotation"):
            make_result(2.0 * pose(Rotation.identity(), (0.0, 0.0, 0.0)))


def test_seven_digits_are_enough(tmp_path: Path) -> None:
    """A file retyped with seven digits is not called nonsense."""
    data = json.loads(make_result().to_text())

    def rounded(value: Any) -> Any:
        if isinstance(value, float):
            return float(f"{value:.7g}")
        if isinstance(value, list):
            return [rounded(item) for item in value]
        if isinstance(value, dict):
            return {key: rounded(item) for key, item in value.items()}
        return value

    path = tmp_path / "result.json"
    path.write_text(json.dumps(rounded(data)))
    ResultFile.read(path)


def test_importing_the_package_of_formats_does_not_load_pydantic() -> None:
    code = "import sys, easyhecpp.formats; sys.exit('pydantic' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)
