"""Models in COLLADA files: faces of every kind, placed by nodes, with units, axes and lines of faults."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from flowsculpt.pipeline.errors import MeshError
from flowsculpt.pipeline.mesh import PolygonMesh
from flowsculpt.pipeline.mesh.read import ModelFile, repair_surface
from flowsculpt.pipeline.plugins.interchange.collada_files import read_collada

CORNERS = " ".join(f"{x} {y} {z}" for x in (-1, 1) for y in (-1, 1) for z in (-1, 1))
QUADS = "0 1 3 2  4 6 7 5  0 4 5 1  2 3 7 6  0 2 6 4  1 5 7 3"
SIDES = '<polylist count="6"><input semantic="VERTEX" source="#v" offset="0"/><vcount>4 4 4 4 4 4</vcount>'
BOX = f"{SIDES}<p>{QUADS}</p></polylist>"
NODE = '<node><instance_geometry url="#box"/></node>'


def document(
    faces: str = BOX, nodes: str = NODE, asset: str = "", points: str = CORNERS, more: str = ""
) -> str:
    """Return a file with one geometry, `box`, whose vertices are `v`, and a scene of nodes."""
    count = len(points.split())
    return f"""<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1"><asset>{asset}</asset>
<library_geometries><geometry id="box"><mesh>
<source id="s"><float_array id="f" count="{count}">{points}</float_array><technique_common>
<accessor source="#f" count="{count // 3}" stride="3">
<param name="X"/><param name="Y"/><param name="Z"/></accessor>
</technique_common></source><vertices id="v"><input semantic="POSITION" source="#s"/></vertices>
{faces}
</mesh></geometry></library_geometries>{more}
<library_visual_scenes><visual_scene id="scene">{nodes}</visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#scene"/></scene></COLLADA>"""


def mesh_of(text: str) -> PolygonMesh:
    return repair_surface(read_collada(text.encode()), repair=False)[0]


def volume(mesh: PolygonMesh) -> float:
    a, b, c = mesh.triangulated().vertices[mesh.triangulated().faces].transpose(1, 0, 2)
    return float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6.0


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
@pytest.mark.parametrize(
    ("axis", "up", "turned"), [("Y", "y", (0, 5, 0)), ("Z", "z", (0, 5, 0)), ("X", "y", (-5, 0, 0))]
)
def test_polygons_unit_and_axis_are_those_of_the_file(
    tmp_path: Path, axis: str, up: str, turned: tuple[int, ...], encoding: str
) -> None:
    asset = f'<unit name="inch" meter="0.0254"/><up_axis>{axis}_UP</up_axis>'
    text = document(asset=asset, nodes=f"<node><translate>0 5 0</translate>{NODE}</node>")
    path = tmp_path / "box.dae"
    path.write_bytes(
        text.replace('version="1.0"', f'version="1.0" encoding="{encoding[:6]}"').encode(encoding)
    )
    read = ModelFile(path).surface()
    assert read.faces == 6 and np.diff(read.mesh.offsets).tolist() == [4] * 6 and read.repairs == ()
    assert read.unit == 0.0254 and ModelFile(path).up() == ModelFile(path).files().up == up
    assert read.mesh.bounds.mean(axis=0).tolist() == list(turned) and volume(read.mesh) == pytest.approx(8.0)


@pytest.mark.parametrize("length", ["0", "inf", "nan", "-1", "a foot"])
def test_a_unit_that_is_no_length_is_not_known(length: str) -> None:
    assert read_collada(document(asset=f'<unit meter="{length}"/>').encode()).unit is None


def faces(kind: str, *lists: str, count: int | None = None, stride: int = 1) -> str:
    """Return a set of faces; with a stride of 2 the corners have normals."""
    inputs = '<input semantic="VERTEX" source="#v" offset="0"/>'
    if stride == 2:
        inputs += '<input semantic="NORMAL" source="#n" offset="1"/>'
    texts = "".join(f"<p>{text}</p>" for text in lists)
    return f'<{kind} count="{len(lists) if count is None else count}">{inputs}{texts}</{kind}>'


@pytest.mark.parametrize(
    ("given", "sides"),
    [
        (faces("triangles", "0 1 3 0 3 2 4 6 7 4 7 5", count=4), [3] * 4),
        (faces("polygons", "0 1 3 2", "0 4 5 1", "0 2 6"), [4, 4, 3]),
        (faces("polygons", "0 9 1 9 3 9 2 9", stride=2), [4]),
        (faces("tristrips", "0 1 2 3 6 7", "4 5 0 1"), [3] * 6),
        (faces("trifans", "0 1 3 2", "7 5 4 6"), [3] * 4),
        (faces("triangles", count=0) + faces("lines", "0 1") + faces("polygons", "0 1 3 2"), [4]),
    ],
)
def test_every_kind_of_face_is_read(given: str, sides: list[int]) -> None:
    mesh = mesh_of(document(given))
    assert np.diff(mesh.offsets).tolist() == sides
    # the face at x = -1 looks that way, and so on: all are faces of the box, outwards
    centres = np.add.reduceat(mesh.vertices[mesh.corners], mesh.offsets[:-1]) / np.diff(mesh.offsets)[:, None]
    first, second, third = (mesh.vertices[mesh.corners[mesh.offsets[:-1] + k]] for k in range(3))
    assert (np.einsum("ij,ij->i", np.cross(second - first, third - second), centres) > 0.0).all()


