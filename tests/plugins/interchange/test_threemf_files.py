"""Models in 3MF packages: objects where the build places them, in their unit, of all model parts."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flowsculpt.pipeline.errors import MeshError
from flowsculpt.pipeline.mesh.read import ModelFile
from flowsculpt.pipeline.plugins.interchange.threemf_files import read_threemf
from flowsculpt.render.base.input_files import InputFile

RELATIONS = '<Relationships><Relationship Target="/3D/a.model" Type="http://x/3dmodel"/></Relationships>'
CORNERS = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
FACES = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]


def corner(number: int, faces: list[tuple[int, int, int]] = FACES, more: str = "", last: str = "") -> str:
    """Return an object: a tetrahedron of volume 1/6; `last` are attributes of its last triangle."""
    vertices = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in CORNERS)
    rows = [f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in faces]
    rows[-1] = rows[-1].replace("/>", f" {last}/>")
    triangles = "".join(rows)
    mesh = f"<mesh><vertices>{vertices}</vertices><triangles>{triangles}</triangles>{more}</mesh>"
    return f'<object id="{number}">{mesh}</object>'


def model_part(objects: str, items: str = '<item objectid="1"/>', given: str = "") -> str:
    return (
        f'<model xmlns="http://x/core/2015/02" xmlns:p="http://x/production/2015/06" {given}>\n'
        f"<resources>{objects}</resources>\n<build>{items}</build></model>"
    )


def package(path: Any, settings: tuple[str, str] | None = None, **parts: str) -> Any:
    """Write a package of model parts by name, `a` as the first, to a path or file; return which.

    settings  name and content of a slicer's file of settings
    """
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("_rels/.rels", RELATIONS)
        for name, content in parts.items():
            archive.writestr(f"3D/{name}.model", content)
        if settings is not None:
            archive.writestr(f"Metadata/{settings[0]}.config", f"<config>{settings[1]}</config>")
    return path


def volume(path: Path) -> float:
    mesh = ModelFile(path).surface().mesh.triangulated()
    a, b, c = mesh.vertices[mesh.faces].transpose(1, 0, 2)
    return float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6.0


@pytest.mark.parametrize(("given", "unit"), [("", 0.001), ('unit="inch"', 0.0254), ('unit="micron"', 1e-6)])
def test_triangles_unit_and_axis_are_those_of_the_package(tmp_path: Path, given: str, unit: float) -> None:
    path = package(tmp_path / "a.3mf", a=model_part(corner(1), given=given))
    read = ModelFile(path).surface()
    assert (read.vertices, read.faces, read.repairs, read.unit) == (4, 4, (), unit)
    assert ModelFile(path).up() == ModelFile(path).files().up == "z" and volume(path) == pytest.approx(1 / 6)


def test_items_and_components_of_other_parts_are_placed_and_mirrored(tmp_path: Path) -> None:
    pair = """<object id="2"><components>
        <component objectid="1" p:path="/3D/b.model" transform="1 0 0 0 1 0 0 0 1 10 0 0"/>
        <component objectid="1" p:path="/3D/b.model" transform="-2 0 0 0 2 0 0 0 2 0 0 0"/>
        </components></object>"""
    items = """<item objectid="2" transform="0 1 0 -1 0 0 0 0 1 0 0 5"/>
        <item objectid="3" transform="1 0 0 0 1 0 0 0 1 99 0 0"/>"""
    path = package(
        tmp_path / "a.3mf",
        a=model_part(pair + corner(3), items, 'requiredextensions="p"'),
        b=model_part(corner(1) + corner(7), items=""),
    )
    assert ModelFile(path).surface().faces == 12 and volume(path) == pytest.approx((1 + 8 + 1) / 6)
    low, high = ModelFile(path).surface().mesh.bounds
    assert np.allclose((low, high), ((-2, -2, 0), (100, 11, 7))), "x becomes y, y becomes -x"


def test_edges_between_materials_are_creases_and_supports_are_left_out(tmp_path: Path) -> None:
    plain, painted = corner(1), corner(1, last='pid="5" p1="2"')
    assert len(ModelFile(package(tmp_path / "a.3mf", a=model_part(plain))).surface().mesh.creases) == 0
    assert len(ModelFile(package(tmp_path / "b.3mf", a=model_part(painted))).surface().mesh.creases) == 3
    support = corner(2).replace('id="2"', 'id="2" type="support"')
    path = package(
        tmp_path / "c.3mf", a=model_part(plain + support, '<item objectid="1"/><item objectid="2"/>')
    )
    read = ModelFile(path).surface()
    assert read.faces == 4 and "1 support" in read.notes[0]


_TWO = '<object id="3"><components><component objectid="1"/><component objectid="2"/></components></object>'


@pytest.mark.parametrize(
    ("setting", "word"),
    [
        ("support_blocker", "support blocker"),
        ("support_enforcer", "support enforcer"),
        ("modifier_part", "modifier"),
        ("negative_part", "negative part"),
    ],
)
def test_parts_of_bambu_studio_that_are_no_part_of_the_shape_are_left_out(
    tmp_path: Path, setting: str, word: str
) -> None:
    listed = f'<object id="3"><part id="1" subtype="normal_part"/><part id="2" subtype="{setting}"/></object>'
    content = model_part(corner(1) + corner(2) + _TWO, '<item objectid="3"/>')
    path = package(tmp_path / "a.3mf", ("model_settings", listed), a=content)
    read = ModelFile(path).surface()
    assert read.faces == 4 and f"1 {word}" in read.notes[0]
    assert ("not subtracted" in read.notes[-1]) == (setting == "negative_part")
    assert ModelFile(path).files().digest != InputFile(path).digest(), "its meshes were stored with all parts"


@pytest.mark.parametrize(
    ("key", "value", "faces"),
    [
        ("volume_type", "ParameterModifier", 4),
        ("volume_type", "SupportBlocker", 4),
        ("volume_type", "NegativeVolume", 4),
        ("modifier", "1", 4),
        ("volume_type", "ModelPart", 8),
    ],
)
def test_volumes_of_prusa_slicer_that_are_no_part_of_the_shape_are_left_out(
    tmp_path: Path, key: str, value: str, faces: int
) -> None:
    second = f'<volume firstid="4" lastid="7"><metadata type="volume" key="{key}" value="{value}"/></volume>'
    listed = f'<object id="1"><volume firstid="0" lastid="3"/>{second}</object>'
    twice = corner(1, FACES + FACES)
    path = package(tmp_path / "a.3mf", ("Slic3r_PE_model", listed), a=model_part(twice))
    assert _faces_of(path) == faces


@pytest.mark.parametrize("name", ["infill_mesh", "support_mesh", "anti_overhang_mesh", "cutting_mesh"])
@pytest.mark.parametrize("value", ["True", "False"])
def test_meshes_of_cura_that_are_no_part_of_the_shape_are_left_out(
    tmp_path: Path, name: str, value: str
) -> None:
    setting = f'<metadatagroup><metadata name="cura:{name}">{value}</metadata></metadatagroup>'
    second = corner(2).replace('<object id="2">', f'<object id="2">{setting}')
    items = '<item objectid="1"/><item objectid="2" transform="1 0 0 0 1 0 0 0 1 9 0 0"/>'
    path = package(tmp_path / "a.3mf", a=model_part(corner(1) + second, items))
    assert _faces_of(path) == (4 if value == "True" else 8)


def _faces_of(path: Path) -> int:
    """Return the number of faces of a model, as its reader returns them."""
    return len(read_threemf(path.read_bytes()).offsets) - 1


def test_vertices_of_slices_and_lattices_are_no_vertices_of_the_mesh(tmp_path: Path) -> None:
    slices = '<s:slice xmlns:s="http://x/slice/"><s:vertex x="1" y="1"/></s:slice>'
    path = package(
        tmp_path / "a.3mf", a=model_part(slices + corner(1, more="<b:beamlattice xmlns:b='http://x/b'/>"))
    )
    read = ModelFile(path).surface()
    assert (read.vertices, read.faces) == (4, 4) and "1 beam lattice" in read.notes[0]


DOUBLED = "".join(
    f'<object id="{k}"><components>{2 * f"""<component objectid="{k + 1}"/>"""}</components></object>'
    for k in range(1, 30)
)
"""Objects that place the next one twice each: 2^29 of the last, which has no triangles."""

BEAMS = "http://schemas.microsoft.com/3dmanufacturing/beamlattice/2017/02"

LOOP = '<object id="1"><components><component objectid="1"/></components></object>'


@pytest.mark.parametrize(
    ("parts", "says"),
    [
        (
            {"a": model_part(corner(1, [*FACES[:3], (1, 2, 9)]))},
            "3D/a.model, line 2: face 3 names vertex 9",
        ),
        ({"a": model_part(corner(1).replace('y="1"', 'y="one"'))}, "3D/a.model, line 2: could not convert"),
        ({"a": model_part(corner(1).replace('y="1"', ""))}, "3D/a.model, line 2: vertex has no y"),
        (
            {"a": model_part(corner(1), '<item objectid="8"/>')},
            "3D/a.model, line 3: 3D/a.model has no object '8'",
        ),
        (
            {"a": model_part(corner(1), '<item objectid="1" transform="1 2"/>')},
            "its transform has 2 numbers, not 12",
        ),
        (
            {"a": model_part(corner(1), '<item objectid="1" p:path="/3D/c.model"/>')},
            "it has no part '3D/c.model'",
        ),
        ({"a": model_part(LOOP)}, "over 32 deep"),
        ({"a": model_part(f'{DOUBLED}<object id="30"/>')}, "over 50000 objects with components"),
        ({"a": model_part(corner(1), '<item objectid="1" p:path="\ufeff"/>')}, r"no part '\\ufeff'"),
        ({"a": model_part(corner(1), "")}, "its build has no triangles"),
        (
            {"a": model_part(corner(1).replace("<object", '<object type="support"'))},
            "its build has no triangles; left out, .*: 1 support",
        ),
        ({"a": model_part(corner(1), given='unit="mile"')}, "its unit 'mile' is not one of"),
        (
            {"a": model_part(corner(1), given='requiredextensions="s" xmlns:s="http://x/slice/2015/07"')},
            "it requires the extension 'http://x/slice/2015/07', which is not read",
        ),
        (
            {"a": model_part(corner(1), given=f'requiredextensions="b" xmlns:b="{BEAMS}"')},
            "it requires the extension 'beamlattice/2017/02', which is not read",
        ),
        (
            {"a": model_part('<object id="1"><booleanshape objectid="2"/></object>')},
            "its build has no triangles; left out, .*: 1 object without triangles",
        ),
        ({"a": '<!DOCTYPE x [<!ENTITY a "b">]><model/>'}, "it declares the entity 'a'"),
        (
            {"a": model_part(corner(1) + " " * (1 << 25))},
            "unpacks from .* to 33,554,894, which no model file does",
        ),
        ({"b": model_part(corner(1))}, "it has no part '3D/a.model'"),
        (
            {
                "a": model_part("", '<item objectid="1" p:path="/3D/b.model"/>'),
                "b": model_part(corner(1), given='unit="inch"'),
            },
            "3D/b.model: its unit is inch, and that of the package millimeter",
        ),
    ],
)
def test_what_is_not_read_is_told_with_its_part_and_line(
    tmp_path: Path, parts: dict[str, str], says: str
) -> None:
    path = package(tmp_path / "a.3mf", **parts)
    with pytest.raises(MeshError, match=says) as told:
        ModelFile(path).surface()
    assert str(told.value).startswith(str(path)) and "\n" not in str(told.value)


def test_parts_may_have_names_with_backslashes(tmp_path: Path) -> None:
    path = package(tmp_path / "a.3mf", a=model_part(corner(1)))
    path.write_bytes(path.read_bytes().replace(b"3D/a.model", rb"3D\a.model"))
    assert volume(path) == pytest.approx(1 / 6)


def test_a_file_that_is_no_package_is_refused(tmp_path: Path) -> None:
    empty = io.BytesIO()
    with zipfile.ZipFile(empty, "w"):
        pass
    whole = package(tmp_path / "a.3mf", a=model_part(corner(1))).read_bytes()
    for content in (b"a chair", whole[:-30], whole[:200], empty.getvalue()):
        (tmp_path / "b.3mf").write_bytes(content)
        with pytest.raises(MeshError, match=r"b\.3mf: (cannot be read as 3MF|it has no part)"):
            ModelFile(tmp_path / "b.3mf").surface()
