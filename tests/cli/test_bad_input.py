"""Bad input as the user meets it: exit code 2, one clear error, nothing left behind."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from capture_folder import HEIGHT, WIDTH, CaptureFolder
from test_capture_bad_input import CASES

from easyhecpp.cli import main
from easyhecpp.segment.protocols import CaptureMasks, ViewMask
from easyhecpp.session import calibration as calibration_module
from easyhecpp.session.masks import ChosenSource

Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def folder(tmp_path: Path) -> CaptureFolder:
    return CaptureFolder(tmp_path / "demo")


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    """Run a command in an empty folder; returns exit code, standard output and error."""
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")

    def call(*words: object) -> tuple[int, str, str]:
        code = main([str(word) for word in words])
        out, err = capsys.readouterr()
        return code, out, err

    return call


def assert_one_error(code: int, out: str, err: str, *phrases: str) -> None:
    assert code == 2
    assert out == ""
    assert err.count("easyhecpp: ") == 1
    assert "Traceback" not in err
    for phrase in phrases:
        assert phrase in err
    assert list(Path().iterdir()) == []  # no folder for results


@pytest.mark.parametrize("case", CASES)
def test_calibrate_refuses_a_broken_capture(case: str, folder: CaptureFolder, run: Run) -> None:
    break_it, phrases = CASES[case]
    break_it(folder)
    assert_one_error(*run("calibrate", folder.root, "--quiet"), *phrases)


def test_every_command_that_reads_a_capture_refuses_it(
    folder: CaptureFolder, run: Run, tmp_path: Path
) -> None:
    (folder.root / "joints.csv").unlink()
    result = tmp_path / "result.json"
    result.write_text("{}")
    for words in (["info"], ["segment"], ["calibrate", "--json"], ["bench", "prompts"]):
        assert_one_error(*run(*words, folder.root), "no table of joint positions")
    code, out, err = run("check-capture", folder.root)
    assert code == 2  # a list of findings is what was asked for
    assert "error: " in out
    assert "no table of joint positions" in out
    assert err == ""


@pytest.mark.parametrize("command", ["calibrate", "info", "segment"])
def test_no_such_folder(command: str, run: Run) -> None:
    assert_one_error(*run(command, "nowhere"), "nowhere")


# The robot

ROBOTS = {
    "not XML": ("this is no robot", ["robot.urdf"]),
    "another XML": ("<html><body/></html>", ["robot.urdf", "robot"]),
    "a loop": (
        """<robot name="r"><link name="a"><visual><geometry><box size="1 1 1"/></geometry></visual>
        </link><link name="b"/>
        <joint name="j" type="fixed"><parent link="a"/><child link="b"/></joint>
        <joint name="k" type="fixed"><parent link="b"/><child link="a"/></joint></robot>""",
        ["robot.urdf", "a"],
    ),
    "entity expansion": (
        """<?xml version="1.0"?><!DOCTYPE r [<!ENTITY x "y">]><robot name="&x;"/>""",
        ["entit"],
    ),
    "missing meshes": (
        """<robot name="r"><link name="a">
        <visual><geometry><mesh filename="one.stl"/></geometry></visual>
        <visual><geometry><mesh filename="package://things/two.stl"/></geometry></visual>
        </link></robot>""",
        ["one.stl", "two.stl"],
    ),
    "no geometry": ("""<robot name="r"><link name="a"/></robot>""", ["geometry"]),
}


@pytest.mark.parametrize("case", ROBOTS)
def test_a_broken_robot(case: str, folder: CaptureFolder, run: Run) -> None:
    text, phrases = ROBOTS[case]
    urdf = folder.root / "robot" / "robot.urdf"
    urdf.write_text(text)
    for words in (["calibrate", folder.root, "--quiet"], ["info", urdf]):
        assert_one_error(*run(*words), *phrases)


def test_no_robot(folder: CaptureFolder, run: Run) -> None:
    shutil.rmtree(folder.root / "robot")
    assert_one_error(*run("calibrate", folder.root, "--quiet"), "robot.urdf")
    assert_one_error(*run("info", folder.root / "robot" / "robot.urdf"), "robot.urdf")


def test_an_empty_mesh(folder: CaptureFolder, run: Run) -> None:
    (folder.root / "robot" / "flat.obj").write_text("v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n")
    (folder.root / "robot" / "robot.urdf").write_text(
        '<robot name="r"><link name="a"><visual><geometry><mesh filename="flat.obj"/></geometry>'
        "</visual></link></robot>"
    )
    assert_one_error(
        *run("info", folder.root / "robot" / "robot.urdf"), "mesh is empty", "link 'a'"
    )


# Where the results go


def test_the_output_is_a_file(folder: CaptureFolder, run: Run, tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("")
    for out in (blocked, blocked / "deeper"):
        assert_one_error(
            *run("calibrate", folder.root, "--quiet", "--out", out),
            "output folder cannot be written", str(out), "--out",
        )  # fmt: skip


def test_no_folder_is_left_when_the_work_fails(
    folder: CaptureFolder, run: Run, tmp_path: Path
) -> None:
    shutil.rmtree(folder.root / "masks")
    out = tmp_path / "results" / "deep"
    assert_one_error(
        *run("calibrate", folder.root, "--segmenter", "given", "--quiet", "--out", out),
        "holds no masks", "classical",
    )  # fmt: skip
    assert not out.parent.exists()
    kept = tmp_path / "mine"
    kept.mkdir()
    assert_one_error(
        *run("calibrate", folder.root, "--segmenter", "given", "--quiet", "--out", kept),
        "holds no masks",
    )
    assert kept.is_dir()  # it was there before


def contents(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def test_damaged_pictures_are_named_before_anything_is_written(
    folder: CaptureFolder, run: Run, tmp_path: Path
) -> None:
    for view in ("0001", "0002"):
        folder.damage(f"images/{view}.png")
    earlier = tmp_path / "earlier"
    (earlier / "overlays").mkdir(parents=True)
    for name in ("result.json", "report.html", "overlays/0000.jpg"):
        (earlier / name).write_text("of an earlier run")
    before = contents(earlier)
    for options in (["--no-edges"], [], ["--segmenter", "classical"]):
        assert_one_error(
            *run("calibrate", folder.root, "--quiet", *options, "--out", earlier),
            "2 problems", "truncated or damaged", "0001.png", "0002.png", "record it again",
        )  # fmt: skip
        assert contents(earlier) == before


def test_no_masks(folder: CaptureFolder, run: Run) -> None:
    """Empty masks deleted, as the text for them says: of all views."""
    for path in (folder.root / "masks").iterdir():
        path.unlink()
    assert_one_error(*run("calibrate", folder.root, "--segmenter", "given", "--quiet"), "masks")


def test_empty_masks(folder: CaptureFolder, run: Run) -> None:
    for view in folder.views:
        folder.image(f"{view}.png", np.zeros((HEIGHT, WIDTH), np.uint8), folder="masks")
    for segmenter in ("given", "auto"):
        assert_one_error(
            *run("calibrate", folder.root, "--segmenter", segmenter, "--quiet"),
            "3 problems", "The mask of view '0000' is empty", "view '0002' is empty",
            "white where the arm is", "Delete the file",
        )  # fmt: skip


@pytest.mark.parametrize("mask", [np.zeros((HEIGHT, WIDTH), bool), None], ids=["empty", "none"])
@pytest.mark.parametrize("grid", ["sphere", "paper"])
def test_a_segmenter_that_finds_the_arm_nowhere(
    mask: np.ndarray | None, grid: str, folder: CaptureFolder, run: Run,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    """The arm stands outside of all pictures."""
    masks = CaptureMasks(tuple(ViewMask(view, mask) for view in folder.views))
    source = SimpleNamespace(name="sam3", masks=lambda capture, belief: masks)
    chosen = ChosenSource(source, "sam3", "asked for", refines=True)
    monkeypatch.setattr(calibration_module, "choose_source", lambda *_, **__: chosen)
    assert_one_error(
        *run("calibrate", folder.root, "--quiet", "--first-pose", grid),
        "arm cannot be seen in any view", "at least some pixels of the arm", "check the masks",
    )  # fmt: skip


def test_unknown_segmenter(folder: CaptureFolder, run: Run) -> None:
    assert_one_error(
        *run("calibrate", folder.root, "--quiet", "--segmenter", "clasical"),
        "clasical", "classical",
    )  # fmt: skip


@pytest.mark.parametrize(
    ("words", "phrase"),
    [
        (["--device", "tpu"], "unknown device 'tpu'"),
        (["--box-weights", "nowhere"], "The weights 'nowhere' of --box-weights are not on this"),
        (["--text-weights", "./nowhere"], "The weights './nowhere' of --text-weights are not on"),
        (["--text", ""], "The text that names the arm is empty"),
    ],
    ids=lambda value: value[0] if isinstance(value, list) else "",
)
@pytest.mark.parametrize("segmenter", ["auto", "given", "classical"])
def test_settings_of_models_that_cannot_be_used(
    folder: CaptureFolder, run: Run, segmenter: str, words: list[str], phrase: str
) -> None:
    assert_one_error(
        *run("calibrate", folder.root, "--quiet", "--segmenter", segmenter, *words), phrase
    )
    if segmenter == "auto":
        assert_one_error(*run("segment", folder.root, "--quiet", *words), phrase)


def test_all_weights_that_are_missing_are_named_at_once(
    folder: CaptureFolder, run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    constants = pytest.importorskip("huggingface_hub.constants", reason="needs the extra 'models'")
    pytest.importorskip("torch", reason="needs the extra 'models'")
    monkeypatch.setattr(constants, "HF_HUB_CACHE", str(tmp_path / "hub"))
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    assert_one_error(
        *run("calibrate", folder.root, "--quiet", "--segmenter", "grounded-sam"),
        "hf download IDEA-Research/grounding-dino-base",
        "hf download facebook/sam-vit-huge",
        "--text-weights and --box-weights",
    )


def test_a_table_of_prompts_needs_a_pretrained_segmenter(folder: CaptureFolder, run: Run) -> None:
    code, out, err = run("bench", "prompts", folder.root, "--segmenter", "classical")
    assert_one_error(code, out, err, "unknown pretrained segmenter 'classical'", "grounded-sam")
    assert "one of auto" not in err


# Result files


@pytest.mark.parametrize(
    "words",
    [["info", "R"], ["export", "R", "ros2"], ["compare", "R", "R"], ["overlay", "C", "R"]],
    ids=lambda words: words[0],
)
@pytest.mark.parametrize(
    ("text", "phrase"),
    [
        (None, "result.json"),
        ("", "result.json"),
        ("{not json", "result.json"),
        ("[1, 2]", "result.json"),
        ('{"schema": 99}', "result.json"),
        ("\udcff\udcfe", "result.json"),
    ],
    ids=["missing", "empty", "no JSON", "a list", "newer", "binary"],
)
def test_broken_result_files(
    words: list[str], text: str | None, phrase: str, folder: CaptureFolder, run: Run, tmp_path: Path
) -> None:
    result = tmp_path / "result.json"
    if text is not None:
        result.write_bytes(text.encode(errors="surrogateescape"))
    named = {"R": result, "C": folder.root}
    assert_one_error(*run(*(named.get(word, word) for word in words)), phrase)


# The command line


@pytest.mark.parametrize(
    "words",
    [
        [],
        ["calibrat"],
        ["calibrate"],
        ["calibrate", "x", "--first-pose", "cube"],
        ["calibrate", "x", "--fast"],
        ["compare", "one.json"],
        ["bench", "solve", "--scenes", "many"],
    ],
    ids=" ".join,
)
def test_wrong_words_on_the_command_line(
    words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as stopped:
        main(words)
    assert stopped.value.code == 2
    out, err = capsys.readouterr()
    assert "Traceback" not in out + err
    assert err.strip()


def test_as_a_process(tmp_path: Path) -> None:
    """What the shell gets to see."""
    done = subprocess.run(
        [sys.executable, "-m", "easyhecpp", "calibrate", str(tmp_path / "nowhere")],
        capture_output=True, text=True, cwd=tmp_path, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    assert done.stdout == ""
    assert "nowhere" in done.stderr
    assert "Traceback" not in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_wrong_arm_is_no_bug(folder: CaptureFolder, run: Run) -> None:
    """Masks that are plain rectangles: whatever comes of it, it is said, and nothing crashes."""
    rng = np.random.default_rng(0)
    for view in folder.views:
        mask = np.zeros((48, 64), np.uint8)
        x, y = rng.integers(2, 40, 2)
        mask[y : y + 3, x : x + 3] = 255
        folder.image(f"{view}.png", mask, folder="masks")
    code, _, err = run("calibrate", folder.root, "--quiet", "--out", "out", "--strict")
    assert code in (2, 3)
    assert "Traceback" not in err