def test_nodes_instances_and_mirrors_place_a_mesh() -> None:
    nodes = """<node><translate>10 0 0</translate><rotate>0 0 1 90</rotate><scale>1 2 1</scale>
        <instance_geometry url="#box"/></node>
        <node><matrix>-1 0 0 30  0 1 0 0  0 0 1 0  0 0 0 1</matrix><instance_node url="#part"/></node>
        <node><lookat>50 0 0  0 0 0  0 1 0</lookat><node><translate>0 0 -3</translate>
        <instance_geometry url="#box"/></node></node>"""
    library = f'<library_nodes><node id="part"><translate>0 9 0</translate>{NODE}</node></library_nodes>'
    read = read_collada(document(nodes=nodes, more=library).encode())
    low = read.points.reshape(3, 8, 3).min(axis=1)
    assert np.allclose(low, [(8, -1, -1), (29, 8, -1), (46, -1, -1)])
    mesh = mesh_of(document(nodes=nodes, more=library))
    assert len(mesh) == 18 and volume(mesh) == pytest.approx(8.0 * 4.0)


def test_edges_between_materials_and_meshes_are_creases() -> None:
    quads = QUADS.split("  ")
    first, rest = faces("polygons", quads[0]), faces("polygons", *quads[1:])
    parted = document(first.replace("<polygons", '<polygons material="red"') + rest)
    assert len(mesh_of(document(first + rest)).creases) == 0 and len(mesh_of(parted).creases) == 4


def test_a_skinned_mesh_is_read_as_it_was_bound_with_a_note() -> None:
    more = '<library_controllers><controller id="c"><skin source="#box"/></controller></library_controllers>'
    read = read_collada(document(nodes='<node><instance_controller url="#c"/></node>', more=more).encode())
    assert len(read.offsets) == 7 and "1 mesh would be moved by a skeleton" in read.notes[0]


DOUBLED = "".join(f'<node id="n{k}">{2 * f"""<instance_node url="#n{k + 1}"/>"""}</node>' for k in range(30))
"""Nodes that place the next one twice each: 2^30 of the last."""


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (document(faces("polygons", "0 1 3 20")), "line 8: face 0 names vertex 20; there are 8"),
        (document(faces("polygons", "0 1 x 2")), "line 8: .* is not an integer"),
        (document(points=CORNERS.replace("1 1 1", "1 1 one")), "line 4: one is not a number"),
        (document(points="0 0 0").replace('count="1"', 'count="8"'), "line 5: its accessor asks for 8"),
        (document(faces("triangles", "0 1 3", count=7)), "line 8: its triangles promise 7; there are 1"),
        (document(BOX.replace("4 4 4</v", "4 4 5</v")), "line 8: vcount asks for 25 corners"),
        (document("<polygons><ph><p>0 1 3 2</p><h>0 1 3</h></ph></polygons>"), "a polygon has holes"),
        (
            document(nodes='<node><instance_geometry url="#cup"/></node>'),
            "a missing geometry, '#cup'",
        ),
        (document(nodes='<node><instance_geometry url="b.dae#x"/></node>'), "'b.dae#x', in another file"),
        (document(nodes='<node id="n"><instance_node url="#n"/></node>'), "nodes that refer to each other"),
        (document(nodes="<node><skew>0 0 0 0 0 0 0</skew></node>"), "skew transform, which is not supported"),
        (document(nodes=f'{DOUBLED}<node id="n30"/>'), "over 50000 nodes with instances"),
        (document(nodes=""), "it has no mesh"),
        ("<svg/>", "its XML is 'svg', not COLLADA"),
        ('<!DOCTYPE x [<!ENTITY a "bbb">]><COLLADA>&a;</COLLADA>', "line 1: it declares the entity 'a'"),
        ("<COLLADA>" + "<a>" * 600, "elements are nested over 500 deep"),
        (document()[:900], r"cannot be read as DAE \((no element found|unclosed token)"),
    ],
)
def test_what_contradicts_itself_or_is_not_read_is_told_with_its_line(
    tmp_path: Path, text: str, says: str
) -> None:
    path = tmp_path / "a.dae"
    path.write_text(text)
    with pytest.raises(MeshError, match=says) as told:
        ModelFile(path).surface()
    assert str(told.value).startswith(str(path)) and "\n" not in str(told.value)
