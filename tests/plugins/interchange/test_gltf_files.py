"""glTF files are read as other programs show them; what is not read is refused by its name."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import DracoPy
import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.arrays import AnyArray
from flowsculpt.pipeline.errors import MachineError, MeshError, MissingInputError
from flowsculpt.pipeline.mesh import box, icosphere
from flowsculpt.pipeline.mesh.read import ModelFile
from flowsculpt.pipeline.plugins.interchange import scene_readers
from flowsculpt.pipeline.plugins.interchange.gltf_document import GltfDocument
from flowsculpt.pipeline.plugins.interchange.gltf_files import SceneArrays, Triangles
from flowsculpt.pipeline.plugins.interchange.gltf_scene import DefaultScene
from tests.plugins.interchange.gltf_scenes import GltfScene, box_scene, with_instances
from tests.plugins.interchange.test_meshopt import STREAMS

BALL = icosphere(2)


def surface(path: Path) -> Triangles:
    """Read a file in this process."""
    return SceneArrays(DefaultScene.of(GltfDocument.read(path))).surface()


def extents(triangles: Triangles) -> list[float]:
    return np.ptp(triangles.points[triangles.faces.reshape(-1)], axis=0).round(6).tolist()


def volume(triangles: Triangles) -> float:
    a, b, c = triangles.points[triangles.faces].transpose(1, 0, 2)
    return float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6.0


def refusal(path: Path) -> str:
    """Return the message about a file that is read in this process."""
    with pytest.raises((MeshError, ValueError)) as error:
        surface(path)
    return str(error.value)


# ---- accessors


@pytest.mark.parametrize("dtype", ["i1", "u1", "i2", "u2"])
def test_normalized_positions_are_divided(tmp_path: Path, dtype: str) -> None:
    most, scene = np.iinfo(dtype).max, GltfScene()
    corners = (box(2.0).vertices + (1.0 if dtype[0] == "u" else 0.0)) / (2.0 if dtype[0] == "u" else 1.0)
    rows = np.zeros((8, 4), dtype)
    rows[:, :3] = np.rint(corners * most)
    view = scene.view(rows.tobytes(), byteStride=rows.strides[0])
    positions = scene.accessor(rows[:, :3], view, normalized=True)
    indices = scene.accessor(box().faces.reshape(-1).astype(np.uint8))
    scene.node(mesh=scene.mesh({"attributes": {"POSITION": positions}, "indices": indices}))
    scene.require("KHR_mesh_quantization")
    assert extents(surface(scene.glb(tmp_path / "a.glb"))) == [1.0 if dtype[0] == "u" else 2.0] * 3


def test_the_least_whole_number_is_minus_one(tmp_path: Path) -> None:
    scene = GltfScene()
    rows = np.array([[-128, 0, 0, 0], [127, 0, 0, 0], [0, 127, 0, 0]], np.int8)
    positions = scene.accessor(rows[:, :3], scene.view(rows.tobytes(), byteStride=4), normalized=True)
    scene.node(mesh=scene.mesh({"attributes": {"POSITION": positions}}))
    assert surface(scene.glb(tmp_path / "a.glb")).points.min() == -1.0


def test_interleaved_positions_are_read_by_their_stride(tmp_path: Path) -> None:
    scene, rows = GltfScene(), np.hstack([BALL.vertices, BALL.vertices]).astype(np.float32)
    view = scene.view(b"skip" + rows.tobytes(), byteStride=24)
    positions = scene.accessor(rows[:, :3], view, byteOffset=4)
    indices = scene.accessor(BALL.faces.reshape(-1).astype(np.uint16))
    scene.node(mesh=scene.mesh({"attributes": {"POSITION": positions}, "indices": indices}))
    assert np.array_equal(surface(scene.glb(tmp_path / "a.glb")).points, rows[:, :3])


@pytest.mark.parametrize("from_zero", [True, False])
def test_sparse_accessors_have_their_exceptions(tmp_path: Path, from_zero: bool) -> None:
    scene = box_scene(box(2.0))
    accessor = scene.json["accessors"][0]
    moved = np.arange(8, dtype=np.uint16) if from_zero else np.array([0, 7], np.uint16)
    values = 3.0 * box(2.0).vertices[moved]
    if from_zero:
        del accessor["bufferView"]
    accessor["sparse"] = {
        "count": len(moved),
        "indices": {"bufferView": scene.view(moved.tobytes()), "componentType": 5123},
        "values": {"bufferView": scene.view(values.astype(np.float32).tobytes())},
    }
    expected = box(2.0).vertices.copy()
    expected[moved] = values
    assert np.array_equal(surface(scene.glb(tmp_path / "a.glb")).points, expected)


@pytest.mark.parametrize(
    ("change", "fact"),
    [
        ({"count": 9}, "accessor 0 ends at byte 108 of bufferView 0, which has 96"),
        ({"count": -1}, "count of accessor 0 is -1; it must be a whole number"),
        ({"byteOffset": 50}, "accessor 0 ends at byte 146 of bufferView 0, which has 96"),
        ({"bufferView": 7}, "accessor 0 names bufferView 7; there are 2, from 0"),
        ({"componentType": 5124}, "componentType of accessor 0 is 5124"),
        ({"componentType": 5125}, "positions of componentType 5125"),
        ({"type": "VEC2"}, "accessor 0 of primitive 0 of mesh 0 is of type VEC2, not VEC3"),
        ({"sparse": {"count": 1}}, "indices of sparse of accessor 0"),
    ],
)
def test_a_damaged_accessor_is_named(tmp_path: Path, change: dict[str, Any], fact: str) -> None:
    scene = box_scene(box())
    scene.json["accessors"][0] |= change
    assert fact in refusal(scene.glb(tmp_path / "a.glb"))


def test_an_index_beyond_the_vertices_of_its_own_mesh_is_named(tmp_path: Path) -> None:
    scene = GltfScene()
    indices = scene.accessor(np.array([0, 1, 8], np.uint8))
    primitive = {"attributes": {"POSITION": scene.accessor(box().vertices)}, "indices": indices}
    scene.node(mesh=scene.mesh(primitive, {"attributes": primitive["attributes"]}))
    assert "face 0 of primitive 0 of mesh 0 names vertex 8 of 8" in refusal(scene.glb(tmp_path / "a.glb"))


# ---- triangles


@pytest.mark.parametrize("is_indexed", [True, False])
@pytest.mark.parametrize(("mode", "order"), [(4, [0, 1, 2, 0, 2, 3]), (5, [0, 1, 3, 2]), (6, [0, 1, 2, 3])])
def test_lists_strips_and_fans_make_the_same_square(
    tmp_path: Path, mode: int, order: list[int], is_indexed: bool
) -> None:
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
    scene = GltfScene()
    primitive = {
        "attributes": {"POSITION": scene.accessor(square if is_indexed else square[order])},
        "mode": mode,
    }
    if is_indexed:
        primitive["indices"] = scene.accessor(np.array(order, np.uint8))
    scene.node(mesh=scene.mesh(primitive))
    read = surface(scene.glb(tmp_path / "a.glb"))
    a, b, c = read.points[read.faces].transpose(1, 0, 2)
    assert np.array_equal(np.cross(b - a, c - a), [[0, 0, 1], [0, 0, 1]]), "both face along z"


@pytest.mark.parametrize("order", [[0, 1, 3, 2, 2, 4, 4, 5, 7, 6], [0, 1, 3, 2, 255, 4, 5, 7, 6]])
def test_strips_begin_again_after_triangles_without_area_or_a_mark(tmp_path: Path, order: list[int]) -> None:
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
    scene = GltfScene()
    positions = scene.accessor(np.concatenate([square, square + np.float32([2, 0, 0])]))
    indices = scene.accessor(np.array(order, np.uint8))
    scene.node(mesh=scene.mesh({"attributes": {"POSITION": positions}, "indices": indices, "mode": 5}))
    read = surface(scene.glb(tmp_path / "a.glb"))
    a, b, c = read.points[read.faces].transpose(1, 0, 2)
    assert np.array_equal(np.cross(b - a, c - a)[:, 2], [1, 1, 1, 1])


def test_points_and_lines_are_left_out_with_a_note(tmp_path: Path) -> None:
    scene = box_scene(box())
    lines = {"attributes": {"POSITION": scene.accessor(box().vertices)}, "mode": 1}
    scene.node(mesh=scene.mesh(lines, lines | {"mode": 0}))
    read = ModelFile(scene.glb(tmp_path / "a.glb")).surface()
    assert (read.faces, read.notes) == (12, ("2 primitives of points or lines are left out",))


def test_morph_targets_are_not_applied_and_the_user_is_told(tmp_path: Path) -> None:
    scene = GltfScene()
    mesh = scene.triangles(box(2.0), targets=[{"POSITION": scene.accessor(box(2.0).vertices)}])
    scene.node(mesh=mesh, weights=[1.0])
    read = ModelFile(scene.glb(tmp_path / "a.glb")).surface()
    assert np.ptp(read.mesh.vertices, axis=0).tolist() == [2.0, 2.0, 2.0]
    assert read.notes[0].startswith("the morph targets of 1 primitive are not applied")


# ---- nodes

NUMBER = st.floats(-3.0, 3.0, width=32)


@st.composite
def plain_scenes(draw: st.DrawFn) -> GltfScene:
    """Scenes of the features that trimesh reads: meshes of several primitives in a hierarchy of nodes."""
    scene = GltfScene()
    triangles = {
        "attributes": {"POSITION": scene.accessor(BALL.vertices)},
        "indices": scene.accessor(BALL.faces.reshape(-1).astype(np.uint16)),
    }
    meshes = [scene.mesh(triangles), scene.mesh(triangles, triangles)]
    for number in range(draw(st.integers(1, 6))):
        node: dict[str, Any] = {"mesh": draw(st.sampled_from(meshes))} if draw(st.booleans()) else {}
        if draw(st.booleans()):
            rows = draw(st.lists(NUMBER, min_size=12, max_size=12))
            node["matrix"] = np.vstack([np.reshape(rows, (3, 4)), [0, 0, 0, 1]]).T.reshape(-1).tolist()
        else:
            for name, size in (("translation", 3), ("rotation", 4), ("scale", 3)):
                if draw(st.booleans()):
                    node[name] = draw(st.lists(NUMBER, min_size=size, max_size=size))
        is_root = number == 0 or draw(st.booleans())
        scene.node(root=is_root, **node)
        if not is_root:
            parent = scene.json["nodes"][draw(st.integers(0, number - 1))]
            parent.setdefault("children", []).append(number)
    return scene


@settings(max_examples=60, deadline=None)
@given(plain_scenes())
def test_a_plain_scene_is_read_to_the_last_bit_as_trimesh_reads_it(
    tmp_path_factory: pytest.TempPathFactory, scene: GltfScene
) -> None:
    path = scene.glb(tmp_path_factory.mktemp("scenes") / "a.glb")
    other, read = trimesh.load(path, force="mesh", process=False, maintain_order=True), surface(path)
    assert np.array_equal(np.reshape(other.vertices, (-1, 3)), read.points), "keys of older frames stay right"
    assert np.array_equal(np.reshape(other.faces, (-1, 3)), read.faces)
    assert len(ModelFile(path).files().digest) == 64
    assert not DefaultScene.of(GltfDocument.read(path)).was_misread


@pytest.mark.parametrize(
    ("arrays", "size"),
    [
        ({"TRANSLATION": [[0, 0, 0], [5, 0, 0], [0, 3, 0]]}, [7, 5, 2]),
        ({"SCALE": [[1, 1, 1], [-2, 1, 1]]}, [4, 2, 2]),
        (
            {"ROTATION": [[0, 0, 0, 1], [0, 0, 0.5**0.5, 0.5**0.5]], "SCALE": [[3, 1, 1], [3, 1, 1]]},
            [6, 6, 2],
        ),
        ({"TRANSLATION": [[1, 0, 0]]}, [2, 2, 2]),
    ],
)
def test_instances_stand_where_their_arrays_say(
    tmp_path: Path, arrays: dict[str, Any], size: list[int]
) -> None:
    scene = GltfScene()
    mesh = scene.triangles(box(2.0))
    given_arrays = {name: np.array(rows, np.float32) for name, rows in arrays.items()}
    scene.node(mesh=mesh, extensions=with_instances(scene, **given_arrays), translation=[0, 0, 9])
    scene.require("EXT_mesh_gpu_instancing")
    read = surface(scene.glb(tmp_path / "a.glb"))
    count = len(next(iter(arrays.values())))
    assert len(read.faces) == 12 * count
    assert extents(read) == pytest.approx(size, abs=1e-5)
    assert read.points[:, 2].mean() == pytest.approx(9.0), "the node's own transform holds for all"
    own = [volume(Triangles(read.points, faces)) for faces in np.split(read.faces, count)]
    assert min(own) > 0, "mirrored copies face outwards"


def test_rotations_of_instances_may_be_whole_numbers(tmp_path: Path) -> None:
    scene = GltfScene()
    mesh = scene.triangles(box(2.0))
    turn = np.array([[0, 0, 23170, 23170]], np.int16)
    accessor = scene.accessor(turn, normalized=True)
    extensions = {"EXT_mesh_gpu_instancing": {"attributes": {"ROTATION": accessor}}}
    scene.node(mesh=mesh, scale=[3, 1, 1], extensions=extensions)
    assert extents(surface(scene.glb(tmp_path / "a.glb"))) == pytest.approx([6, 2, 2], abs=1e-4)


def test_instances_of_unequal_numbers_are_refused(tmp_path: Path) -> None:
    scene = box_scene(box())
    arrays = {"TRANSLATION": np.zeros((2, 3), np.float32), "SCALE": np.ones((3, 3), np.float32)}
    scene.json["nodes"][0]["extensions"] = with_instances(scene, **arrays)
    assert "the instances of node 0 have 2 or 3 transforms" in refusal(scene.glb(tmp_path / "a.glb"))


def test_a_skinned_mesh_stands_where_its_joints_are(tmp_path: Path) -> None:
    scene = box_scene(box(2.0), skin=0, translation=[100, 0, 0])
    primitive = scene.json["meshes"][0]["primitives"][0]
    ahead = box(2.0).vertices[:, 0] > 0
    joints, weights = np.zeros((8, 4), np.uint8), np.zeros((8, 4), np.uint8)
    joints[ahead, 0], weights[:, 0] = 1, 255
    primitive["attributes"] |= {
        "JOINTS_0": scene.accessor(joints),
        "WEIGHTS_0": scene.accessor(weights, normalized=True),
    }
    bones = [scene.node(root=False), scene.node(root=False, translation=[3, 0, 0])]
    scene.node(translation=[0, 5, 0], children=bones)
    bind = np.tile(np.eye(4, dtype=np.float32).reshape(-1), (2, 1))
    scene.json["skins"] = [{"joints": bones, "inverseBindMatrices": scene.accessor(bind)}]
    read = surface(scene.glb(tmp_path / "a.glb"))
    scene.json["nodes"][0]["extensions"] = with_instances(scene, TRANSLATION=np.eye(3))
    assert "node 0 has a skin and instances" in refusal(scene.glb(tmp_path / "b.glb"))
    assert extents(read) == [5, 2, 2]
    assert read.points.min(axis=0).tolist() == [-1, 4, -1], "the node's own transform does not count"


def test_nodes_that_are_hidden_are_not_read(tmp_path: Path) -> None:
    scene = box_scene(box())
    child = scene.node(root=False, mesh=0, translation=[9, 0, 0])
    scene.node(children=[child], extensions={"KHR_node_visibility": {"visible": False}})
    scene.require("KHR_node_visibility")
    assert extents(surface(scene.glb(tmp_path / "a.glb"))) == [2, 2, 2]


def test_the_default_scene_is_read_and_without_scenes_every_node(tmp_path: Path) -> None:
    scene = box_scene(box())
    scene.node(root=False, mesh=0, translation=[9, 0, 0])
    scene.json["scenes"].append({"nodes": [1]})
    scene.json["scene"] = 1
    assert surface(scene.glb(tmp_path / "a.glb")).points.mean(axis=0).tolist() == [9, 0, 0]
    del scene.json["scenes"], scene.json["scene"]
    assert extents(surface(scene.glb(tmp_path / "b.glb"))) == [11, 2, 2]


def test_of_a_scene_that_shows_none_of_the_meshes_this_is_said(tmp_path: Path) -> None:
    scene = box_scene(box())
    scene.json["scenes"][0]["nodes"] = []
    with pytest.raises(MeshError, match=r"it has no faces.*; no node of its default scene has a mesh"):
        ModelFile(scene.glb(tmp_path / "a.glb")).surface()


def test_meshes_that_nodes_multiply_beyond_reason_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("flowsculpt.pipeline.plugins.interchange.gltf_scene._MOST_PARTS", 99)
    scene = GltfScene()
    mesh = scene.mesh(*[{"attributes": {"POSITION": scene.accessor(box().vertices)}}] * 10)
    for _ in range(10):
        scene.node(mesh=mesh)
    assert "its nodes have over 99 primitives in all" in refusal(scene.glb(tmp_path / "a.glb"))


@pytest.mark.parametrize("children", [[0], [1], [0, 1]])
def test_nodes_below_themselves_or_two_nodes_are_refused(tmp_path: Path, children: list[int]) -> None:
    scene = box_scene(box(), children=children)
    scene.node(mesh=0)
    assert "a node has one" in refusal(scene.glb(tmp_path / "a.glb"))


# ---- compression and extensions


def test_draco_data_is_read(tmp_path: Path) -> None:
    scene = GltfScene()
    packed = DracoPy.encode(BALL.vertices.astype(np.float32), BALL.faces, quantization_bits=16)
    draco = {"bufferView": scene.view(packed), "attributes": {"POSITION": 0}}
    mesh = scene.triangles(BALL, extensions={"KHR_draco_mesh_compression": draco})
    for accessor in scene.json["accessors"]:
        del accessor["bufferView"]
    scene.node(mesh=mesh, scale=[2, 2, 2])
    scene.require("KHR_draco_mesh_compression")
    read = ModelFile(scene.glb(tmp_path / "a.glb")).surface()
    assert (len(read.mesh.vertices), read.faces) == (len(BALL.vertices), len(BALL.faces))
    assert np.ptp(read.mesh.vertices, axis=0) == pytest.approx(2.0 * np.ptp(BALL.vertices, axis=0), abs=1e-3)


def test_draco_data_without_its_package_is_the_environments_fault(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = GltfScene()
    draco = {"bufferView": scene.view(b"DRACO"), "attributes": {"POSITION": 0}}
    scene.node(mesh=scene.triangles(box(), extensions={"KHR_draco_mesh_compression": draco}))
    path = scene.glb(tmp_path / "a.glb")
    assert ModelFile(path).surface().faces == 12, (
        "where the file has the same data uncompressed, that is read"
    )
    del scene.json["accessors"][0]["bufferView"]
    assert "the Draco data of primitive 0 of mesh 0 is damaged" in refusal(scene.glb(path))
    monkeypatch.setattr(scene_readers, "find_spec", lambda _: None)
    with pytest.raises(MachineError, match=r"need the package DracoPy.*\[models\]"):
        ModelFile(path).surface()


def meshopt_scene(extension: str, stream: str) -> tuple[GltfScene, AnyArray]:
    """Return a scene whose triangles come from a stream, and whose buffer 1 has no content."""
    packed, scene = STREAMS[stream], GltfScene()
    ball = icosphere(3)
    mesh = scene.triangles(ball)
    view = scene.json["bufferViews"][1]
    compressed = scene.json["bufferViews"][scene.view(packed["encoded"])]
    scene.json["bufferViews"].pop()
    scene.json["buffers"] = [
        {},
        {"byteLength": view["byteLength"], "extensions": {extension: {"fallback": True}}},
    ]
    view |= {"buffer": 1, "byteOffset": 0}
    values = {name: packed[name] for name in ("mode", "filter", "count")} | {"byteStride": packed["stride"]}
    view["extensions"] = {extension: compressed | values}
    scene.node(mesh=mesh)
    scene.require(extension)
    return scene, ball.faces


@pytest.mark.parametrize("extension", ["EXT_meshopt_compression", "KHR_meshopt_compression"])
def test_views_that_meshoptimizer_compressed_are_read(tmp_path: Path, extension: str) -> None:
    scene, faces = meshopt_scene(extension, "triangles of a ball, version 1")
    read = surface(scene.glb(tmp_path / "a.glb"))
    turned = [np.roll(face, -int(np.argmin(face))) for face in read.faces]
    assert np.array_equal(turned, [np.roll(face, -int(np.argmin(face))) for face in faces])


@pytest.mark.parametrize(
    ("change", "fact"),
    [
        ({"filter": "OCTAHEDRAL"}, "meshoptimizer's filter OCTAHEDRAL, which is not read"),
        ({"mode": "VERTICES"}, "meshoptimizer in mode VERTICES, which is not read"),
        ({"count": 30}, "compressed by meshoptimizer, is damaged"),
    ],
)
def test_other_modes_and_filters_are_refused_by_name(
    tmp_path: Path, change: dict[str, Any], fact: str
) -> None:
    scene, _ = meshopt_scene("EXT_meshopt_compression", "triangles of a ball, version 0")
    scene.json["bufferViews"][1]["extensions"]["EXT_meshopt_compression"] |= change
    assert fact in refusal(scene.glb(tmp_path / "a.glb"))


def test_extensions_that_are_required_and_unknown_are_refused_by_name(tmp_path: Path) -> None:
    scene = box_scene(box())
    scene.require("KHR_texture_transform", "KHR_materials_unlit", "EXT_texture_webp")
    assert ModelFile(scene.glb(tmp_path / "a.glb")).surface().faces == 12
    scene.require("KHR_texture_transform", "ACME_subdivision")
    message = "it requires the extension ACME_subdivision, which is not read. Export without."
    assert refusal(scene.glb(tmp_path / "b.glb")) == message


# ---- files


@pytest.mark.parametrize(
    ("address", "file"),
    [
        ("data.bin", "data.bin"),
        ("my%20data%C3%A4.bin", "my dataä.bin"),
        ("my data ä.bin", "my data ä.bin"),
        ("100%25.bin", "100%.bin"),
        ("50%20.bin", "50%20.bin"),
        ("parts/deep/data.bin", "parts/deep/data.bin"),
        ("parts\\data.bin", "parts/data.bin"),
        ("../data.bin", "../data.bin"),
    ],
)
def test_buffers_are_found_at_addresses_as_programs_write_them(
    tmp_path: Path, address: str, file: str
) -> None:
    (tmp_path / "show").mkdir()
    path = box_scene(box()).gltf(tmp_path / "show" / "a.gltf", address, file)
    assert extents(surface(path)) == [2, 2, 2]
    files = [other.resolve() for other, _ in ModelFile(path).files().files]
    assert files == [path, (path.parent / file).resolve()]


@pytest.mark.parametrize(
    "address", ["/etc/data.bin", "file:///etc/passwd", "https://example.org/data.bin", "C:/a"]
)
def test_addresses_that_are_not_relative_are_refused(tmp_path: Path, address: str) -> None:
    path = box_scene(box()).gltf(tmp_path / "a.gltf", "data.bin")
    path.write_text(path.read_text().replace("data.bin", address))
    assert f"the address of buffer 0 is {address}; only files at addresses relative" in refusal(path)


def test_a_missing_buffer_is_a_missing_input(tmp_path: Path) -> None:
    path = box_scene(box()).gltf(tmp_path / "a.gltf", "data.bin")
    (tmp_path / "data.bin").unlink()
    for read in (ModelFile.surface, ModelFile.files):
        with pytest.raises(
            MissingInputError, match=r"a\.gltf: its buffer 0 refers to .*data\.bin: file not found"
        ):
            read(ModelFile(path))


def test_a_buffer_that_ends_early_is_named(tmp_path: Path) -> None:
    path = box_scene(box()).gltf(tmp_path / "a.gltf", "data.bin")
    content = (tmp_path / "data.bin").read_bytes()
    (tmp_path / "data.bin").write_bytes(content[:-4])
    assert f"bufferView 1 ends at byte {len(content)} of buffer 0, which has {len(content) - 4}" in refusal(
        path
    )


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le"])
def test_data_within_the_file_is_read_in_every_encoding_of_json(tmp_path: Path, encoding: str) -> None:
    path = box_scene(box()).gltf(tmp_path / "A.GLTF")
    path.write_bytes(path.read_text().encode(encoding))
    assert extents(surface(path)) == [2, 2, 2]
    assert len(ModelFile(path).files().files) == 1


def test_a_glb_may_name_more_buffers_than_its_own(tmp_path: Path) -> None:
    scene = box_scene(box())
    indices = scene.json["bufferViews"][1]
    start = indices["byteOffset"]
    (tmp_path / "indices.bin").write_bytes(scene.data[start : start + indices["byteLength"]])
    indices |= {"buffer": 1, "byteOffset": 0}
    scene.json["buffers"] = [{}, {"byteLength": indices["byteLength"], "uri": "indices.bin"}]
    path = scene.glb(tmp_path / "A.GLB")
    assert extents(surface(path)) == [2, 2, 2]
    assert [file.name for file, _ in ModelFile(path).files().files] == ["A.GLB", "indices.bin"]


def test_what_the_surface_does_not_rest_on_is_not_opened(tmp_path: Path) -> None:
    scene = box_scene(box())
    moves = {"buffer": 1, "byteOffset": 0, "byteLength": 4}
    scene.json["bufferViews"].append(moves)
    scene.json["images"] = [{"uri": "gone.png"}]
    scene.json["buffers"] = [{}, {"byteLength": 4, "uri": "gone.bin"}]
    path = scene.gltf(tmp_path / "a.gltf", "data.bin")
    assert ModelFile(path).surface().faces == 12
    assert [file.name for file, _ in ModelFile(path).files().files] == ["a.gltf", "data.bin"]


def test_files_that_were_misread_once_have_other_digests(tmp_path: Path) -> None:
    plain = box_scene(box()).glb(tmp_path / "plain.glb")
    own = ModelFile(plain).files()
    assert own.digest == own.files[0][1], "the key of a file that was read right stays"
    scene = box_scene(box())
    scene.json["accessors"][0]["normalized"] = True
    normalized = ModelFile(scene.glb(tmp_path / "normalized.glb")).files()
    assert normalized.digest != normalized.files[0][1]


@pytest.mark.parametrize(
    ("content", "fact"),
    [
        (b"glTF" + struct.pack("<II", 3, 12), "it is glTF 3; glTF 1.0 and 2.0 are read. Export it as 2.0."),
        (b"glTF" + struct.pack("<II", 2, 12), "it is a GLB without JSON"),
        (b'{"asset": {"version": "1.0"}}', "it has no GLB header"),
    ],
)
def test_other_versions_and_empty_files_are_named(tmp_path: Path, content: bytes, fact: str) -> None:
    (tmp_path / "a.glb").write_bytes(content)
    assert fact in refusal(tmp_path / "a.glb")


def test_json_of_a_size_that_would_fill_the_memory_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.gltf").write_bytes(b'{"nodes": [' + b"{}," * (22 << 20) + b"{}]}")
    assert "its JSON has 66 MiB; up to 64 MiB are read" in refusal(tmp_path / "a.gltf")


VERSION_1 = {
    "asset": {"version": "1.0"},
    "scene": "main",
    "scenes": {"other": {"nodes": []}, "main": {"nodes": ["top"]}},
    "nodes": {
        "top": {"children": ["low"], "matrix": [2, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]},
        "low": {"meshes": ["cube", "cube"], "translation": [0, 5, 0]},
    },
    "meshes": {"cube": {"primitives": [{"attributes": {"POSITION": "places"}, "indices": "corners"}]}},
    "accessors": {
        "corners": {
            "bufferView": "view",
            "byteOffset": 192,
            "componentType": 5121,
            "count": 36,
            "type": "SCALAR",
        },
        "places": {
            "bufferView": "view",
            "byteStride": 24,
            "byteOffset": 12,
            "componentType": 5126,
            "count": 8,
            "type": "VEC3",
        },
    },
    "bufferViews": {"view": {"buffer": "binary_glTF", "byteOffset": 0, "byteLength": 228}},
    "buffers": {"unused": {"uri": "gone.bin"}, "binary_glTF": {"uri": "data:,", "byteLength": 228}},
}
PACKED = np.hstack([box().vertices, box().vertices]).astype(np.float32).tobytes() + bytes(
    box().faces.reshape(-1).astype(np.uint8)
)


def version_1(path: Path, **changes: Any) -> Path:
    text = json.dumps(VERSION_1 | changes).encode()
    head = struct.pack("<4sIIII", b"glTF", 1, 20 + len(text) + len(PACKED), len(text), 0)
    path.write_bytes(head + text + PACKED)
    return path


def test_version_1_is_read_from_a_glb_and_beside_its_buffer(tmp_path: Path) -> None:
    read = surface(version_1(tmp_path / "a.glb"))
    assert (extents(read), len(read.faces)) == ([4, 2, 2], 24), "a node may have several meshes"
    assert read.points.mean(axis=0).tolist() == [0, 5, 0]
    (tmp_path / "data.bin").write_bytes(PACKED)
    buffers = {"binary_glTF": {"uri": "data.bin", "byteLength": 228}}
    views = {"view": {**VERSION_1["bufferViews"]["view"], "buffer": "mine"}}
    named = VERSION_1 | {"buffers": {"mine": buffers["binary_glTF"]}, "bufferViews": views}
    (tmp_path / "a.gltf").write_text(json.dumps(named))
    assert np.array_equal(surface(tmp_path / "a.gltf").points, read.points)
    assert [file.name for file, _ in ModelFile(tmp_path / "a.gltf").files().files] == ["a.gltf", "data.bin"]


@pytest.mark.parametrize(
    ("changes", "fact"),
    [
        (
            {"nodes": {"top": {"meshes": ["cube"], "skin": "a"}}},
            "it is glTF 1.0 with a skin, which is not read",
        ),
        (
            {"extensionsUsed": ["WEB3D_quantized_attributes"]},
            "it uses the extension WEB3D_quantized_attributes",
        ),
        ({"meshes": {}}, "it names 'cube', which it does not define"),
    ],
)
def test_what_is_not_read_of_version_1_is_named(tmp_path: Path, changes: dict[str, Any], fact: str) -> None:
    assert fact in refusal(version_1(tmp_path / "a.glb", **changes))
