"""The cache saves time and never changes an answer."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh

from easyhecpp.robot import Robot, cache, link_shapes
from easyhecpp.robot.cache import cache_folder, load_arrays, store_arrays


@pytest.fixture(autouse=True)
def empty_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def test_arrays_come_back() -> None:
    assert load_arrays("key") is None
    store_arrays("key", {"numbers": np.arange(3), "error": 0.5})
    stored = load_arrays("key")
    assert stored is not None
    np.testing.assert_array_equal(stored["numbers"], [0, 1, 2])
    assert stored["error"] == 0.5


def test_old_entries_make_room(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cache, "_MAX_BYTES", 25_000)
    for i in range(5):
        store_arrays(f"entry{i}", {"zeros": np.zeros(1000)})
        os.utime(cache_folder() / f"entry{i}.npz", (i, i))
    store_arrays("entry5", {"zeros": np.zeros(1000)})
    left = sorted(entry.name for entry in cache_folder().iterdir())
    assert left == ["entry3.npz", "entry4.npz", "entry5.npz"][-len(left) :]
    assert 1 <= len(left) <= 3


@pytest.fixture
def boxed(write_urdf: Callable[[str], Path], tmp_path: Path) -> Path:
    """A robot of one link, whose mesh is the file `box.obj`."""
    trimesh.creation.box((1, 2, 3)).export(tmp_path / "box.obj")
    mesh = '<geometry><mesh filename="box.obj"/></geometry>'
    return write_urdf(f'<link name="a"><visual>{mesh}</visual></link>')


def test_a_robot_is_read_once(boxed: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = Robot.from_urdf(boxed).meshes[0]
    monkeypatch.setattr(link_shapes, "_read", None)
    second = Robot.from_urdf(boxed).meshes[0]
    for name in ("vertices", "faces", "face_planes", "edges", "edge_faces"):
        np.testing.assert_array_equal(getattr(second, name), getattr(first, name))
        assert getattr(second, name).dtype == getattr(first, name).dtype
        assert not getattr(second, name).flags.writeable
    assert second.error == first.error == 0.0


@pytest.mark.parametrize("change", ["mesh", "scale", "origin"])
def test_a_changed_robot_is_read_anew(boxed: Path, change: str) -> None:
    before = Robot.from_urdf(boxed).meshes[0]
    if change == "mesh":
        trimesh.creation.box((1, 2, 4)).export(boxed.parent / "box.obj")
    elif change == "scale":
        boxed.write_text(boxed.read_text().replace("<mesh ", '<mesh scale="2 1 1" '))
    else:
        boxed.write_text(boxed.read_text().replace("<visual>", '<visual><origin xyz="0 0 1"/>'))
    assert not np.array_equal(Robot.from_urdf(boxed).meshes[0].vertices, before.vertices)


@pytest.mark.parametrize("damage", ["cut", "emptied", "other arrays"])
def test_a_damaged_entry_is_read_anew(boxed: Path, damage: str) -> None:
    before = Robot.from_urdf(boxed).meshes[0]
    (entry,) = cache_folder().iterdir()
    if damage == "other arrays":
        store_arrays(entry.stem, {"vertices0": np.zeros(3)})
    else:
        entry.write_bytes(entry.read_bytes()[: 200 if damage == "cut" else 0])
    np.testing.assert_array_equal(Robot.from_urdf(boxed).meshes[0].faces, before.faces)


def test_a_folder_that_cannot_be_written(
    boxed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert Robot.from_urdf(boxed).n_faces == 12
