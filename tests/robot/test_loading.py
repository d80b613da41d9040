"""From files to a robot: origins, scales, where files are found, and what is said when not."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh

from easyhecpp.errors import InputError
from easyhecpp.robot import Robot

from .urdf_text import BOX, joint

Write = Callable[[str], Path]


def link(name: str, geometry: str, origin: str = "", kind: str = "visual") -> str:
    return f'<link name="{name}"><{kind}>{origin}<geometry>{geometry}</geometry></{kind}></link>'


def mesh_geometry(filename: str, scale: str = "") -> str:
    return f'<mesh filename="{filename}" {scale}/>'


def write_box(path: Path, size: tuple[float, float, float] = (0.2, 0.4, 0.6)) -> None:
    """A box with one corner in the origin."""
    path.parent.mkdir(parents=True, exist_ok=True)
    box = trimesh.creation.box(size)
    box.apply_translation(np.array(size) / 2)
    box.export(path)


def extent(robot: Robot) -> np.ndarray:
    vertices = robot.meshes[0].vertices
    return np.stack([vertices.min(axis=0), vertices.max(axis=0)])


def volume(robot: Robot) -> float:
    mesh = robot.meshes[0]
    return float(np.linalg.det(mesh.vertices[mesh.faces]).sum() / 6.0)


def message(path: Path, **options: object) -> str:
    with pytest.raises(InputError) as caught:
        Robot.from_urdf(path, **options)
    return str(caught.value)


def test_visual_origins_and_scales(write_urdf: Write, tmp_path: Path) -> None:
    write_box(tmp_path / "box.stl")
    quarter_turn = '<origin xyz="1 0 0" rpy="0 0 1.5707963267948966"/>'
    scaled = mesh_geometry("box.stl", 'scale="10 1 1"')
    robot = Robot.from_urdf(write_urdf(link("a", scaled, quarter_turn)))
    # Scaled along X first, then turned onto Y, then moved.
    np.testing.assert_allclose(extent(robot), [[0.6, 0, 0], [1, 2, 0.6]], atol=1e-6)
    uniform = Robot.from_urdf(write_urdf(link("a", mesh_geometry("box.stl", 'scale="0.001"'))))
    np.testing.assert_allclose(extent(uniform)[1], [2e-4, 4e-4, 6e-4], atol=1e-9)


@pytest.mark.parametrize("scale", ["1 1 1", "-1 1 1", "1 -1 -1", "-1 -1 -1"])
def test_mirroring_scales_keep_faces_outwards(
    write_urdf: Write, tmp_path: Path, scale: str
) -> None:
    write_box(tmp_path / "box.stl")
    robot = Robot.from_urdf(write_urdf(link("a", mesh_geometry("box.stl", f'scale="{scale}"'))))
    assert volume(robot) == pytest.approx(0.2 * 0.4 * 0.6, rel=1e-6)
    signs = np.array(scale.split(), float)
    corners = np.stack([np.zeros(3), signs * [0.2, 0.4, 0.6]])
    np.testing.assert_allclose(extent(robot), np.sort(corners, axis=0), atol=1e-7)


def test_several_visuals_are_one_mesh(write_urdf: Write) -> None:
    two = (
        '<link name="a"><visual><geometry><box size="1 1 1"/></geometry></visual><visual>'
        '<origin xyz="0 0 5"/><geometry><cylinder radius="0.1" length="1"/></geometry></visual>'
        "</link>"
    )
    robot = Robot.from_urdf(write_urdf(two))
    assert robot.link_names == ("a",)
    np.testing.assert_allclose(extent(robot)[:, 2], [-0.5, 5.5])
    assert 0 < robot.mesh_error < 1e-4
    assert volume(robot) == pytest.approx(1 + np.pi * 0.01, rel=1e-3)


PLACES = {
    "beside": ("box.stl", "box.stl"),
    "above": ("meshes/box.stl", "../meshes/box.stl"),
    "spaces": ("my box.stl", "my%20box.stl"),
    "package named like its folder": ("meshes/box.stl", "package://pkg/meshes/box.stl"),
    "package beside": ("../other/box.stl", "package://other/box.stl"),
}


@pytest.mark.parametrize("place", PLACES)
def test_files_are_found_from_the_urdf(tmp_path: Path, place: str) -> None:
    file, name = PLACES[place]
    folder = tmp_path / "pkg" / "urdf"
    folder.mkdir(parents=True)
    write_box((folder if place in ("beside", "spaces") else folder.parent) / file)
    path = folder / "robot.urdf"
    path.write_text(f'<robot name="r">{link("a", mesh_geometry(name))}</robot>')
    assert Robot.from_urdf(path).n_faces == 12


def test_file_urls(write_urdf: Write, tmp_path: Path) -> None:
    write_box(tmp_path / "elsewhere" / "box.stl")
    url = (tmp_path / "elsewhere" / "box.stl").as_uri()
    assert Robot.from_urdf(write_urdf(link("a", mesh_geometry(url)))).n_faces == 12


@pytest.mark.parametrize(
    ("variable", "named_by"),
    [
        ("package_dirs", "folder"),
        ("package_dirs", "package.xml"),
        ("ROS_PACKAGE_PATH", "folder"),
        ("ROS_PACKAGE_PATH", "package.xml"),
        ("AMENT_PREFIX_PATH", "folder"),
    ],
)
def test_packages_are_found(
    write_urdf: Write,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    variable: str,
    named_by: str,
) -> None:
    path = write_urdf(link("a", mesh_geometry("package://arm_description/box.stl")))
    # Outside the folders above the URDF, so that only the variable leads there.
    root = tmp_path / "far" / "away"
    holder = root / "share" if variable == "AMENT_PREFIX_PATH" else root
    package = holder / ("arm_description" if named_by == "folder" else "checkout")
    write_box(package / "box.stl")
    place = root
    if named_by == "package.xml":
        (package / "package.xml").write_text("<package><name> arm_description </name></package>")
        place = package
    assert "arm_description/box.stl" in message(path)
    if variable == "package_dirs":
        assert Robot.from_urdf(path, package_dirs=[place]).n_faces == 12
    else:
        monkeypatch.setenv(variable, f"/nowhere:{place}")
        assert Robot.from_urdf(path).n_faces == 12


def write_package(folder: Path, name: str, size: tuple[float, float, float] = (1, 1, 1)) -> None:
    write_box(folder / "box.stl", size)
    (folder / "package.xml").write_text(f"<package><name>{name}</name></package>")


@pytest.mark.parametrize("variable", ["package_dirs", "ROS_PACKAGE_PATH"])
@pytest.mark.parametrize("place", [".", "src", "src/arm_ros"])
def test_packages_are_found_in_a_workspace(
    write_urdf: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, variable: str, place: str
) -> None:
    path = write_urdf(link("a", mesh_geometry("package://arm_description/box.stl")))
    workspace = tmp_path / "far" / "ws"
    write_package(workspace / "src" / "arm_ros" / "checkout", "arm_description")
    if variable == "package_dirs":
        assert Robot.from_urdf(path, package_dirs=[workspace / place]).n_faces == 12
    else:
        monkeypatch.setenv(variable, str(workspace / place))
        assert Robot.from_urdf(path).n_faces == 12


def test_what_is_not_looked_through_for_packages(write_urdf: Write, tmp_path: Path) -> None:
    path = write_urdf(link("a", mesh_geometry("package://arm_description/box.stl")))
    workspace = tmp_path / "far" / "ws"
    for hidden in (".git/arm", "a/b/c/d/arm", "other/inside/arm"):
        write_package(workspace / hidden, "arm_description")
    write_package(workspace / "other", "other")
    assert "'package://arm_description/box.stl'" in message(path, package_dirs=[workspace])
    (workspace / "linked").symlink_to(workspace / "a" / "b" / "c")  # as people link checkouts
    (workspace / "loop").symlink_to(workspace)
    assert Robot.from_urdf(path, package_dirs=[workspace]).n_faces == 12


def test_the_package_nearest_to_the_top_counts(write_urdf: Write, tmp_path: Path) -> None:
    path = write_urdf(link("a", mesh_geometry("package://arm/box.stl")))
    workspace = tmp_path / "far" / "ws"
    write_package(workspace / "install" / "arm" / "share" / "arm", "arm", (1, 1, 1))
    write_package(workspace / "src" / "arm_ros" / "arm", "arm", (2, 2, 2))
    assert volume(Robot.from_urdf(path, package_dirs=[workspace])) == pytest.approx(8)


def test_given_folders_come_before_the_urdfs_own(write_urdf: Write, tmp_path: Path) -> None:
    path = write_urdf(link("a", mesh_geometry("package://pkg/box.stl")))
    write_box(tmp_path / "pkg" / "box.stl", (1, 1, 1))
    write_box(tmp_path / "mine" / "pkg" / "box.stl", (2, 2, 2))
    assert volume(Robot.from_urdf(path)) == pytest.approx(1)
    assert volume(Robot.from_urdf(path, package_dirs=[tmp_path / "mine"])) == pytest.approx(8)


def test_all_missing_meshes_are_told_with_where_they_were_sought(
    write_urdf: Write, tmp_path: Path
) -> None:
    body = (
        link("a", mesh_geometry("one.stl"))
        + link("b", mesh_geometry("package://pkg/two.stl"))
        + link("c", mesh_geometry("http://host/three.stl"))
        + joint("j", "a", "b")
        + joint("k", "b", "c")
    )
    text = message(write_urdf(body), package_dirs=[tmp_path / "given"])
    assert "3 mesh files are missing" in text
    assert f"'one.stl' of link 'a', looked for at {tmp_path / 'one.stl'}" in text
    assert f"{tmp_path / 'given' / 'pkg' / 'two.stl'}, {tmp_path / 'pkg' / 'two.stl'}" in text
    assert "'http://host/three.stl' of link 'c', whose scheme is not" in text
    assert Robot.from_urdf(
        write_urdf(body + f'<link name="d">{BOX}</link>' + joint("l", "a", "d")),
        ignore_links=["a", "b", "c"],
    ).link_names == ("d",)


def test_collision_meshes_are_offered_when_they_are_there(
    write_urdf: Write, tmp_path: Path
) -> None:
    write_box(tmp_path / "simple.stl")
    shapes = link("a", mesh_geometry("fine.stl")).replace(
        "</link>",
        f"<collision><geometry>{mesh_geometry('simple.stl')}</geometry></collision></link>",
    )
    path = write_urdf(shapes)
    text = message(path)
    assert "draw the collision geometry, whose meshes are all there (geometry: collision)" in text
    assert "key of capture.yaml and an option of 'easyhecpp info'" in text
    assert "package_dirs" not in text
    robot = Robot.from_urdf(path, geometry="collision")
    assert robot.n_faces == 12
    assert "drawn by its collision geometry" in robot.notes[0]
    broken = shapes.replace("</link>", "<collision/></link>")
    assert "geometry: collision" not in message(write_urdf(broken))


def test_links_without_the_wanted_geometry_are_told(write_urdf: Write) -> None:
    collision = BOX.replace("visual", "collision")
    body = f'<link name="a">{BOX}</link><link name="b">{collision}</link>' + joint("j", "a", "b")
    robot = Robot.from_urdf(write_urdf(body))
    assert robot.link_names == ("a",)
    assert "Links with collision but no visual geometry" in robot.notes[0]
    assert robot.notes[0].endswith("b.")
    assert Robot.from_urdf(write_urdf(body), ignore_links=["b"]).notes == ()
    only = f'<link name="a">{collision}</link>'
    text = message(write_urdf(only))
    assert "It has collision geometry to draw (geometry: collision)" in text
    assert "No link has visual geometry" in message(write_urdf('<link name="a"/>'))


def test_a_mesh_of_slivers_is_empty(write_urdf: Write, tmp_path: Path) -> None:
    (tmp_path / "m.obj").write_text("v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n")
    text = message(write_urdf(link("a", mesh_geometry("m.obj"))))
    assert "all its triangles are degenerate" in text
    assert "link 'a'" in text


@pytest.mark.parametrize(
    ("body", "base"),
    [
        ('<link name="w"/><link name="a">BOX</link>' + joint("j", "w", "a", "fixed"), "a"),
        (
            '<link name="w"/><link name="v"/><link name="a">BOX</link>'
            + joint("j", "w", "v", "fixed")
            + joint("k", "v", "a", "fixed"),
            "a",
        ),
        ('<link name="w"/><link name="a">BOX</link>' + joint("j", "w", "a"), "w"),
        ('<link name="a">BOX</link><link name="b">BOX</link>' + joint("j", "a", "b", "fixed"), "a"),
        (
            '<link name="w"/><link name="a">BOX</link><link name="b">BOX</link>'
            + joint("j", "w", "b", "fixed")
            + joint("k", "w", "a", "fixed"),
            "a",
        ),
        (
            '<link name="w"><collision><geometry><sphere radius="1"/></geometry></collision></link>'
            '<link name="a">BOX</link>' + joint("j", "w", "a", "fixed"),
            "a",
        ),
    ],
)
def test_the_base_is_the_first_link_with_geometry(write_urdf: Write, body: str, base: str) -> None:
    robot = Robot.from_urdf(write_urdf(body.replace("BOX", BOX)))
    assert robot.base_link == base
    np.testing.assert_allclose(robot.frame_pose(np.zeros(robot.n_joints), base), np.eye(4))


def test_the_base_does_not_depend_on_ignored_links_or_geometry(write_urdf: Write) -> None:
    both = BOX + BOX.replace("visual", "collision")
    body = f'<link name="w"/><link name="a">{both}</link><link name="b">{both}</link>'
    path = write_urdf(body + joint("j", "w", "a", "fixed") + joint("k", "a", "b"))
    assert Robot.from_urdf(path, ignore_links=["a"]).base_link == "a"
    assert Robot.from_urdf(path, geometry="collision").base_link == "a"
    assert Robot.from_urdf(path, base_link="b").base_link == "b"


def test_real_captures(shared: Path) -> None:
    xarm = Robot.from_urdf(shared / "captures/xarm7_realsense/robot/robot.urdf")
    assert (xarm.base_link, xarm.n_joints, xarm.n_faces) == ("link_base", 7, 41096)
    lbr = Robot.from_urdf(shared / "captures/lbr_med7_realsense/robot/robot.urdf")
    assert (lbr.base_link, lbr.n_joints, len(lbr.link_names)) == ("lbr_link_0", 7, 8)
    assert lbr.notes == ()


def test_files_that_cannot_be_read(
    write_urdf: Write, tmp_path: Path, lock: Callable[[Path], None]
) -> None:
    write_box(tmp_path / "box.stl")
    path = write_urdf(link("a", mesh_geometry("box.stl")))
    lock(tmp_path / "box.stl")
    assert "mesh cannot be read" in message(path)
    assert "box.stl" in message(path)
    for name in ("robot.urdf", "robot.xacro"):
        (tmp_path / name).touch()
        lock(tmp_path / name)
        text = message(tmp_path / name)
        assert "robot description cannot be read: Permission denied" in text
        assert name in text


def test_folders_of_meshes_that_cannot_be_looked_into(
    write_urdf: Write, tmp_path: Path, lock: Callable[[Path], None]
) -> None:
    write_box(tmp_path / "closed" / "box.stl")
    lock(tmp_path / "closed")
    path = write_urdf(link("a", mesh_geometry("closed/box.stl")))
    assert f"looked for at {tmp_path / 'closed' / 'box.stl'} (Permission denied)" in message(path)
    packaged = write_urdf(link("a", mesh_geometry("package://arm/box.stl")))
    write_box(tmp_path / "arm" / "box.stl")
    assert Robot.from_urdf(packaged, package_dirs=[tmp_path / "closed"]).n_faces == 12


def test_names_that_no_file_can_have(write_urdf: Write) -> None:
    long = write_urdf(link("a", mesh_geometry("x" * 300 + ".stl")))
    assert "x.stl (File name too long)" in message(long)
    zero = write_urdf(link("a", mesh_geometry("a%00b.stl")))
    assert "(embedded null byte)" in message(zero)
    unknown = "The home folder in '~no-such-user/ws' is not known (package_dirs)"
    assert unknown in message(zero, package_dirs=["~no-such-user/ws"])
    assert "'~no-such-user/r.urdf' is not known" in message(Path("~no-such-user/r.urdf"))
