from __future__ import annotations

import shutil

import numpy as np
import pytest
import trimesh
import yaml

from easyhecpp.capture import Capture, RobotSource, View, check_capture, write_capture
from easyhecpp.capture import write as write_module
from easyhecpp.errors import InputError


def same(a: Capture, b: Capture) -> None:
    assert a.view_ids == b.view_ids
    assert (a.camera, a.setup, a.ee_link) == (b.camera, b.setup, b.ee_link)
    assert a.rig.mount == b.rig.mount
    assert a.robot.link_names == b.robot.link_names
    for u, v in zip(a.views, b.views, strict=True):
        np.testing.assert_array_equal(u.joints, v.joints)
        for part in ("image", "mask", "depth"):
            np.testing.assert_equal(getattr(u, part), getattr(v, part))


def test_what_was_written_reads_back_the_same(folder, tmp_path):
    folder.config(setup="eye-in-hand", ee_link="camera_mount", ignore_links=["finger"])
    capture = Capture.load(folder.root)
    target = write_capture(tmp_path / "new" / "copy", capture)
    shutil.rmtree(folder.root / "robot")
    written = Capture.load(target)
    same(written, capture)
    assert written.notes == ()
    assert [p.name for p in (tmp_path / "new").iterdir()] == ["copy"]


def test_pictures_in_memory(folder, tmp_path):
    loaded = Capture.load(folder.root)
    rng = np.random.default_rng(5)
    depth = rng.integers(0, 3000, (48, 64)) / np.float32(1000)
    views = (
        View(
            "first",
            rng.normal(size=5) * 0.1 + 0.2,
            image=rng.integers(0, 256, (48, 64, 3)).astype(np.uint8),
            mask=rng.random((48, 64)) > 0.5,
            depth=depth,
        ),
        View("0002", loaded.views[0].joints, image=loaded.views[2].image),
    )
    made = Capture("made", None, loaded.setup, loaded.robot, loaded.camera, views)
    source = RobotSource(folder.root / "robot" / "robot.urdf")
    written = Capture.load(write_capture(tmp_path / "made", made, robot=source))
    np.testing.assert_allclose(written.views[0].depth, depth, atol=1e-6)
    np.testing.assert_array_equal(written.views[0].image, views[0].image)
    np.testing.assert_array_equal(written.views[0].mask, views[0].mask)
    np.testing.assert_array_equal(written.views[0].joints, views[0].joints)
    assert not written.views[1].has_mask


def test_depth_that_has_no_number_is_stored_as_unknown(folder, tmp_path):
    loaded = Capture.load(folder.root)
    depth = np.full((48, 64), 1.5, np.float32)
    depth[0, :4] = (np.inf, np.nan, -1.0, 80.0)
    view = View("a", loaded.views[0].joints, image=loaded.views[0].image, depth=depth)
    made = Capture("made", folder.root, loaded.setup, loaded.robot, loaded.camera, (view,))
    written = Capture.load(write_capture(tmp_path / "made", made)).views[0].depth
    assert written[0, :5].tolist() == [0, 0, 0, 0, 1.5]


def test_real_capture_copies_with_its_meshes(shared, tmp_path):
    capture = Capture.load(shared / "captures" / "lbr_med7_realsense").subset(["0003", "0007"])
    target = write_capture(tmp_path / "lbr", capture)
    written = Capture.load(target)
    same(written, capture)
    for a, b in zip(written.robot.meshes, capture.robot.meshes, strict=True):
        np.testing.assert_array_equal(a.vertices, b.vertices)
    assert check_capture(target) == []


def test_meshes_of_packages_and_of_the_same_name_are_kept_apart(folder, tmp_path):
    package = tmp_path / "tiny_description"
    for name, size in (("a", 0.1), ("b", 0.2)):
        (package / name).mkdir(parents=True)
        trimesh.creation.box((size, size, size)).export(package / name / "part.stl")
    urdf = folder.root / "robot" / "robot.urdf"
    text = urdf.read_text()
    for box, name in (('size="0.2 0.2 0.1"', "a"), ('size="0.1 0.1 0.1"', "b")):
        mesh = f'<mesh filename="package://tiny_description/{name}/part.stl"/>'
        text = text.replace(f"<box {box}/>", mesh)
    text = text.replace("</robot>", "").rstrip() + "\n</robot>\n"
    urdf.write_text(text)
    folder.config(package_dirs=[".."])
    capture = Capture.load(folder.root)
    written = Capture.load(write_capture(tmp_path / "copy", capture))
    assert written.robot.meshes[0].vertices.max() == pytest.approx(0.05)
    assert written.robot.meshes[1].vertices.max() == pytest.approx(0.1)
    names = sorted(p.name for p in (tmp_path / "copy" / "robot" / "meshes" / "visual").iterdir())
    assert names == ["part.stl", "part_2.stl"]


