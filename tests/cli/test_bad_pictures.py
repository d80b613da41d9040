"""Bad pictures as the user meets them: left out, named, or one clear error."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest
from scenes_small import photographed
from small_arm import write_urdf

from easyhecpp.capture import Capture, View
from easyhecpp.capture.write import RobotSource, write_capture
from easyhecpp.cli import main
from easyhecpp.formats.result_file import ResultFile
from easyhecpp.geometry import pose_error

N_VIEWS = 8


@dataclass(frozen=True)
class Folder:
    """A capture folder whose pictures are spoilt one by one."""

    root: Path

    def change(self, view: int, change: Callable[[np.ndarray], np.ndarray]) -> None:
        path = self.root / "images" / f"{view:04d}.png"
        assert cv2.imwrite(str(path), change(cv2.imread(str(path))))

    def black(self, *views: int) -> None:
        for view in views:
            self.change(view, np.zeros_like)


@dataclass(frozen=True)
class Ran:
    code: int
    said: str
    out: Path

    @property
    def result(self) -> ResultFile:
        return ResultFile.read(self.out / "result.json")

    @property
    def off_m(self) -> float:
        assert self.result.T_mount_cam is not None
        return pose_error(self.result.T_mount_cam.array, photographed(3, N_VIEWS).T_mount_cam)[0]


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("pictures")
    case = photographed(3, N_VIEWS)
    views = tuple(
        View(f"{i:04d}", q, image=image, mask=mask)
        for i, (q, image, mask) in enumerate(zip(case.joints, case.images, case.masks, strict=True))
    )
    capture = Capture("cell", None, "eye-to-hand", case.rig.robot, case.camera, views)
    return write_capture(root / "cell", capture, robot=RobotSource(write_urdf(root / "robot")))


@pytest.fixture
def folder(written: Path, tmp_path: Path) -> Folder:
    """Without masks."""
    shutil.copytree(written, tmp_path / "cell")
    shutil.rmtree(tmp_path / "cell" / "masks")
    return Folder(tmp_path / "cell")


@pytest.fixture
def masked(written: Path, tmp_path: Path) -> Folder:
    shutil.copytree(written, tmp_path / "cell")
    return Folder(tmp_path / "cell")


@pytest.fixture
def run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Callable[..., Ran]:
    def call(command: str, folder: Folder, *words: str) -> Ran:
        out = tmp_path / "out"
        where = () if command == "check-capture" else ("--out", str(out), "--quiet")
        code = main([command, str(folder.root), *words, *where])
        return Ran(code, "".join(capsys.readouterr()), out)

    return call


Run = Callable[..., Ran]


def shifted(picture: np.ndarray) -> np.ndarray:
    """As from a camera that was turned a little."""
    M = np.array([[1.0, 0.0, 30.0], [0.0, 1.0, -14.0]])
    return cv2.warpAffine(picture, M, picture.shape[1::-1], borderMode=cv2.BORDER_REFLECT)


def test_black_pictures_are_left_out_and_named(folder: Folder, run: Run) -> None:
    folder.black(2, 5)
    ran = run("calibrate", folder, "--segmenter", "classical")
    assert ran.code == 0
    assert ran.off_m < 0.004
    assert "note: Black images: 0002, 0005." in ran.said
    assert "View 0002 is left out: the image is black." in ran.said
    assert [v.id for v in ran.result.views] == [f"{i:04d}" for i in range(N_VIEWS)]
    for view in ran.result.views:
        left_out = view.id in ("0002", "0005")
        assert (view.weight == 0.0, view.flags == ("unusable-image",)) == (left_out, left_out)


def test_segment_makes_no_mask_of_a_picture_without_content(folder: Folder, run: Run) -> None:
    folder.change(4, lambda picture: np.full_like(picture, 255))
    ran = run("segment", folder, "--segmenter", "classical")
    assert ran.code == 0
    assert "note: Images of one colour all over: 0004." in ran.said
    assert f"{N_VIEWS - 1} of {N_VIEWS} masks" in ran.said
    assert not (ran.out / "masks" / "0004.png").exists()


@pytest.mark.parametrize("command", ["calibrate", "segment"])
def test_black_pictures_alone_are_an_error(command: str, folder: Folder, run: Run) -> None:
    folder.black(*range(N_VIEWS))
    ran = run(command, folder, "--segmenter", "classical")
    assert ran.code == 2
    assert ran.said.count("easyhecpp: ") == 1
    assert "Black images: 0000, 0001" in ran.said
    assert "check exposure, lens cap and pixel format" in ran.said
    assert not ran.out.exists()


def test_too_few_pictures_left_are_an_error(folder: Folder, run: Run) -> None:
    folder.black(*range(2, N_VIEWS))
    ran = run("calibrate", folder, "--segmenter", "classical")
    assert ran.code == 2
    assert f"Only 2 of {N_VIEWS} views have an image that can be used" in ran.said
    assert "Black images: 0002, 0003" in ran.said


def test_the_same_picture_all_over_is_an_error(folder: Folder, run: Run) -> None:
    first = folder.root / "images" / "0000.png"
    for view in range(1, N_VIEWS):
        shutil.copy(first, folder.root / "images" / f"{view:04d}.png")
    ran = run("calibrate", folder, "--segmenter", "classical")
    assert ran.code == 2
    assert f"All {N_VIEWS} images are identical" in ran.said
    assert "new frames" in ran.said


def test_a_frozen_picture_is_left_out(folder: Folder, run: Run) -> None:
    images = folder.root / "images"
    shutil.copy(images / "0003.png", images / "0004.png")
    ran = run("calibrate", folder, "--segmenter", "classical")
    assert ran.code == 0
    assert ran.off_m < 0.004
    assert "Identical images of different joint positions: 0003 and 0004" in ran.said
    assert "View 0004 is left out: the image is that of view 0003 again." in ran.said
    assert [v.id for v in ran.result.views if v.weight == 0.0] == ["0004"]


def test_a_jump_of_the_exposure_is_named(folder: Folder, run: Run) -> None:
    folder.change(1, lambda picture: (0.5 * picture).astype(np.uint8))
    ran = run("calibrate", folder, "--segmenter", "classical")
    assert "Images much darker than the others: 0001. Fix exposure" in ran.said


def test_twelve_bits_in_a_file_of_sixteen(folder: Folder, run: Run) -> None:
    for view in range(N_VIEWS):
        folder.change(view, lambda picture: 16 * picture.astype(np.uint16) + 7)
    assert run("check-capture", folder).said.count("\n") == 2  # a note, and the count
    ran = run("calibrate", folder, "--segmenter", "classical")
    assert ran.code == 0
    assert ran.off_m < 0.004
    assert "12 of 16 bits per channel are used" in ran.said


def test_a_camera_that_moved_for_one_view(folder: Folder, run: Run) -> None:
    folder.change(6, shifted)
    checked = run("check-capture", folder)
    assert "warning: The camera moved in view 0006 by about 33 px, against the" in checked.said
    ran = run("calibrate", folder, "--segmenter", "classical")
    assert ran.code == 0
    assert ran.result.verdict == "ok"
    assert ran.off_m < 0.004
    assert "View 0006 is left out: the camera moved by about 33 px" in ran.said
    assert {v.id: v.flags for v in ran.result.views}["0006"] == ("camera-moved",)
    assert [v.id for v in ran.result.views if v.weight == 0.0] == ["0006"]


def test_a_camera_that_was_moved_for_good(folder: Folder, run: Run) -> None:
    for view in (5, 6, 7):
        folder.change(view, shifted)
    ran = run("calibrate", folder, "--segmenter", "classical")
    assert ran.result.verdict == "doubtful"
    assert ran.off_m < 0.006
    assert "The camera moved in views 0005, 0006, 0007 by about 33 px" in ran.result.reasons[0]
    assert [v.id for v in ran.result.views if v.weight == 0.0] == ["0005", "0006", "0007"]


def test_given_masks_work_where_a_picture_does_not(masked: Folder, run: Run) -> None:
    masked.black(3)
    ran = run("calibrate", masked)
    assert ran.code == 0
    assert ran.off_m < 0.002
    assert "note: Black images: 0003." in ran.said
    assert "edges: Contour points" in ran.said
    assert [v.id for v in ran.result.views] == [f"{i:04d}" for i in range(N_VIEWS)]


def test_given_masks_work_without_any_picture(masked: Folder, run: Run) -> None:
    masked.black(*range(N_VIEWS))
    ran = run("calibrate", masked)
    assert ran.code == 0
    assert ran.off_m < 0.004
    assert all(view.weight > 0.0 for view in ran.result.views)


def test_masks_with_black_and_white_exchanged_are_told_as_such(masked: Folder, run: Run) -> None:
    for path in (masked.root / "masks").iterdir():
        mask = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        assert cv2.imwrite(str(path), np.where(mask > 127, 0, 255).astype(np.uint8))
    ran = run("calibrate", masked)
    assert ran.code == 3
    assert f"{N_VIEWS} of {N_VIEWS} masks cover most of the picture and of its edge" in ran.said
    assert "Make the arm white and the background black." in ran.said
