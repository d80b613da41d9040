"""The one test of atomic writing; whoever writes through `_atomic` need not test it again."""

from __future__ import annotations

import os
import signal
import stat
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from easyhecpp import _atomic
from easyhecpp.errors import InputError


def names(folder: Path) -> list[str]:
    return sorted(entry.name for entry in folder.iterdir())


def run_python(code: str, *arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", code, *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
    )


def test_writes_and_replaces_and_leaves_nothing_else(tmp_path):
    target = tmp_path / "new" / "folder" / "result.json"
    _atomic.write_text(target, "grün\n")
    assert target.read_bytes() == "grün\n".encode()
    _atomic.write_bytes(target, b"\x00\r\n")
    assert target.read_bytes() == b"\x00\r\n"
    assert names(target.parent) == ["result.json"]


def test_a_block_that_raises_leaves_the_old_file(tmp_path):
    target = tmp_path / "result.json"
    target.write_text("old")
    with pytest.raises(ZeroDivisionError), _atomic.atomic_path(target) as temporary:
        temporary.write_text("half")
        raise ZeroDivisionError
    assert target.read_text() == "old"
    assert names(tmp_path) == ["result.json"]


def test_the_temporary_file_is_beside_the_target_and_keeps_its_suffix(tmp_path):
    with _atomic.atomic_path(tmp_path / "mesh.ply") as temporary:
        assert temporary.parent == tmp_path
        assert temporary.suffix == ".ply"
        assert temporary.name != "mesh.ply"
        assert not (tmp_path / "mesh.ply").exists()
    assert names(tmp_path) == ["mesh.ply"]


def test_other_users_may_read_as_the_umask_says(tmp_path):
    before = os.umask(0o022)
    try:
        _atomic.write_text(tmp_path / "result.json", "{}")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "result.json").stat().st_mode) == 0o644


def test_a_link_is_followed(tmp_path):
    (tmp_path / "latest.json").symlink_to("run1.json")
    _atomic.write_text(tmp_path / "latest.json", "{}")
    assert (tmp_path / "latest.json").is_symlink()
    assert (tmp_path / "run1.json").read_text() == "{}"


def test_a_full_disk_leaves_the_old_file_and_is_explained(tmp_path):
    target = tmp_path / "result.json"
    target.write_text("old")
    done = run_python(
        # A limit on the size of files fails in the midst of a write as a full disk does.
        "import resource, sys\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))\n"
        "from easyhecpp import _atomic, errors\n"
        "try:\n"
        "    _atomic.write_bytes(sys.argv[1], b'x' * 100_000)\n"
        "except errors.InputError as error:\n"
        "    sys.exit(str(error))\n",
        target,
    )
    assert done.stderr.startswith("Cannot write the file: File too large (")
    assert str(target) in done.stderr
    assert "Free some space" in done.stderr
    assert target.read_text() == "old"
    assert names(tmp_path) == ["result.json"]


@pytest.mark.parametrize("old", ["old", None])
def test_a_kill_in_mid_write_leaves_the_old_file_whole_and_no_half_one(tmp_path, old):
    target = tmp_path / "result.json"
    if old is not None:
        target.write_text(old)
    done = run_python(
        "import os, signal, sys\n"
        "from easyhecpp import _atomic\n"
        "with _atomic.atomic_path(sys.argv[1]) as temporary:\n"
        "    with temporary.open('wb') as file:\n"
        "        file.write(b'half')\n"
        "        file.flush()\n"
        "        os.kill(os.getpid(), signal.SIGKILL)\n",
        target,
    )
    assert done.returncode == -signal.SIGKILL
    assert (target.read_text() if target.exists() else None) == old
    # The next write is not hindered by what the dead one left.
    _atomic.write_text(target, "new")
    assert target.read_text() == "new"


def test_a_folder_that_cannot_be_made_is_named(tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(InputError) as caught:
        _atomic.write_text(tmp_path / "file" / "result.json", "{}")
    assert str(caught.value).startswith("Cannot write into the folder: ")
    assert caught.value.where == str(tmp_path / "file")
    assert caught.value.fix == "Choose a folder that you may write to"


def test_a_folder_without_permission_is_named():
    # The kernel's own folder refuses the super-user as well.
    with pytest.raises(InputError, match=r"Cannot write into the folder: .* \(/proc\)"):
        _atomic.write_text("/proc/result.json", "{}")


def test_a_folder_in_the_place_of_the_file_is_named(tmp_path):
    with pytest.raises(InputError, match="Cannot write a file over a folder"):
        _atomic.write_text(tmp_path, "{}")


def test_pictures_come_back_as_they_were_stored(tmp_path):
    rng = np.random.default_rng(0)
    colour = rng.integers(0, 256, (5, 7, 3), dtype=np.uint8)
    mask = rng.random((5, 7)) > 0.5
    depth_mm = rng.integers(0, 5000, (5, 7), dtype=np.uint16)
    _atomic.write_image(tmp_path / "colour.png", colour)
    _atomic.write_image(tmp_path / "mask.png", mask)
    _atomic.write_image(tmp_path / "depth.png", depth_mm)
    read = {path.stem: cv2.imread(str(path), cv2.IMREAD_UNCHANGED) for path in tmp_path.iterdir()}
    np.testing.assert_array_equal(read["colour"][..., ::-1], colour)
    np.testing.assert_array_equal(read["mask"], np.where(mask, 255, 0))
    np.testing.assert_array_equal(read["depth"], depth_mm)


@pytest.mark.parametrize(
    ("name", "image", "words"),
    [
        ("a.png", np.zeros((4, 4, 3)), r"shape \(4, 4, 3\) and type float64"),
        ("a.png", np.zeros((4, 4, 4), np.uint8), r"shape \(4, 4, 4\)"),
        ("a.nothing", np.zeros((4, 4), np.uint8), "Cannot store a picture as '.nothing'"),
        ("a", np.zeros((4, 4), np.uint8), "as 'a file without a suffix'"),
    ],
)
def test_what_is_no_picture_is_refused_before_anything_is_written(tmp_path, name, image, words):
    with pytest.raises(InputError, match=words):
        _atomic.write_image(tmp_path / name, image)
    assert names(tmp_path) == []
