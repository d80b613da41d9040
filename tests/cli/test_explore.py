"""`easyhecpp explore` on a small simulated capture."""

from __future__ import annotations

import csv
import json
import re
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from simulated_capture import simulated_capture
from small_arm import scene, small_arm, write_urdf
from test_commands import Ran, run

from easyhecpp.capture import Capture
from easyhecpp.capture.write import RobotSource, write_capture
from easyhecpp.formats.result_file import ResultFile

NAMES = list(small_arm().joint_names)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("explore")
    capture = simulated_capture(scene(3), np.random.default_rng(0))
    urdf = write_urdf(root / "robot")
    return write_capture(root / "small", capture, robot=RobotSource(urdf))


@pytest.fixture(scope="module")
def result(folder: Path) -> Path:
    out = folder.parent / "calibrated"
    assert run("calibrate", folder, "--out", out, "--no-edges", "--quiet").code == 0
    return out / "result.json"


@pytest.fixture(scope="module")
def asked(folder: Path, result: Path) -> tuple[Ran, Path]:
    out = folder.parent / "next"
    return run("explore", folder, "--result", result, "--count", 2, "--out", out), out


def table(path: Path) -> dict[str, list[float]]:
    rows = list(csv.reader(path.read_text().splitlines()))
    assert rows[0] == ["view", *NAMES]
    return {row[0]: [float(cell) for cell in row[1:]] for row in rows[1:]}


def test_it_names_joints_and_says_what_they_bring(asked: tuple[Ran, Path], result: Path) -> None:
    ran, out = asked
    assert ran.code == 0, ran.err
    sigma = ResultFile.read(result).sigma
    assert sigma is not None
    assert f"the camera is known to {sigma.position_mm:.2f} mm" in ran.out
    rows = table(out / "next_joints.csv")
    assert list(rows) == ["0004", "0005"]
    for name, value in zip(NAMES, rows["0004"], strict=True):
        assert any(
            line.split()[:4] == [name, f"{value:+.5f}", "rad", f"{np.rad2deg(value):+.3f}"]
            for line in ran.out.splitlines()
        )
    assert "this one tells most" in ran.out
    assert "not considered: " in ran.out


def test_it_draws_the_views_to_be(asked: tuple[Ran, Path], result: Path) -> None:
    _, out = asked
    s = scene(3)
    joints = np.array(table(out / "next_joints.csv")["0005"])
    pose = ResultFile.read(result).T_mount_cam
    assert pose is not None
    picture = cv2.imread(str(out / "0005.jpg")).astype(int)
    assert picture.shape == (s.camera.height, s.camera.width, 3)
    bright = picture.max(axis=2) > 70
    middle = s.robot.centre(joints)
    x, y = s.camera.project((np.linalg.inv(pose.array) @ [*middle, 1.0])[:3])
    assert bright.mean() > 0.01
    rows, columns = np.nonzero(bright)
    assert np.hypot(columns.mean() - x, rows.mean() - y) < 60


def test_json_holds_the_same(folder: Path, result: Path, tmp_path: Path) -> None:
    ran = run(
        "explore", folder, "--result", result, "--count", 1, "--json", "--quiet",
        "--target-mm", 1000, "--out", tmp_path / "o",
    )  # fmt: skip
    told = json.loads(ran.out)
    (view,) = told["views"]
    assert list(view["joints"]) == NAMES
    assert view["predicted_position_mm"] < view["position_mm"]
    assert view["stop"] is True
    assert "target was 1000 mm" in view["stop_reason"]
    assert len(told["written"]) == 2
    assert table(tmp_path / "o" / "next_joints.csv")["0004"] == pytest.approx(
        list(view["joints"].values()), abs=1e-6
    )


def test_without_a_result_it_calibrates(folder: Path, tmp_path: Path) -> None:
    ran = run("explore", folder, "--count", 1, "--method", "random", "--out", tmp_path / "o")
    assert ran.code == 0, ran.err
    assert "optimising the pose" in ran.err
    assert "Drawn at random" in ran.out


