"""Models in FBX files are what other programs show: polygons, placed, with units, axes and creases."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flowsculpt.pipeline.errors import MachineError, MeshError
from flowsculpt.pipeline.mesh import PolygonMesh
from flowsculpt.pipeline.mesh.read import ModelFile, repair_surface
from flowsculpt.pipeline.plugins.authoring.shot_templates import model_template
from flowsculpt.pipeline.plugins.interchange import scene_readers
from flowsculpt.pipeline.plugins.interchange.fbx_files import up_axis, visible_surface
from tests.plugins.interchange.fbx_writer import (
    CORNERS,
    SIDES,
    N,
    binary,
    box_geometry,
    layer,
    model,
    scene,
    text,
)

LINKED = [(2, 0), (1, 2)]
"""A geometry 1 of a node 2, which is below the root."""


def write(path: Path, nodes: list[N], form: Callable[[list[N]], bytes] = binary) -> Path:
    path.write_bytes(form(nodes))
    return path


def mesh_of(nodes: list[N]) -> PolygonMesh:
    """Return the mesh of a scene, read in this process, not repaired."""
    return repair_surface(visible_surface(binary(nodes)), repair=False)[0]


def volume(mesh: PolygonMesh) -> float:
    a, b, c = mesh.triangulated().vertices[mesh.triangulated().faces].transpose(1, 0, 2)
    return float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6.0


@pytest.mark.slow
@pytest.mark.parametrize("form", [text, binary])
def test_quads_stay_quads_in_text_and_binary_files(tmp_path: Path, form: Any) -> None:
    box = scene([box_geometry(1), model(2, "box")], LINKED, UpAxis=2, FrontAxis=1, FrontAxisSign=-1,
                CoordAxis=0, CoordAxisSign=1, UnitScaleFactor=2.54)  # fmt: skip
    path = write(tmp_path / "box.fbx", box, form)
    read = ModelFile(path).surface()
    assert read.faces == 6 and read.vertices == 8 and read.repairs == ()
    assert np.diff(read.mesh.offsets).tolist() == [4] * 6
    assert read.mesh.bounds.tolist() == [[-1.0] * 3, [1.0] * 3], "coordinates are those of the file"
    assert volume(read.mesh) == pytest.approx(8.0)
    assert read.unit == pytest.approx(0.0254) and ModelFile(path).up() == "z" == ModelFile(path).files().up
    template = model_template(path, "box.fbx")
    assert "of 0.0254 m" in template.facts[0] and "z points up, which is heeded" in template.facts[1]
    assert "up:" not in template.subject, "the file states it"


@pytest.mark.parametrize("line_end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_text_of_other_systems_is_read_and_an_impossible_unit_is_none(
    tmp_path: Path, encoding: str, line_end: str
) -> None:
    nodes = scene([box_geometry(1), model(2, "box")], LINKED, UnitScaleFactor=0.0)
    path = write(
        tmp_path / "box.fbx",
        nodes,
        lambda given: text(given).decode().replace("\n", line_end).encode(encoding),
    )
    read = ModelFile(path).surface()
    assert read.faces == 6 and read.unit is None and ModelFile(path).up() == "y"


def test_nodes_pivots_and_geometric_transforms_place_a_mesh() -> None:
    node = model(2, "box", Lcl__Translation=(10.0, 0.0, 0.0), Lcl__Rotation=(0.0, 0.0, 90.0),
                 RotationPivot=(1.0, 0.0, 0.0), Lcl__Scaling=(1.0, 2.0, 1.0),
                 GeometricTranslation=(0.0, 0.0, 5.0), RotationActive=1)  # fmt: skip
    above = model(3, "above", "Null", Lcl__Translation=(0.0, 100.0, 0.0))
    low, high = mesh_of(scene([box_geometry(1), node, above], [(3, 0), (2, 3), (1, 2)])).bounds
    # about the pivot at x = 1, x becomes y and y becomes -x: the box spans 11 ± 2, 99 ± 1, 5 ± 1
    assert np.allclose((low, high), ((9.0, 98.0, 4.0), (13.0, 100.0, 6.0)))


def test_a_mirrored_instance_faces_outwards_too() -> None:
    nodes = [model(2, "a"), model(3, "b", Lcl__Translation=(5.0, 0.0, 0.0), Lcl__Scaling=(-1.0, 1.0, 1.0))]
    mesh = mesh_of(scene([box_geometry(1), *nodes], [(2, 0), (3, 0), (1, 2), (1, 3)]))
    assert len(mesh) == 12 and volume(mesh) == pytest.approx(16.0)


@pytest.mark.parametrize(
    ("axes", "up", "top"),
    [
        ((1, 1, 2, 1, 0, 1), "y", (0.0, 9.0, 0.0)),
        ((2, 1, 1, -1, 0, 1), "z", (0.0, 9.0, 0.0)),
        ((0, 1, 2, 1, 1, -1), "y", (-9.0, 0.0, 0.0)),
        ((2, -1, 1, 1, 0, 1), "y", (0.0, 0.0, 9.0)),
    ],
)
def test_axes_other_than_y_and_z_up_are_turned_to_y_up(axes: Any, up: str, top: Any) -> None:
    names = ("UpAxis", "UpAxisSign", "FrontAxis", "FrontAxisSign", "CoordAxis", "CoordAxisSign")
    node = model(2, "box", Lcl__Translation=(0.0, 9.0, 0.0))
    nodes = scene([box_geometry(1), node], LINKED, **dict(zip(names, axes, strict=True)))
    assert up_axis(binary(nodes)) == up and volume(mesh_of(nodes)) == pytest.approx(8.0)
    assert mesh_of(nodes).bounds.mean(axis=0).tolist() == list(top)


def test_materials_weights_and_hard_edges_amid_smooth_ones_are_creases() -> None:
    materials = layer("LayerElementMaterial", "ByPolygon", "Materials", [1, 0, 0, 0, 0, 0])
    edges = N("Edges", (list(range(4)),))  # those of the first face
    hard = layer("LayerElementSmoothing", "ByEdge", "Smoothing", [0, 1, 1, 1])
    weight = layer("LayerElementEdgeCrease", "ByEdge", "EdgeCrease", [0.0, 0.5, 0.0, 0.0])
    parts = [N("Material", (number, f"Material::{number}", "")) for number in (8, 9)]

    def creases(*layers: N) -> int:
        objects = [box_geometry(1, *layers), model(2, "box"), *parts]
        return len(mesh_of(scene(objects, [*LINKED, (8, 2), (9, 2)])).creases)

    assert creases() == 0 and creases(materials) == 4
    assert creases(edges, hard) == 1 and creases(edges, weight) == 1 and creases(edges, hard, weight) == 2
    all_hard = layer("LayerElementSmoothing", "ByEdge", "Smoothing", [0, 0, 0, 0])
    assert creases(edges, all_hard) == 0, "a model shaded flat says nothing about its edges"


def test_edges_that_part_normals_are_creases_where_others_do_not() -> None:
    flat = [n for axis in (0, 0, 1, 1, 2, 2) for n in 4 * [[float(k == axis) for k in range(3)]]]
    flat = [[-x for x in n] if (k // 4) % 2 == 0 else n for k, n in enumerate(flat)]
    round_ = [[c / 3**0.5 for c in CORNERS[corner]] for side in SIDES for corner in side]

    def creases(normals: list[list[float]]) -> int:
        layers = layer("LayerElementNormal", "ByPolygonVertex", "Normals", [x for n in normals for x in n])
        return len(mesh_of(scene([box_geometry(1, layers), model(2, "box")], LINKED)).creases)

    assert creases(round_) == 0
    assert creases([*flat[:4], *round_[4:]]) == 4, "the first side stands apart"
    assert creases(flat) == 0, "a model shaded flat says nothing about its edges"


def test_hidden_meshes_are_left_out_with_a_note_and_holes_too() -> None:
    shown, hidden = model(2, "a"), model(3, "b", Visibility=0.0, Lcl__Translation=(9.0, 0.0, 0.0))
    read = visible_surface(binary(scene([box_geometry(1), shown, hidden], [(2, 0), (3, 0), (1, 2), (1, 3)])))
    assert len(read.offsets) == 7 and "1 hidden mesh" in read.notes[0]
    holes = layer("LayerElementHole", "ByPolygon", "Hole", [0, 0, 1, 0, 0, 0])
    assert len(mesh_of(scene([box_geometry(1, holes), shown], LINKED))) == 5


def test_a_skinned_mesh_is_read_as_it_was_bound_with_a_note() -> None:
    skin = N("Deformer", (9, "Deformer::", "Skin"), [N("Link_DeformAcuracy", (50.0,))])
    read = visible_surface(binary(scene([box_geometry(1), model(2, "a"), skin], [*LINKED, (9, 1)])))
    assert len(read.offsets) == 7 and "1 mesh would be moved by a skeleton" in read.notes[0]


def test_of_levels_of_detail_the_first_is_read() -> None:
    group = N("NodeAttribute", (9, "NodeAttribute::", "LodGroup"), [N("TypeFlags", ("LodGroup",))])
    objects = [box_geometry(1), model(2, "chair", "LodGroup"), group, model(3, "near"), model(4, "far")]
    mesh = mesh_of(scene(objects, [(2, 0), (9, 2), (3, 2), (4, 2), (1, 3), (1, 4)]))
    assert len(mesh) == 6


def test_a_file_that_contradicts_itself_or_holds_no_mesh_is_refused(tmp_path: Path) -> None:
    bad = [box_geometry(1, sides=[*SIDES[:5], (1, 5, 70, 3)]), model(2, "chair")]
    with pytest.raises(ValueError, match="its numbers contradict each other"):
        visible_surface(binary(scene(bad, LINKED)))
    with pytest.raises(MeshError, match=r"empty\.fbx: it has no visible mesh"):
        ModelFile(write(tmp_path / "empty.fbx", scene([model(2, "a", "Null")], [(2, 0)]))).surface()


@pytest.mark.slow
def test_a_file_that_is_not_fbx_or_ends_early_is_refused(tmp_path: Path) -> None:
    content = binary(scene([box_geometry(1), model(2, "box")], LINKED))
    for number, damaged in enumerate((b"a chair", content[:500], b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")):
        path = tmp_path / f"{number}.fbx"
        path.write_bytes(damaged)
        with pytest.raises(MeshError, match="cannot be read as FBX"):
            ModelFile(path).surface()


def test_without_ufbx_one_line_says_how_to_install_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write(tmp_path / "box.fbx", scene([box_geometry(1), model(2, "box")], LINKED))
    monkeypatch.setattr(scene_readers, "find_spec", lambda name: None)
    for read in (ModelFile.surface, ModelFile.files):
        with pytest.raises(MachineError, match=r"install the extra \[models\].*pip install ufbx"):
            read(ModelFile(path))
