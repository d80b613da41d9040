from __future__ import annotations

import json
from concurrent.futures.process import BrokenProcessPool

import numpy as np
import pytest

from easyhecpp.capture import Capture
from easyhecpp.errors import CalibrationError, InputError
from easyhecpp.sim import dataset as dataset_module
from easyhecpp.sim.dataset import TRUTH, generate_scenes
from easyhecpp.sim.options import CellOptions
from easyhecpp.sim.studio import Quality

pytest.importorskip("mitsuba", reason="path-traced pictures need the extra sim")

WHAT = {
    "views": 2,
    "options": CellOptions(width=96, height=54, distractor=0.0, clutter=(0, 2), furniture=1),
    "quality": Quality(samples=2, depth=1),
    "workers": 1,
}


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scenes")
    calls: list[tuple[int, int, str]] = []
    folders = generate_scenes(folder, 2, seed=5, progress=lambda *c: calls.append(c), **WHAT)
    return folder, folders, calls


def test_scenes_are_captures_with_the_truth_beside_them(dataset):
    _, folders, calls = dataset
    assert [f.name for f in folders] == ["scene_0000", "scene_0001"]
    assert calls == [(1, 2, "scene_0000"), (2, 2, "scene_0001")]
    for index, folder in enumerate(folders):
        capture = Capture.load(folder)
        truth = json.loads((folder / TRUTH).read_text())
        assert len(capture.views) == 2
        view = capture.views[0]
        assert view.image.shape == (54, 96, 3)
        assert 0 < view.mask.mean() < 1
        assert view.depth.max() > 0.3
        T = np.array(truth["T_base_cam"])
        assert T[:3, :3] @ T[:3, :3].T == pytest.approx(np.eye(3))
        assert truth["T_mount_cam"]["parent"] == "link_base"
        assert truth["index"] == index
        assert truth["settings"]["seed"] == 5


def test_the_masks_in_the_folder_are_those_of_the_pose_in_the_truth(dataset):
    from easyhecpp.render import reference_coverage

    folder = dataset[1][0]
    capture = Capture.load(folder)
    T_base_cam = np.array(json.loads((folder / TRUTH).read_text())["T_base_cam"])
    for view in capture.views:
        Ts_cam_link = np.linalg.inv(T_base_cam) @ capture.robot.link_poses(view.joints)
        rendered = reference_coverage(capture.robot.meshes, capture.camera, Ts_cam_link, 5) > 0.5
        assert (rendered & view.mask).sum() > 0.95 * (rendered | view.mask).sum()


def test_a_second_run_makes_nothing_and_mends_what_is_broken(dataset):
    folder, folders, _ = dataset
    image = folders[0] / "images" / "0000.png"
    stamp, content = image.stat().st_mtime_ns, (folders[1] / "images" / "0001.png").read_bytes()
    calls: list[tuple[int, int, str]] = []
    generate_scenes(folder, 2, seed=5, progress=lambda *c: calls.append(c), **WHAT)
    assert calls == []
    assert image.stat().st_mtime_ns == stamp
    # A run that was killed leaves a scene without its truth.
    (folders[1] / TRUTH).unlink()
    (folders[1] / "images" / "0001.png").unlink()
    (folder / ".scene_0001.abcdef.tmp" / "images").mkdir(parents=True)
    generate_scenes(folder, 2, seed=5, progress=lambda *c: calls.append(c), **WHAT)
    assert calls == [(2, 2, "scene_0001")]
    assert sorted(f.name for f in folder.iterdir()) == ["scene_0000", "scene_0001"]
    assert (folders[1] / "images" / "0001.png").read_bytes() == content
    assert image.stat().st_mtime_ns == stamp


def test_other_settings_are_another_data_set(dataset, tmp_path):
    folder = generate_scenes(tmp_path, 1, seed=5, **WHAT)[0]
    first = json.loads((folder / TRUTH).read_text())
    assert first == json.loads((dataset[1][0] / TRUTH).read_text())
    generate_scenes(tmp_path, 1, seed=6, **WHAT)
    assert json.loads((folder / TRUTH).read_text())["T_base_cam"] != first["T_base_cam"]


def test_processes_make_the_same_scenes(dataset, tmp_path):
    folders = generate_scenes(tmp_path, 2, seed=5, **{**WHAT, "workers": 2})
    for mine, theirs in zip(folders, dataset[1], strict=True):
        for name in (TRUTH, "images/0000.png", "masks/0001.png", "depth/0000.png", "joints.csv"):
            assert (mine / name).read_bytes() == (theirs / name).read_bytes()


def test_a_process_that_the_system_ends_is_told_in_a_sentence(tmp_path, monkeypatch):
    def broken(*_, **__):
        raise BrokenProcessPool

    monkeypatch.setattr(dataset_module.ProcessPoolExecutor, "submit", broken)
    with pytest.raises(CalibrationError, match="ended a worker process"):
        generate_scenes(tmp_path, 2, **{**WHAT, "workers": 2})


def test_any_urdf_will_do(shared, tmp_path):
    urdf = shared / "captures" / "xarm7_realsense" / "robot" / "robot.urdf"
    folder = generate_scenes(tmp_path, 1, robot=str(urdf), **{**WHAT, "views": 1})[0]
    capture = Capture.load(folder)
    assert capture.robot.base_link == "link_base"
    assert 0 < capture.views[0].mask.mean() < 1


@pytest.mark.parametrize(
    ("change", "words"),
    [({"n": 0}, "n is 0"), ({"robot": "robby"}, "robby"), ({"views": 0}, "views is 0")],
)
def test_nonsense_is_refused_before_anything_is_made(tmp_path, change, words):
    with pytest.raises(InputError, match=words):
        generate_scenes(**{"folder": tmp_path, "n": 1, **WHAT, **change})
    assert list(tmp_path.iterdir()) == []
