"""Vertex animation textures: the documented formula gives every vertex at every frame."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.mesh import icosphere
from flowsculpt.pipeline.plugins.interchange import vertex_textures
from flowsculpt.pipeline.plugins.interchange.drawn_mesh import DrawnMesh
from flowsculpt.pipeline.plugins.interchange.vertex_textures import Layout, VertexTextures
from flowsculpt.render.post.image import read_exr, read_png
from flowsculpt.render.scene.materials import LOOKS
from tests.plugins.interchange.moving_meshes import ball, moving, painted_box
from tests.plugins.interchange.node_programs import gltf_messages


def exported(place: Path, drawn: DrawnMesh) -> VertexTextures:
    textures = VertexTextures.of(drawn)
    textures.write_positions(place / "p.exr")
    textures.write_normals(place / "n.png")
    textures.write_mesh(place / "m.glb", LOOKS["clay"])
    textures.write_facts(place / "f.json", {"positions": "p.exr"})
    return textures


@pytest.mark.parametrize("columns", [8192, 100])
def test_textures_decoded_by_the_formula_are_the_mesh(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, columns: int
) -> None:
    monkeypatch.setattr(vertex_textures, "LARGEST", columns)
    for drawn in (
        (ball(frames=range(3, 12)), painted_box()) if columns > 100 else (ball(frames=range(3, 12)),)
    ):
        exported(tmp_path, drawn)
        facts = json.loads((tmp_path / "f.json").read_text())
        positions, normals = read_exr(tmp_path / "p.exr")[0].arrays["beauty"], read_png(tmp_path / "n.png")
        assert positions.shape == (facts["height"], facts["width"], 3) == normals.shape
        glb = trimesh.load(tmp_path / "m.glb", force="mesh", process=False)
        address = _coordinates(tmp_path / "m.glb")
        column = np.floor(address[:, 0] * facts["width"]).astype(int)
        for index in range(facts["frames"]):
            row = np.floor((address[:, 1] + index / facts["height"]) * facts["height"]).astype(int)
            points = np.array(facts["centre"]) + np.array(facts["extent"]) * positions[row, column]
            vectors = 2.0 * normals[row, column] / 255.0 - 1.0
            vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
            true, directions = drawn.frame(facts["first_frame"] + index)
            assert np.abs(points - true).max() < 0.02 * 0.3
            assert np.einsum("ij,ij->i", vectors, directions).min() > np.cos(np.radians(1.0))
            if index == 0:
                assert np.abs(glb.vertices - true).max() < 0.01 * 0.3
                assert np.array_equal(glb.faces, drawn.faces)
    assert gltf_messages(tmp_path / "m.glb") == []


def _coordinates(path: Path) -> np.ndarray:
    from flowsculpt.pipeline.plugins.interchange.gltf_document import GltfDocument

    document = GltfDocument.read(path)
    root, content = document.root.values, document.buffer(0)
    accessor = root["accessors"][root["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_1"]]
    view = root["bufferViews"][accessor["bufferView"]]
    return np.frombuffer(content, "<f4", 2 * accessor["count"], view["byteOffset"]).reshape(-1, 2)


def test_positions_far_finer_than_halves_are_floats(tmp_path: Path) -> None:
    drawn = ball(frames=range(1, 3), edge=0.001)
    assert exported(tmp_path, drawn).precision == "float"
    assert read_exr(tmp_path / "p.exr")[0].arrays["beauty"].dtype == np.float32


def test_frames_in_steps_have_a_lower_rate_and_uneven_ones_are_refused() -> None:
    mesh = moving(icosphere(2))
    assert VertexTextures.of(DrawnMesh.of(replace(mesh, frames=(1, 3, 5)))).rate == 12.0
    with pytest.raises(UsageError, match="frames 1-2,4 are not evenly spaced"):
        VertexTextures.of(DrawnMesh.of(replace(mesh, frames=(1, 2, 4))))


def test_a_mesh_with_more_vertices_than_a_texture_holds_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(vertex_textures, "LARGEST", 100)
    with pytest.raises(UsageError, match=r"642 vertices .* 24 frames take 168 rows .* use --vertices 400"):
        Layout.of(ball())


def test_textures_of_a_loop_say_that_they_loop(project):
    """The last frame of a loop is another one than the first, which follows it."""
    for settings, loops in (((), False), (("--set", "loop=true"), True)):
        done = project.call("export", "vat", "T010_tiny", *settings)
        assert done.code == 0, done.err
        facts = project.path / "renders" / "T010_tiny" / "vat" / "T010_tiny.json"
        assert json.loads(facts.read_text())["loops"] is loops
