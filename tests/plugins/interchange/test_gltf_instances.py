"""Rigid copies as nodes of a glTF file that share a mesh, and their animation."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from flowsculpt.pipeline.mesh.placed_copies import nearest_rotations
from flowsculpt.pipeline.mesh.read import read_mesh
from flowsculpt.pipeline.plugins.interchange.gltf_instances import quaternions
from flowsculpt.pipeline.plugins.interchange.one_mesh import OneMesh
from flowsculpt.pipeline.plugins.interchange.unifying import Unification
from flowsculpt.pipeline.production.execution.project import Project
from tests.conftest import commanded
from tests.plugins.interchange.test_usd import NAME
from tests.plugins.interchange.test_usd_instances import SHOT


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, OneMesh]:
    """The file, and the mesh of all copies."""
    root = tmp_path_factory.mktemp("gltf")
    (root / "shots").mkdir()
    (root / "shots" / f"{NAME}.yaml").write_text(SHOT)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(root)
        code, said = commanded(root, "export", "gltf", NAME, "--json", "--instances")
    assert code == 0, said
    project = Project(root, 1)
    request = project.request(root / "shots" / f"{NAME}.yaml", "draft")
    path = root / "renders" / NAME / "models" / f"{NAME}.instances.glb"
    return path, Unification(request.parts[0], project.store).one_mesh()


def test_other_readers_and_ours_find_the_copies_of_the_first_frame(made: tuple[Path, OneMesh]) -> None:
    path, mesh = made
    scene = trimesh.load(path)
    assert len(scene.graph.nodes_geometry) == 20
    for vertices in (scene.to_mesh().vertices, read_mesh(path).vertices):
        away = np.linalg.norm(vertices[:, None] - mesh.points_at(1)[None], axis=2).min(axis=1)
        assert away.max() < 1e-5


def test_nodes_are_moved_and_turned_as_the_copies_and_have_their_colours(made: tuple[Path, OneMesh]) -> None:
    path, mesh = made
    content = path.read_bytes()
    length = int.from_bytes(content[12:16], "little")
    document, data = json.loads(content[20 : 20 + length]), content[28 + length :]
    (animation,) = document["animations"]

    def array(number: int) -> np.ndarray:
        accessor = document["accessors"][number]
        start = document["bufferViews"][accessor["bufferView"]]["byteOffset"]
        width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[accessor["type"]]
        values = np.frombuffer(data, "<f4", accessor["count"] * width, start)
        return values.reshape(-1, width)

    moved = {
        (c["target"]["node"], c["target"]["path"]): animation["samplers"][c["sampler"]]
        for c in animation["channels"]
    }
    primitive = document["meshes"][0]["primitives"][0]
    shape = array(primitive["attributes"]["POSITION"])
    assert mesh.colours is not None
    for k, node in enumerate(document["nodes"]):
        places, turns = (array(moved[k, path]["output"]) for path in ("translation", "rotation"))
        assert np.allclose(array(moved[k, "rotation"]["input"])[:, 0], np.arange(4) / 24)
        copy = slice(k * len(mesh.rest) // 20, (k + 1) * len(mesh.rest) // 20)
        for row, number in enumerate(mesh.frames):
            axis, w = turns[row, :3], turns[row, 3]
            points = shape + 2.0 * np.cross(axis, np.cross(axis, shape) + w * shape)
            points = node["scale"][0] * points + places[row]
            away = np.linalg.norm(points[:, None] - mesh.points_at(number)[copy][None], axis=2).min(axis=1)
            assert away.max() < 1e-5
        assert ((turns[1:] * turns[:-1]).sum(axis=1) > 0).all()
        material = document["materials"][document["meshes"][node["mesh"]]["primitives"][0]["material"]]
        factor = material["pbrMetallicRoughness"]["baseColorFactor"][:3]
        assert factor == pytest.approx(mesh.colours[copy][0].tolist(), abs=1e-4)
    assert len(document["materials"]) == len(document["meshes"]) == 3


def test_quaternions_turn_as_their_rotations() -> None:
    turns = nearest_rotations(np.random.default_rng(3).normal(size=(500, 3, 3)))
    turns[:3] = [np.diag([1.0, -1.0, -1.0]), np.diag([-1.0, 1.0, -1.0]), np.diag([-1.0, -1.0, 1.0])]
    found, vector = quaternions(turns), np.array([0.3, -1.0, 2.0])
    axis, w = found[:, :3], found[:, 3:]
    turned = vector + 2.0 * np.cross(axis, np.cross(axis, vector) + w * vector)
    assert np.allclose(turned, turns @ vector)
