"""The commands that export animations with one mesh: files by name, kept while current, refused in a line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from flowsculpt.pipeline.plugins.interchange import gltf_content, vertex_textures
from flowsculpt.pipeline.plugins.interchange.gltf_document import GltfDocument
from flowsculpt.render.graphics import three_js
from tests.conftest import commanded
from tests.full_disk import disk_of
from tests.needed_plugins import needs_plugins, shot_rows
from tests.simulated_show import simulated

NAME = "T010_tiny"
SHOT = """\
title: A box, twisted
frames: 1-6
subject: {solid: box, size: [2, 2, 2]}
resample: {max_edge_length: 0.5}
flows: [twist: {axis: y, amount: {ease: linear, keys: {1: 0, 6: 250}}}]
"""
TWO = """\
title: Two boxes
frames: 1-3
subjects:
  left: {solid: box, size: [2, 2, 2], look: clay}
  right: {solid: icosphere, radius: 1, look: chrome}
resample: {max_edge_length: 0.5}
flows: [twist: {axis: y, amount: {ease: linear, keys: {1: 0, 3: 90}}}]
"""
FILES = {
    "gltf": ("models", [f"{NAME}.glb"]),
    "vat": ("vat", [f"{NAME}.{end}" for end in ("glb", "positions.exr", "normals.png", "json")]),
    "web": ("web", [f"{NAME}.html"]),
}


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("animations")
    simulated(root, SHOT)
    return root


def export(root: Path, *words: str) -> Any:
    """Run a command; return what it reports."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(root)
        code, said = commanded(root, "export", *words, "--json")
    assert code == 0, said
    return json.loads(said)


def refused(root: Path, *words: str) -> str:
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(root)
        code, said = commanded(root, "export", *words)
    assert code in (2, 4) and "\n" not in said, said
    return said


@pytest.mark.parametrize("form", FILES)
def test_files_are_written_once_and_again_where_they_are_damaged(root: Path, form: str) -> None:
    if form == "web" and not three_js.installed_file().exists():
        pytest.skip("three.js is not set up here")
    folder, names = FILES[form]
    report = export(root, form, NAME)
    assert sorted(report["written"]) == sorted(names)
    place = root / "renders" / NAME / folder
    assert report["bytes"] == sum((place / name).stat().st_size for name in names)
    assert export(root, form, NAME)["written"] == []
    whole = (place / names[-1]).read_bytes()
    (place / names[-1]).write_bytes(whole[:20])
    assert names[-1] in export(root, form, NAME)["written"]
    assert (place / names[-1]).read_bytes() == whole
    less = export(root, form, NAME, "--vertices", "320", "-f", "2-5", "-o", str(root / "less"))
    assert less["subjects"][0]["vertices"] == 320 and less["subjects"][0]["frames"] == [2, 3, 4, 5]


def test_an_alembic_file_is_written_by_its_own_process_and_kept(root: Path) -> None:
    report = export(root, "abc", NAME)
    assert report["written"] == [f"{NAME}.abc"]
    assert report["bytes"] == (root / "renders" / NAME / "models" / f"{NAME}.abc").stat().st_size
    assert export(root, "abc", NAME)["written"] == []