@pytest.mark.parametrize("left", ["nothing", "views without pictures"])
def test_before_any_view(folder: Path, tmp_path: Path, left: str) -> None:
    empty = tmp_path / "empty"
    shutil.copytree(folder, empty)
    shutil.rmtree(empty / "images")
    shutil.rmtree(empty / "masks")
    if left == "nothing":
        (empty / "joints.csv").unlink()
    else:
        (empty / "images").mkdir()
    ran = run("explore", empty, "--count", 1, "--out", tmp_path / "o")
    assert ran.code == 0, ran.err
    rows = table(tmp_path / "o" / "next_joints.csv")
    assert list(rows) == ["0000" if left == "nothing" else "0004"]
    assert cv2.imread(str(next((tmp_path / "o").glob("*.jpg")))).shape == (720, 960, 3)
    assert "note: " in ran.out
    assert "standard deviation" not in ran.out


def test_degrees_stay_degrees(folder: Path, result: Path, tmp_path: Path) -> None:
    copy = tmp_path / "deg"
    shutil.copytree(folder, copy)
    rows = list(csv.reader((copy / "joints.csv").read_text().splitlines()))
    turned = [[r[0], *(str(np.rad2deg(float(c))) for c in r[1:])] for r in rows[1:]]
    (copy / "joints.csv").write_text("\n".join(",".join(r) for r in [rows[0], *turned]) + "\n")
    settings = (copy / "capture.yaml").read_text() if (copy / "capture.yaml").exists() else ""
    (copy / "capture.yaml").write_text(settings + "joint_units: deg\n")
    for name, where in (("rad", folder), ("deg", copy)):
        ran = run(
            "explore", where, "--result", result, "--count", 1, "--out", tmp_path / name / "o"
        )
        assert ran.code == 0, ran.err
    rad, deg = (table(tmp_path / name / "o" / "next_joints.csv")["0004"] for name in ("rad", "deg"))
    assert np.rad2deg(rad) == pytest.approx(deg, abs=0.2)


def test_the_table_can_be_appended_to_the_captures_own(
    asked: tuple[Ran, Path], folder: Path, tmp_path: Path
) -> None:
    _, out = asked
    whole = tmp_path / "whole"
    shutil.copytree(folder, whole)
    new = (out / "next_joints.csv").read_text().splitlines()[1:]
    with (whole / "joints.csv").open("a") as file:
        file.write("\n".join(new) + "\n")
    for name in ("0004", "0005"):
        shutil.copy(whole / "images" / "0000.png", whole / "images" / f"{name}.png")
    assert Capture.load(whole).view_ids[-2:] == ("0004", "0005")


@pytest.mark.parametrize(
    ("words", "phrase"),
    [
        (["--count", "0"], "0 joint poses were asked for"),
        (["--result", "nowhere.json"], "nowhere.json"),
        (["--floor", "nan"], "The floor is nan"),
        (["--floor", "inf"], "The floor is inf"),
    ],
)
def test_bad_input(folder: Path, tmp_path: Path, words: list[str], phrase: str) -> None:
    ran = run("explore", folder, "--out", tmp_path / "o", *words)
    assert ran.code == 2
    assert phrase in ran.err
    assert not (tmp_path / "o").exists()


def test_an_unknown_method_lists_them(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        run("explore", folder, "--method", "best")
    assert caught.value.code == 2


def test_before_any_view_only_what_is_needed_is_missed_and_a_method_is_not_used(
    folder: Path, tmp_path: Path
) -> None:
    bare = tmp_path / "bare"
    shutil.copytree(folder, bare, ignore=shutil.ignore_patterns("images", "masks", "joints.csv"))
    words = ("explore", bare, "--count", 1, "--method", "random", "--out", tmp_path / "o")
    assert "note: --method random was not used" in run(*words).out
    urdf = next(bare.glob("robot/**/*.urdf"))
    urdf.write_text(re.sub(r'<limit lower="-1.2"[^>]*>', "", urdf.read_text()))
    ran = run(*words)
    assert ran.code == 2
    assert "The revolute joint 'pitch' has no <limit>" in ran.err
    assert "joints.csv" not in ran.err
    assert "images" not in ran.err


def test_a_robot_without_limits(folder: Path, result: Path, tmp_path: Path) -> None:
    broken = tmp_path / "broken"
    shutil.copytree(folder, broken)
    urdf = next(broken.glob("robot/**/*.urdf"))
    urdf.write_text(urdf.read_text().replace('lower="-1.2" upper="1.2"', ""))
    ran = run("explore", broken, "--result", result, "--out", tmp_path / "o")
    assert ran.code == 2
    assert "pitch [0, 0]" in ran.err
    assert not (tmp_path / "o").exists()
