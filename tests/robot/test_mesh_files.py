"""Mesh formats, against shapes whose size and volume are known."""

from __future__ import annotations

import re
import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh

from easyhecpp.errors import InputError
from easyhecpp.robot.link_mesh import LinkMesh
from easyhecpp.robot.mesh_files import read_mesh

TETRAHEDRON = trimesh.Trimesh(
    [[0, 0, 0], [0.1, 0, 0], [0, 0.2, 0], [0, 0, 0.3]],
    [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]],
    process=False,
)


def volume(vertices: np.ndarray, faces: np.ndarray) -> float:
    """Volume that a closed surface encloses, positive when its faces look outwards."""
    return float(np.linalg.det(vertices[faces]).sum() / 6.0)


def extent(vertices: np.ndarray) -> np.ndarray:
    return np.stack([vertices.min(axis=0), vertices.max(axis=0)])


@pytest.mark.parametrize("suffix", [".stl", ".obj", ".ply", ".glb", ".dae", ".off", ".STL"])
def test_formats_agree(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"shape{suffix}"
    TETRAHEDRON.export(path, file_type=suffix[1:].lower())
    vertices, faces = read_mesh(path)
    assert len(faces) == 4
    np.testing.assert_allclose(extent(vertices), [[0, 0, 0], [0.1, 0.2, 0.3]], atol=1e-7)
    assert volume(vertices, faces) == pytest.approx(0.001, rel=1e-5)
    mesh = LinkMesh.from_triangles(vertices, faces)
    assert (len(mesh.vertices), len(mesh.edges), mesh.n_open_edges) == (4, 6, 0)


def test_stl_in_words_and_binary_stl_that_begins_with_solid(tmp_path: Path) -> None:
    words = tmp_path / "words.stl"
    TETRAHEDRON.export(words, file_type="stl_ascii")
    assert words.read_bytes().startswith(b"solid")
    assert volume(*read_mesh(words)) == pytest.approx(0.001, rel=1e-5)
    binary = tmp_path / "binary.stl"
    TETRAHEDRON.export(binary, file_type="stl")
    data = b"solid".ljust(80) + binary.read_bytes()[80:]
    binary.write_bytes(data)
    assert volume(*read_mesh(binary)) == pytest.approx(0.001, rel=1e-5)
    binary.write_bytes(b"exported".ljust(80) + data[80:] + b"trailing bytes")
    assert volume(*read_mesh(binary)) == pytest.approx(0.001, rel=1e-5)


def test_stl_in_capital_words(tmp_path: Path) -> None:
    TETRAHEDRON.export(tmp_path / "words.stl", file_type="stl_ascii")
    shouted = tmp_path / "shouted.stl"
    shouted.write_bytes((tmp_path / "words.stl").read_bytes().upper())
    assert volume(*read_mesh(shouted)) == pytest.approx(0.001, rel=1e-5)


def test_stl_in_words_that_is_cut_off(tmp_path: Path) -> None:
    path = tmp_path / "cut.stl"
    TETRAHEDRON.export(path, file_type="stl_ascii")
    text = path.read_text()
    path.write_text(text[: text.index("endsolid")])
    assert "12 corners in 4 finished triangles, and no 'endsolid'" in message(path)
    path.write_text(text[: text.rindex("vertex")])
    assert "11 corners in 3 finished triangles" in message(path)
    path.write_text(text.replace("vertex", "vertx", 1))
    assert "11 corners in 4 finished triangles" in message(path)


# A square of side 2 with a notch in its upper edge, 2.2 square metres.
NOTCHED = "0 0 0 2 0 0 2 2 0 1 0.2 0 0 2 0"


def area(vertices: np.ndarray, faces: np.ndarray) -> float:
    return LinkMesh.from_triangles(vertices, faces).area


@pytest.mark.parametrize("face", ["1 2 3 4 5", "-5 -4 -3 -2 -1", "4/1/1 5//2 1 \\\n2/7 3 # end"])
def test_obj_polygons_that_are_not_convex(tmp_path: Path, face: str) -> None:
    corners = np.array(NOTCHED.split()).reshape(-1, 3)
    lines = ["mtllib none.mtl", "o a", *(f"v {' '.join(corner)}" for corner in corners)]
    path = tmp_path / "notched.obj"
    path.write_text("\n".join([*lines, "vn 0 0 1", "usemtl x", f"f {face}", ""]))
    assert area(*read_mesh(path)) == pytest.approx(2.2)


def test_obj_faces_of_vertices_that_are_not_there(tmp_path: Path) -> None:
    path = tmp_path / "short.obj"
    for face in ("1 2 4", "1 2 -4", "0 1 2"):
        path.write_text(f"v 0 0 0\nv 1 0 0\nv 1 1 0\nf {face}\n")
        assert "a face names a vertex that is not among the 3 of the file" in message(path)


def collada(asset: str = "", nodes: str | None = None, before: str = "") -> str:
    nodes = nodes or '<node><instance_geometry url="#g"/></node>'
    return f"""<?xml version="1.0"?>{before}
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset>{asset}</asset>
<library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="pa" count="12">0 0 0 1 0 0 0 2 0 0 0 3</float_array>
<technique_common><accessor source="#pa" count="4" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<polylist count="4" material="paint"><input semantic="VERTEX" source="#v" offset="0"/>
<vcount>3 3 3 3</vcount><p>0 2 1 0 1 3 1 2 3 0 3 2</p></polylist>
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s">{nodes}</visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>"""


def read_collada(tmp_path: Path, text: str) -> tuple[np.ndarray, np.ndarray]:
    path = tmp_path / "shape.dae"
    path.write_text(text)
    return read_mesh(path)


def test_collada_units_are_metres(tmp_path: Path) -> None:
    text = collada('<unit name="millimeter" meter="0.001"/><up_axis>Z_UP</up_axis>')
    vertices, _ = read_collada(tmp_path, text)
    np.testing.assert_allclose(vertices.max(axis=0), [0.001, 0.002, 0.003])


@pytest.mark.parametrize("axis", ["X_UP", "Y_UP", "Z_UP"])
def test_collada_up_axis_leaves_coordinates_alone_as_in_rviz(tmp_path: Path, axis: str) -> None:
    vertices, _ = read_collada(tmp_path, collada(f"<up_axis>{axis}</up_axis>"))
    np.testing.assert_allclose(vertices.max(axis=0), [1, 2, 3])


def test_collada_scene_graph_is_applied(tmp_path: Path) -> None:
    nodes = """<node><translate>10 0 0</translate>
      <node><rotate>0 0 1 90</rotate><scale>2 2 2</scale><instance_geometry url="#g"/></node>
      </node><node><matrix>-1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1</matrix>
      <instance_geometry url="#g"/></node>"""
    vertices, faces = read_collada(tmp_path, collada(nodes=nodes))
    # Turned: (x, y) -> (-y, x), doubled, moved by 10; and a mirrored copy with x -> -x.
    np.testing.assert_allclose(extent(vertices), [[-1, 0, 0], [10, 2, 6]], atol=1e-6)
    # Both look outwards, the mirrored one too: 8 times the volume of 1, and 1 more.
    assert volume(vertices, faces) == pytest.approx(9.0, rel=1e-6)


def test_collada_with_a_broken_material_keeps_its_shape(tmp_path: Path) -> None:
    nodes = """<node><instance_geometry url="#g"><bind_material><technique_common>
      <instance_material symbol="paint" target="#nowhere"/></technique_common></bind_material>
      </instance_geometry></node>"""
    _, faces = read_collada(tmp_path, collada(nodes=nodes))
    assert len(faces) == 4


def test_collada_with_entities_is_refused(tmp_path: Path) -> None:
    text = collada(before='<!DOCTYPE COLLADA [<!ENTITY a "x">]>')
    with pytest.raises(InputError, match="document type declaration"):
        read_collada(tmp_path, text)


@pytest.mark.parametrize(
    "primitive",
    [
        '<polylist count="1">INPUT<vcount>5</vcount><p>0 1 2 3 4</p></polylist>',
        '<polygons count="1">INPUT<p>0 1 2 3 4</p></polygons>',
        '<polygons count="2">INPUT<p>0 1 3 4</p><p>1 2 3</p></polygons>',
    ],
)
def test_collada_polygons_that_are_not_convex(tmp_path: Path, primitive: str) -> None:
    text = collada().replace("0 0 0 1 0 0 0 2 0 0 0 3", NOTCHED).replace('"4" stride', '"5" stride')
    text = text.replace('count="12"', 'count="15"')
    source = '<input semantic="VERTEX" source="#v" offset="0"/>'
    polygons = re.sub(
        r"<polylist.*</polylist>", primitive.replace("INPUT", source), text, flags=re.DOTALL
    )
    assert area(*read_collada(tmp_path, polygons)) == pytest.approx(2.2)


def test_collada_polygons_with_holes_are_refused(tmp_path: Path) -> None:
    holes = collada().replace(
        "</polylist>", "</polylist><polygons><ph><p>0 1 2</p></ph></polygons>"
    )
    with pytest.raises(InputError, match=r"polygons with holes.*Export it with triangles"):
        read_collada(tmp_path, holes)


def test_glb_scene_graph_is_applied(tmp_path: Path) -> None:
    scene = trimesh.Scene()
    mirror = np.diag([-1.0, 1.0, 1.0, 1.0])
    mirror[:3, 3] = [5, 0, 0]
    scene.add_geometry(TETRAHEDRON, transform=mirror)
    scene.export(tmp_path / "shape.glb")
    vertices, faces = read_mesh(tmp_path / "shape.glb")
    np.testing.assert_allclose(extent(vertices), [[4.9, 0, 0], [5, 0.2, 0.3]], atol=1e-6)
    assert volume(vertices, faces) == pytest.approx(0.001, rel=1e-5)


def message(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        read_mesh(path)
    assert path.name in str(caught.value)
    return str(caught.value)


def test_files_that_are_no_meshes(tmp_path: Path) -> None:
    unknown = tmp_path / "shape.step"
    unknown.write_text("ISO-10303-21;")
    assert "mesh format '.step' is not known" in message(unknown)
    cut = tmp_path / "cut.stl"
    cut.write_bytes(b"\0" * 80 + struct.pack("<I", 100) + b"\0" * 50)
    assert "134 bytes, but its header promises 100 triangles" in message(cut)
    for name, what in (("r.dae", "not valid XML"), ("r.glb", "mesh cannot be read")):
        rubbish = tmp_path / name
        rubbish.write_bytes(b"\x01\x02 rubbish")
        assert what in message(rubbish)
    unfinished = tmp_path / "unfinished.dae"
    unfinished.write_text(collada()[:-20])
    assert "mesh cannot be read" in message(unfinished)


def test_empty_meshes_and_numbers_that_are_none(tmp_path: Path) -> None:
    empty = tmp_path / "empty.stl"
    empty.write_bytes(b"\0" * 84)
    assert "The mesh is empty" in message(empty)
    (tmp_path / "empty.dae").write_text(collada(nodes="<node/>"))
    assert "The mesh is empty" in message(tmp_path / "empty.dae")
    (tmp_path / "points.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\n")
    assert "mesh" in message(tmp_path / "points.obj")
    nan = tmp_path / "nan.stl"
    nan.write_text(
        "solid s\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex nan 0 0\nvertex 0 1 0\n"
        "endloop\nendfacet\nendsolid s\n"
    )
    assert "not finite" in message(nan)
