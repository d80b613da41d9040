"""The commands on a small simulated capture with known truth."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
import trimesh
from composites import Look, photograph
from scenes_small import photographed
from simulated_capture import simulated_capture
from small_arm import scene, small_arm, write_urdf

import easyhecpp.session
from easyhecpp import __version__
from easyhecpp.capture import Capture
from easyhecpp.capture.write import RobotSource, write_capture
from easyhecpp.cli import main
from easyhecpp.errors import CalibrationError, MissingExtraError
from easyhecpp.formats.exporters import TARGETS
from easyhecpp.formats.result_blocks import RefinedParameter
from easyhecpp.formats.result_file import ResultFile
from easyhecpp.geometry import pose_error
from easyhecpp.session import Calibration, calibrate, demo
from easyhecpp.session.refinement import as_refined
from easyhecpp.sim.poses import PoseSampler

COMMANDS = (
    "calibrate", "check-capture", "info", "overlay", "segment", "export", "compare", "explore",
    "bench", "demo",
)  # fmt: skip


@dataclass(frozen=True)
class Ran:
    code: int
    out: str
    err: str


def run(*words: object) -> Ran:
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        code = main([str(word) for word in words])
    return Ran(code, out.getvalue(), err.getvalue())


@pytest.fixture(scope="module")
def truth() -> np.ndarray:
    return scene(3).T_base_cam


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A capture on disk."""
    root = tmp_path_factory.mktemp("cli")
    capture = simulated_capture(scene(3), np.random.default_rng(0), name="small")
    urdf = write_urdf(root / "robot")
    return write_capture(root / "small", capture, robot=RobotSource(urdf))


@pytest.fixture(scope="module")
def calibrated(folder: Path) -> tuple[Ran, Path]:
    """What ``easyhecpp calibrate`` says and writes."""
    out = folder.parent / "results"
    return run("calibrate", folder, "--out", out), out


@pytest.fixture(scope="module")
def found(folder: Path) -> Calibration:
    return calibrate(folder)


@pytest.fixture
def stubbed(found: Calibration, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], None]:
    """Lets ``calibrate`` come to any verdict, at once."""

    def come_to(verdict: str) -> None:
        result = found.result.model_copy(update={"verdict": verdict, "reasons": ("Because.",)})
        answer = replace(found, result=result)
        monkeypatch.setattr(easyhecpp.session, "calibrate", lambda *_, **__: answer)

    return come_to


# calibrate


def test_calibrate_finds_and_writes_the_pose(
    calibrated: tuple[Ran, Path], folder: Path, truth: np.ndarray
) -> None:
    ran, out = calibrated
    assert ran.code == 0, ran.err
    result = ResultFile.read(out / "result.json")
    assert result.verdict in ("ok", "doubtful")
    assert result.T_mount_cam is not None
    metres, radians = pose_error(result.T_mount_cam.array, truth)
    assert metres < 0.02
    assert np.degrees(radians) < 1.0
    assert [v.id for v in result.views] == list(Capture.load(folder).view_ids)
    assert result.segmenter == "given"
    assert result.command == f"easyhecpp calibrate {folder} --out {out}"
    for view in result.views:
        assert len(list((out / "overlays").glob(f"{view.id}.*"))) == 1
    assert not list(out.rglob("*.tmp"))


def test_calibrate_summarises_for_people(calibrated: tuple[Ran, Path]) -> None:
    ran, out = calibrated
    for part in ("verdict: ", "pose of ", " in base", "xyz [m]", "quat [wxyz]", "sigma", "4 views"):
        assert part in ran.out
    assert str(out) in ran.out
    # Progress goes to the other stream.
    assert "optimising the pose" in ran.err
    assert "optimising" not in ran.out


def test_calibrate_prints_the_result_file_as_json(
    folder: Path, tmp_path: Path, stubbed: Callable[[str], None]
) -> None:
    stubbed("ok")
    ran = run("calibrate", folder, "--out", tmp_path / "out", "--json", "--quiet")
    assert ran.code == 0
    assert ran.err == ""
    assert json.loads(ran.out) == json.loads((tmp_path / "out" / "result.json").read_text())