def test_a_compressed_file_is_written_with_a_word_on_programs_that_lack_the_compression(
    root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(root)
    for options, says in (((), True), (("--plain",), False)):
        code, said = commanded(root, "export", "gltf", NAME, "-o", str(root / "words"), *options)
        content = (root / "words" / f"{NAME}.glb").read_bytes()
        assert code == 0
        assert (
            (b"EXT_meshopt_compression" in content)
            == ("--plain writes one for every program" in said)
            == says
        )


def test_a_dry_run_says_what_would_be_refined_and_writes_nothing(root: Path, tmp_path: Path) -> None:
    report = export(root, "gltf", NAME, "--dry-run", "-o", str(tmp_path / "there"), "--set", "rate=12")
    assert report["refining"] == {NAME: 0} or report["refining"][NAME] <= 6
    assert not (tmp_path / "there").exists()


def test_several_subjects_are_one_file_for_players_and_textures_for_each(tmp_path: Path) -> None:
    simulated(tmp_path, TWO)
    export(tmp_path, "gltf", NAME)
    tree = GltfDocument.read(tmp_path / "renders" / NAME / "models" / f"{NAME}.glb").root.values
    assert [node["name"] for node in tree["nodes"]] == ["left", "right"]
    metals = [material["pbrMetallicRoughness"]["metallicFactor"] for material in tree["materials"]]
    assert metals == [0.0, 1.0] and len(tree["animations"]) == 1
    assert len(tree["animations"][0]["channels"]) == 2
    reports = export(tmp_path, "vat", NAME)
    assert [Path(report["path"]).name for report in reports] == [f"{NAME}.left.glb", f"{NAME}.right.glb"]
    report = export(tmp_path, "gltf", NAME, "--subject", "right")
    assert Path(report["path"]).name == f"{NAME}.right.glb"


def test_what_a_format_cannot_hold_is_refused_in_a_line(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    there = ("-o", str(root / "refused"))
    monkeypatch.setattr(gltf_content, "_LARGEST_FILE", 1000)
    assert "GB; use fewer frames, or --vertices" in refused(root, "gltf", NAME, *there)
    monkeypatch.setattr(vertex_textures, "LARGEST", 16)
    assert "rows of 16, and engines read" in refused(root, "vat", NAME, *there)
    assert "frames 1-2,4 are not evenly spaced" in refused(root, "vat", NAME, "-f", "1-2,4", *there)
    monkeypatch.setattr(three_js, "installed_file", lambda: root / "three.js")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(root)
        code, said = commanded(root, "export", "web", NAME, *there)
    assert code == 3 and "three.js is not installed, so no page was written" in said
    assert not [path for path in (root / "refused").glob("*") if "keys" not in path.name]


CROWD = """\
def crowd(points, time, dt):
    return points + dt * (points - points.mean(axis=0))
"""
CORNERED = """\
mtllib a.mtl
v -1 -1 -1
v 1 -1 -1
v 0 1 -1
v 0 0 1
vt 0 0
vt 1 0
vt 0 1
usemtl m
f 1/1 3/2 2/3
f 1/1 2/2 4/3
f 2/1 3/2 4/3
f 3/1 1/2 4/3
"""
BOX, EDGE, TWIST = "{solid: box, size: [2, 2, 2]}", "max_edge_length: 0.5", SHOT[SHOT.index("twist:") : -2]


@needs_plugins("python")
@pytest.mark.parametrize(
    ("old", "new", "code", "says"),
    [
        *shot_rows(
            [
                (
                    TWIST,
                    "python: {file: crowd.py, function: crowd}",
                    1,
                    "moves a point alone elsewhere than among",
                ),
                (
                    EDGE,
                    f"{EDGE}, method: polyhedra",
                    2,
                    "polyhedra cuts other faces in each frame; write method",
                ),
            ]
        ),
        (EDGE, f"{EDGE}, placement: chord", 2, "chord puts new vertices beside the surface"),
        (EDGE, f"{EDGE}, max_vertices: 150", 1, "of one mesh for all frames up to here; raise max_vertices"),
        ("flows", "look: {material: clay, colour: {file: gone.png}}\nflows", 2, "file gone.png is not there"),
        (
            BOX,
            "{model: a.obj, paint: on}\nlook: model",
            3,
            "it names its texture gone.png, which is not there",
        ),
    ],
)
def test_a_shot_without_one_mesh_or_a_picture_is_refused_in_a_line(
    old: str, new: str, code: int, says: str, tmp_path: Path, monkeypatch: Any
) -> None:
    shots = tmp_path / "shots"
    shots.mkdir()
    assert old in SHOT
    (shots / f"{NAME}.yaml").write_text(SHOT.replace(old, new, 1))
    (shots / "crowd.py").write_text(CROWD)
    (shots / "a.obj").write_text(CORNERED)
    (shots / "a.mtl").write_text("newmtl m\nmap_Kd gone.png\n")
    monkeypatch.chdir(tmp_path)
    found, said = commanded(tmp_path, "export", "gltf", NAME, "--allow-code")
    assert (found, "\n" in said) == (code, False) and says in said, said
    assert not list(tmp_path.rglob("*.glb"))


def test_a_full_disk_is_one_message_and_leaves_no_half_file(root: Path, tmp_path: Path) -> None:
    export(root, "gltf", NAME)  # its mesh is stored
    with disk_of(4000):
        said = refused(root, "gltf", NAME, "--plain", "-o", str(tmp_path))
    assert f"{tmp_path / NAME}.glb: cannot be written: the file is larger than" in said
    assert list(tmp_path.iterdir()) == []