def collision_only(folder):
    """The arm's upper link seen as a mesh that is gone, touched as a thicker box."""
    urdf = folder.root / "robot" / "robot.urdf"
    seen = '<geometry><box size="0.05 0.05 0.3"/></geometry></visual>'
    assert seen in urdf.read_text()
    gone = '<geometry><mesh filename="gone.stl"/></geometry></visual>'
    touched = '<collision><geometry><mesh filename="thick.stl"/></geometry></collision>'
    urdf.write_text(urdf.read_text().replace(seen, gone + touched))
    trimesh.creation.box((0.1, 0.1, 0.3)).export(urdf.parent / "thick.stl")


def test_collision_geometry_instead_of_missing_visual_meshes(folder, tmp_path):
    collision_only(folder)
    with pytest.raises(InputError, match=r"(?s)gone\.stl.*geometry: collision"):
        Capture.load(folder.root)
    folder.config(geometry="collision")
    capture = Capture.load(folder.root)
    assert capture.robot.link_names == ("upper",)
    assert np.ptp(capture.robot.meshes[0].vertices, axis=0).tolist() == pytest.approx(
        [0.1, 0.1, 0.3]
    )
    assert any("drawn by its collision geometry" in note for note in capture.notes)
    written = Capture.load(write_capture(tmp_path / "copy", capture))
    same(written, capture)
    assert written.robot.geometry == "collision"


def test_a_missing_mesh_matters_only_when_it_is_drawn(folder, tmp_path):
    urdf = folder.root / "robot" / "robot.urdf"
    gone = '<geometry><mesh filename="gone.stl"/></geometry>'
    text = urdf.read_text().replace('<geometry><box size="0.01 0.01 0.05"/></geometry>', gone)
    urdf.write_text(text)
    folder.config(ignore_links=["finger"])
    capture = Capture.load(folder.root)
    same(Capture.load(write_capture(tmp_path / "copy", capture)), capture)
    with pytest.raises(InputError, match=r"mesh 'gone\.stl' is missing.*package_dirs"):
        write_capture(tmp_path / "other", capture, robot=RobotSource(urdf))
    assert not (tmp_path / "other").exists()


def test_referring_to_the_robot_instead_of_copying_it(folder, tmp_path):
    capture = Capture.load(folder.root)
    source = RobotSource(folder.root / "robot" / "robot.urdf", copy=False)
    target = write_capture(tmp_path / "light", capture, robot=source)
    settings = yaml.safe_load((target / "capture.yaml").read_text())
    assert settings["robot"] == "../demo/robot/robot.urdf"
    assert not (target / "robot").exists()
    same(Capture.load(target), capture)
    far = write_capture(tmp_path / "deep" / "er" / "light", capture, robot=source)
    assert yaml.safe_load((far / "capture.yaml").read_text())["robot"] == str(source.path)


def test_an_existing_folder_is_replaced_only_when_allowed(folder, tmp_path):
    capture = Capture.load(folder.root)
    target = write_capture(tmp_path / "copy", capture)
    with pytest.raises(InputError, match="already and not empty"):
        write_capture(target, capture)
    write_capture(target, Capture.load(target).subset(["0001"]), overwrite=True)
    assert Capture.load(target).view_ids == ("0001",)
    assert [p.name for p in (target / "images").iterdir()] == ["0001.png"]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["copy", "demo"]


def test_an_empty_folder_may_be_filled(folder, tmp_path):
    (tmp_path / "copy").mkdir()
    target = write_capture(tmp_path / "copy", Capture.load(folder.root))
    assert len(Capture.load(target).views) == 3


def test_a_failure_leaves_the_old_capture_and_nothing_else(folder, tmp_path, monkeypatch):
    capture = Capture.load(folder.root)
    target = write_capture(tmp_path / "copy", capture)

    def fail(*_: object) -> None:
        raise RuntimeError("power cut")

    monkeypatch.setattr(write_module, "_write_view", fail)
    with pytest.raises(RuntimeError):
        write_capture(target, capture.subset(["0001"]), overwrite=True)
    with pytest.raises(RuntimeError):
        write_capture(tmp_path / "fresh", capture)
    assert Capture.load(target).view_ids == capture.view_ids
    assert sorted(p.name for p in tmp_path.iterdir()) == ["copy", "demo"]


def test_refusals(folder, tmp_path):
    capture = Capture.load(folder.root)
    q, image = capture.views[0].joints, capture.views[0].image

    def write(*views: View, root=folder.root, **options):
        made = Capture("made", root, capture.setup, capture.robot, capture.camera, views)
        return write_capture(tmp_path / "out", made, **options)

    with pytest.raises(InputError, match=r"does not know where its robot.*RobotSource\(path\)"):
        write(View("a", q, image), root=None)
    with pytest.raises(InputError, match=r"under the names '\.\./a', 'b\.png'"):
        write(View("../a", q, image), View("b.png", q, image))
    with pytest.raises(InputError, match="Views without an image: b"):
        write(View("a", q, image), View("b", q))
    with pytest.raises(InputError, match="without views"):
        write()
    with pytest.raises(InputError, match="Copy the robot instead"):
        inside = RobotSource(folder.root / "robot" / "robot.urdf", copy=False)
        write_capture(folder.root, capture, robot=inside, overwrite=True)
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="over a file"):
        write_capture(tmp_path / "file", capture)