def test_results_go_beside_the_user_unless_told_otherwise(
    folder: Path, tmp_path: Path, stubbed: Callable[[str], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    stubbed("ok")
    monkeypatch.chdir(tmp_path)
    assert run("calibrate", folder, "--quiet").code == 0
    assert (tmp_path / "small-calibration" / "result.json").is_file()


@pytest.mark.parametrize(
    ("verdict", "strict", "code"),
    [
        ("ok", False, 0),
        ("ok", True, 0),
        ("doubtful", False, 0),
        ("doubtful", True, 3),
        ("failed", False, 3),
        ("failed", True, 3),
    ],
)
def test_exit_codes(
    verdict: str, strict: bool, code: int, folder: Path, tmp_path: Path,
    stubbed: Callable[[str], None],
) -> None:  # fmt: skip
    stubbed(verdict)
    words = [
        "calibrate",
        folder,
        "--out",
        tmp_path / "out",
        "--quiet",
        *["--strict"][: int(strict)],
    ]
    ran = run(*words)
    assert ran.code == code
    assert f"verdict: {verdict}" in ran.out
    assert "Because." in ran.out
    # Whatever the verdict, what was found can be looked at.
    assert (tmp_path / "out" / "result.json").is_file()


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (CalibrationError("No outline anywhere."), 3),
        (MissingExtraError("torch", "models", "Pretrained segmentation"), 2),
        (KeyboardInterrupt(), 130),
    ],
)
def test_errors_become_exit_codes(
    error: BaseException, code: int, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr(easyhecpp.session, "calibrate", fail)
    ran = run("calibrate", folder, "--out", tmp_path / "out", "--quiet")
    assert ran.code == code
    assert ran.out == ""
    assert ran.err.startswith("easyhecpp: ")
    first, *rest = ran.err.splitlines()
    assert str(error) in first
    if code == 3:  # a report says why, and what to do next
        report = tmp_path / "out" / "report.html"
        assert str(error) in report.read_text()
        assert len(rest) == 1
        assert str(report) in rest[0]
    else:
        assert not rest
        assert not (tmp_path / "out").exists()


def test_a_bug_is_not_hidden(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object, **__: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr(easyhecpp.session, "calibrate", fail)
    with pytest.raises(ZeroDivisionError):  # the interpreter prints it and exits with 1
        main(["calibrate", str(folder), "--out", str(tmp_path / "out"), "--quiet"])


# info, check-capture, overlay


def test_info_on_a_capture(folder: Path) -> None:
    ran = run("info", folder, "--json")
    facts = json.loads(ran.out)
    assert ran.code == 0
    assert facts["capture"]["views"] == ["0000", "0001", "0002", "0003"]
    assert facts["capture"]["with masks"] == 4
    assert facts["camera"]["size"] == "480x360"
    shown = run("info", folder).out
    for part in ("lopsided", "yaw", "0003", "480x360"):
        assert part in shown


def test_info_on_a_robot(folder: Path) -> None:
    urdf = folder / "robot" / "robot.urdf"
    facts = json.loads(run("info", urdf, "--json").out)["robot"]
    text = json.dumps(facts)
    for name in (*small_arm().joint_names, *small_arm().link_names):
        assert name in text
    assert "lopsided" in run("info", urdf).out


def test_info_takes_what_its_errors_advise(tmp_path: Path) -> None:
    far, shape = tmp_path / "far" / "arm", "<geometry><{}/></geometry>"
    far.mkdir(parents=True)
    trimesh.creation.box((1, 1, 1)).export(far / "box.stl")
    seen = shape.format('mesh filename="package://arm/box.stl"')
    solid, touched = shape.format('box size="1 1 1"'), shape.format('sphere radius="1"')
    urdf = tmp_path / "here" / "robot.urdf"
    urdf.parent.mkdir()
    urdf.write_text(
        f'<robot name="r"><link name="a"><visual>{seen}</visual></link><link name="b"><visual>'
        f"{solid}</visual><collision>{touched}</collision>"
        '</link><joint name="j" type="fixed"><parent link="a"/><child link="b"/></joint></robot>'
    )
    plain = run("info", urdf)
    assert plain.code == 2
    for advice in ("package_dirs", "ignore_links", "option of 'easyhecpp info'"):
        assert advice in plain.err

    def links(*options: object) -> list[str]:
        facts = json.loads(run("info", urdf, "--json", *options).out)
        return [link["name"] for link in facts["robot"]["links"]]

    assert links("--package-dirs", far.parent) == ["a", "b"]
    assert links("--ignore-links", "a") == ["b"]
    assert links("--geometry", "collision") == ["b"]


def test_options_for_robots_are_refused_for_captures(folder: Path) -> None:
    ran = run("info", folder, "--geometry", "collision")
    assert ran.code == 2
    assert "--geometry is for a robot description" in ran.err
    assert "capture.yaml" in ran.err


def test_info_on_a_result(calibrated: tuple[Ran, Path]) -> None:
    path = calibrated[1] / "result.json"
    assert json.loads(run("info", path, "--json").out) == json.loads(path.read_text())
    assert "verdict" in run("info", path).out


def test_check_capture(folder: Path) -> None:
    ran = run("check-capture", folder)
    assert ran.code == 0
    assert "error" not in ran.out.replace("0 errors", "")
    findings = json.loads(run("check-capture", folder, "--json").out)
    assert all(finding["severity"] != "error" for finding in findings)


def test_overlay(folder: Path, calibrated: tuple[Ran, Path], tmp_path: Path) -> None:
    ran = run("overlay", folder, calibrated[1] / "result.json", "--out", tmp_path / "drawn")
    assert ran.code == 0
    assert "4 pictures" in ran.out
    pictures = sorted((tmp_path / "drawn").iterdir())
    assert [p.stem for p in pictures] == ["0000", "0001", "0002", "0003"]
    assert cv2.imread(str(pictures[0])).shape == (360, 480, 3)


def test_overlay_through_the_lens_that_was_refined(
    folder: Path, calibrated: tuple[Ran, Path], tmp_path: Path
) -> None:
    facts = json.loads((calibrated[1] / "result.json").read_text())
    facts["camera"].update(distortion_model="plumb_bob", distortion=[0.3, -0.2, 0.0, 0.0, 0.0])
    drawn = []
    for name, refined in (
        ("stated", []),
        ("refined", [{"name": "k1", "correction": 0.3, "sigma": 0.01, "unit": "coefficient"}]),
    ):
        facts["refined"] = refined
        (tmp_path / f"{name}.json").write_text(json.dumps(facts))
        assert run("overlay", folder, tmp_path / f"{name}.json", "--out", tmp_path / name).code == 0
        drawn.append([cv2.imread(str(p)) for p in sorted((tmp_path / name).iterdir())])
    outlines = [np.any(a != b) for a, b in zip(*drawn, strict=True)]
    assert all(outlines)


def test_overlay_and_viewer_take_the_joints_that_were_refined(
    folder: Path, calibrated: tuple[Ran, Path]
) -> None:
    capture = Capture.load(folder)
    result = ResultFile.read(calibrated[1] / "result.json")
    elbow = capture.robot.joint_names[3]
    off = RefinedParameter(name=elbow, correction=-0.01, sigma=0.001, unit="rad or m")
    moved = as_refined(capture, result.model_copy(update={"refined": (off,)}))
    apart = np.array([a.joints - b.joints for a, b in zip(moved.views, capture.views, strict=True)])
    assert apart[:, 3] == pytest.approx(-0.01)
    assert not np.delete(apart, 3, axis=1).any()
    assert as_refined(capture, result.model_copy(update={"refined": ()})) is capture


def test_overlay_of_a_result_without_a_pose(
    folder: Path, calibrated: tuple[Ran, Path], tmp_path: Path
) -> None:
    facts = json.loads((calibrated[1] / "result.json").read_text())
    for key in ("T_mount_cam", "T_cam_mount", "covariance", "sigma"):
        facts[key] = None
    facts["verdict"] = "failed"
    (tmp_path / "failed.json").write_text(json.dumps(facts))
    ran = run("overlay", folder, tmp_path / "failed.json", "--out", tmp_path / "drawn")
    assert ran.code == 2
    assert "failed.json" in ran.err
    assert not (tmp_path / "drawn").exists()


# segment


@pytest.mark.parametrize(("verdict", "code"), [("ok", 0), ("doubtful", 0), ("failed", 3)])
def test_segment_tells_the_verdict_and_writes_masks_and_page_whatever_it_is(
    verdict: str, code: int, folder: Path, tmp_path: Path, stubbed: Callable[[str], None]
) -> None:
    stubbed(verdict)
    ran = run("segment", folder, "--out", tmp_path / "out", "--segmenter", "given", "--quiet")
    assert ran.code == code, ran.err
    assert f"verdict: {verdict}\n  Because." in ran.out
    assert "4 of 4 masks written to " in ran.out
    assert sorted(path.stem for path in (tmp_path / "out" / "masks").iterdir()) == [
        "0000", "0001", "0002", "0003",
    ]  # fmt: skip
    page = tmp_path / "out" / "masks.html"
    assert str(page) in ran.out
    assert "Because." in page.read_text("utf-8")


# export, compare


@pytest.mark.parametrize("target", TARGETS)
def test_export_writes_every_target(
    target: str, calibrated: tuple[Ran, Path], tmp_path: Path
) -> None:
    words = ["export", calibrated[1] / "result.json", target, "--output", tmp_path / "exported"]
    ran = run(*words, "--camera-name", "cam1")
    assert ran.code == 0, ran.err
    written = [Path(line.removeprefix("written: ")) for line in ran.out.splitlines()]
    assert written
    assert all(path.is_file() and path.stat().st_size > 0 for path in written)


def test_export_prints_text_and_names_files_itself(
    calibrated: tuple[Ran, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = calibrated[1] / "result.json"
    ran = run("export", result, "ros2")
    assert "static_transform_publisher" in ran.out
    assert list(tmp_path.iterdir()) == []
    ran = run("export", result, "npz")
    assert ran.code == 0
    (written,) = tmp_path.iterdir()
    pose = ResultFile.read(result).T_mount_cam
    assert pose is not None
    with np.load(written) as arrays:
        square = [arrays[name] for name in arrays if arrays[name].shape == (4, 4)]
        assert any(np.allclose(T, pose.array) for T in square)


def test_export_says_when_a_name_is_needed(calibrated: tuple[Ran, Path]) -> None:
    ran = run("export", calibrated[1] / "result.json", "droid")
    assert ran.code == 2
    assert "needs a camera name" in ran.err


def test_export_lists_its_targets(calibrated: tuple[Ran, Path]) -> None:
    ran = run("export", calibrated[1] / "result.json", "ross2")
    assert ran.code == 2
    assert all(target in ran.err for target in TARGETS)
    with pytest.raises(SystemExit), redirect_stdout(io.StringIO()) as out:
        main(["export", "--help"])
    shown = out.getvalue()
    assert all(target in shown for target in TARGETS)


def test_compare(calibrated: tuple[Ran, Path], tmp_path: Path) -> None:
    result = calibrated[1] / "result.json"
    ran = run("compare", result, result)
    assert ran.code == 0
    assert "mm" in ran.out
    facts = json.loads(run("compare", result, result, "--json").out)
    assert any(isinstance(value, float) and value == 0.0 for value in facts.values())
    other = tmp_path / "other.json"
    other.write_text(result.read_text().replace('"base"', '"torso"'))
    ran = run("compare", result, other)
    assert ran.code == 2
    assert "torso" in ran.err


# demo, help, version


class SmallCell:
    """A cell of a small arm, photographed without a path tracer."""

    def __init__(self) -> None:
        case = photographed(3, n_views=2)
        self.rig, self.camera, self.T_mount_cam = case.rig, case.camera, case.T_mount_cam
        self.robot = self.rig.robot
        self.poses = PoseSampler(self.rig, self.camera, self.T_mount_cam, -1.0, (), 0.7)
        self.photographed: list[np.ndarray] = []

    def capture(self, joints: np.ndarray, *, first_index: int) -> list[SimpleNamespace]:
        assert first_index == len(self.photographed)
        self.photographed.append(joints)
        # The same room each time, then noise of its own.
        rng, views = np.random.default_rng(3), [joints] * (first_index + 1)
        images, _ = photograph(self.rig, self.camera, self.T_mount_cam, views, rng, Look())
        return [SimpleNamespace(image=images[-1])]


def test_demo_chooses_poses_and_shows_the_truth(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cell = SmallCell()
    monkeypatch.setattr(demo.Cell, "random", lambda *_, **__: cell)
    ran = run("demo", "--out", tmp_path / "demo", "--seed", 3)
    assert ran.code == 0
    assert len(cell.photographed) == demo.FIRST_VIEWS + demo.CHOSEN_VIEWS
    assert ran.out.count("next joint pose: ") == demo.CHOSEN_VIEWS
    for part in ("true camera position", "found camera position", "error: ", "mm"):
        assert part in ran.out
    error = float(ran.out.split("\nerror: ")[1].split(" mm")[0])
    assert error < 10.0
    assert (tmp_path / "demo" / "result.json").is_file()
    named = ran.out.split("Look at ")[1].strip().rstrip(".")
    assert Path(named).is_file()


@pytest.mark.parametrize("command", COMMANDS)
def test_help(command: str) -> None:
    with pytest.raises(SystemExit) as stopped, redirect_stdout(io.StringIO()) as out:
        main([command, "--help"])
    assert stopped.value.code == 0
    assert f"easyhecpp {command}" in out.getvalue()


def test_help_lists_every_command_with_a_sentence() -> None:
    with pytest.raises(SystemExit), redirect_stdout(io.StringIO()) as out:
        main(["--help"])
    shown = out.getvalue()
    assert all(command in shown for command in COMMANDS)
    listed = [line for line in shown.splitlines() if any(f" {c} " in line for c in COMMANDS)]
    assert len(listed) >= len(COMMANDS)


@pytest.mark.parametrize("word", ["--version", "-V"])
def test_version(word: str) -> None:
    assert run(word).out == f"easyhecpp {__version__}\n"
