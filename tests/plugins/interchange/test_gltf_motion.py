"""Animations of glTF files move vertices as the format says, at keys and between them."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flowsculpt.pipeline.arrays import Floats
from flowsculpt.pipeline.errors import MeshError, MissingInputError
from flowsculpt.pipeline.mesh import box
from flowsculpt.pipeline.mesh.mesh_formats import ScenePart
from flowsculpt.pipeline.mesh.read import ModelFile
from flowsculpt.pipeline.plugins.interchange.gltf_document import GltfDocument
from flowsculpt.pipeline.plugins.interchange.gltf_motion import AnimatedScene, GltfSource
from tests.plugins.interchange.gltf_scenes import GltfScene, box_scene

BOX = box(2.0)
HALF_TURN = [[0, 0, 0, 1], [0, 0, 1, 0]]


def animate(scene: GltfScene, node: int, path: str, times: Any, values: Any, **more: Any) -> GltfScene:
    """Add an animation of one channel, or its channel to the one of its name."""
    name, how = more.get("name", "move"), more.get("how", "LINEAR")
    known = scene.json.setdefault("animations", [])
    animation = next((each for each in known if each["name"] == name), None)
    if animation is None:
        known.append(animation := {"name": name, "samplers": [], "channels": []})
    sampler = {
        "input": scene.accessor(np.array(times, np.float32)),
        "output": scene.accessor(np.array(values, np.float32)),
        "interpolation": how,
    }
    animation["channels"].append(
        {"sampler": len(animation["samplers"]), "target": {"node": node, "path": path}}
    )
    animation["samplers"].append(sampler)
    return scene


def source(path: Path, animation: str = "") -> GltfSource:
    """Open a file in this process."""
    scene = AnimatedScene.of(GltfDocument.read(path))
    assert isinstance(scene, AnimatedScene)
    scene.animation = animation
    return GltfSource(scene)


def points(scene: GltfScene, folder: Path, seconds: float) -> Floats:
    return source(scene.glb(folder / "a.glb")).surface(seconds).points


@pytest.mark.parametrize(
    ("how", "values", "at", "x"),
    [
        ("LINEAR", [[0, 0, 0], [4, 0, 0]], 1.5, 1.0),
        ("STEP", [[0, 0, 0], [4, 0, 0]], 2.9, 0.0),
        ("STEP", [[0, 0, 0], [4, 0, 0]], 3.0, 4.0),
        ("LINEAR", [[0, 0, 0], [4, 0, 0]], 99.0, 4.0),
        ("LINEAR", [[0, 0, 0], [4, 0, 0]], 0.0, 0.0),
        # h = 2 s, s = 1/4: 5/32 · 4 + h (9/64 · 1 - 3/64 · 2)
        ("CUBICSPLINE", np.outer([0, 0, 1, 2, 4, 0], [1, 0, 0]), 1.5, 0.625 + 2 * (9 - 6) / 64),
    ],
)
def test_a_node_goes_between_keys_as_its_interpolation_says(
    tmp_path: Path, how: str, values: Any, at: float, x: float
) -> None:
    scene = animate(box_scene(BOX), 0, "translation", [1, 3], values, how=how)
    assert points(scene, tmp_path, at) == pytest.approx(BOX.vertices + np.array([x, 0, 0]), abs=1e-12)


def test_rotations_take_the_shorter_arc_and_scales_mirror(tmp_path: Path) -> None:
    scene = animate(
        box_scene(BOX), 0, "rotation", [0, 1], np.array([[0, 0, 0, 1], [0, 0, -(0.5**0.5), -(0.5**0.5)]])
    )
    animate(scene, 0, "scale", [0, 1], [[1, 1, 1], [-1, 1, 1]], how="STEP")
    opened = source(scene.glb(tmp_path / "a.glb"))
    turned = BOX.vertices @ [
        [np.cos(np.pi / 8), np.sin(np.pi / 8), 0],
        [-np.sin(np.pi / 8), np.cos(np.pi / 8), 0],
        [0, 0, 1],
    ]
    assert opened.surface(0.25).points == pytest.approx(turned, abs=1e-7)
    before, after = opened.surface(0.0), opened.surface(1.0)
    assert not np.array_equal(before.corners, after.corners), "a mirror turns the faces over"
    assert np.array_equal(before.corners.reshape(-1, 3), after.corners.reshape(-1, 3)[:, ::-1])


def test_morph_targets_add_up_before_the_skin_and_joints_carry_them(tmp_path: Path) -> None:
    scene = GltfScene()
    weights = np.tile(np.array([1, 0, 0, 0], np.float32), (8, 1))
    joints = np.zeros((8, 4), np.uint8)
    joints[4:, 0] = 1
    mesh = scene.triangles(BOX, targets=[{"POSITION": scene.accessor(np.tile([[0.0, 1, 0]], (8, 1)))}] * 2)
    attributes = scene.json["meshes"][mesh]["primitives"][0]["attributes"]
    attributes |= {"JOINTS_0": scene.accessor(joints), "WEIGHTS_0": scene.accessor(weights)}
    scene.node(mesh=mesh, skin=0, translation=[7, 7, 7])
    bones = [scene.node(), scene.node()]
    scene.json["skins"] = [{"joints": bones}]
    animate(scene, bones[1], "translation", [0, 2], [[0, 0, 0], [0, 0, 6]])
    animate(scene, 0, "weights", [0, 1], [0, 0, 1, 0.5])
    expected = BOX.vertices + np.array([0, 0.75, 0])
    expected[4:] += [0, 0, 1.5]
    assert points(scene, tmp_path, 0.5) == pytest.approx(expected)


@pytest.mark.parametrize("has_base", [True, False])
def test_sparse_morph_targets_move_the_vertices_that_they_list(tmp_path: Path, has_base: bool) -> None:
    """Their numbers and moves lie in a buffer of their own, whose change is noticed."""
    scene = GltfScene()
    moves, listed = np.tile([[0.0, 1.0, 0.0]], (8, 1)) * has_base, np.array([2, 5], np.uint16)
    target = scene.accessor(moves)
    mesh = scene.triangles(BOX, targets=[{"POSITION": target}])
    scene.node(mesh=mesh)
    animate(scene, 0, "weights", [0, 2], [0, 1])
    content = listed.tobytes() + np.array([[3, 0, 0], [0, 0, 6]], np.float32).tobytes()
    (tmp_path / "sparse.bin").write_bytes(content)
    scene.json["buffers"] = [{}, {"byteLength": len(content), "uri": "sparse.bin"}]
    views = [{"buffer": 1, "byteLength": 4}, {"buffer": 1, "byteOffset": 4, "byteLength": 24}]
    numbers, values = len(scene.json["bufferViews"]), len(scene.json["bufferViews"]) + 1
    scene.json["bufferViews"] += views
    accessor = scene.json["accessors"][target]
    accessor["sparse"] = {
        "count": 2,
        "indices": {"bufferView": numbers, "componentType": 5123},
        "values": {"bufferView": values},
    }
    if not has_base:
        del accessor["bufferView"]
    moves[listed] = [[3, 0, 0], [0, 0, 6]]
    moving = ModelFile(scene.gltf(tmp_path / "a.gltf", "buffer.bin")).motion()
    assert len(moving.files.files) == 3
    assert moving.at(1.0).points == pytest.approx(BOX.vertices + 0.5 * moves)
    os.utime(tmp_path / "sparse.bin", ns=(1, 1))
    with pytest.raises(MissingInputError, match=r"a\.gltf: it changed, or a file that it names"):
        moving.at(2.0)
    moving.close()


def test_animations_of_different_nodes_play_together_and_others_are_chosen_by_name(tmp_path: Path) -> None:
    scene = box_scene(BOX)
    scene.node(mesh=0)
    animate(scene, 0, "translation", [0, 1], [[0, 0, 0], [1, 0, 0]], name="one")
    animate(scene, 1, "translation", [0, 2], [[0, 0, 0], [2, 0, 0]], name="two")
    together = source(scene.glb(tmp_path / "a.glb"))
    assert together.motion.times.tolist() == [0.0, 2.0]
    assert together.surface(1.0).points[[0, 8], 0].tolist() == [2.0, 2.0]
    animate(scene, 0, "translation", [0, 1], [[0, 0, 0], [9, 0, 0]], name="three")
    path = scene.glb(tmp_path / "b.glb")
    with pytest.raises(MeshError, match=r"several animations: one, two, three. Write animation: one, or"):
        source(path)
    assert source(path, "three").surface(1.0).points[8, 0] == 10.0
    with pytest.raises(MeshError, match=r"no animation 'twos'. Did you mean 'two'"):
        source(path, "twos")


def _nan(scene: GltfScene) -> None:
    animate(scene, 0, "translation", [0, 1], [[0, 0, 0], [np.nan, 0, 0]])


def _descending(scene: GltfScene) -> None:
    animate(scene, 0, "translation", [1, 0], [[0, 0, 0], [1, 0, 0]])


def _ragged(scene: GltfScene) -> None:
    animate(scene, 0, "translation", [0, 1], [[0, 0, 0]])


def _matrix(scene: GltfScene) -> None:
    scene.json["nodes"][0]["matrix"] = np.eye(4).reshape(-1).tolist()
    animate(scene, 0, "translation", [0, 1], [[0, 0, 0], [1, 0, 0]])


def _pointer(scene: GltfScene) -> None:
    animate(scene, 0, "translation", [0, 1], [[0, 0, 0], [1, 0, 0]])
    pointer = {"KHR_animation_pointer": {"pointer": "/nodes/0/extensions/KHR_node_visibility/visible"}}
    scene.json["animations"][0]["channels"][0]["target"] = {"path": "pointer", "extensions": pointer}


@pytest.mark.parametrize(
    ("damage", "fact"),
    [
        (lambda scene: None, r"nothing moves in it. Export it with its animation"),
        (_nan, "a value of channel 0 of animations.0. of the file is not finite"),
        (_descending, "the times of channel 0 of animations.0. of the file do not ascend"),
        (_ragged, "channel 0 of animations.0. of the file has 1 values for 2 keys"),
        (_matrix, "moves node 0, which has a matrix"),
        (_pointer, "KHR_node_visibility/visible, which is not read. Export it without"),
    ],
)
def test_a_damaged_animation_is_one_line(tmp_path: Path, damage: Any, fact: str) -> None:
    scene = box_scene(BOX)
    damage(scene)
    with pytest.raises((MeshError, ValueError), match=fact):
        assert source(scene.glb(tmp_path / "a.glb")).motion


def test_a_file_is_opened_once_read_at_any_time_and_refused_once_it_changed(tmp_path: Path) -> None:
    scene = animate(box_scene(BOX), 0, "translation", [1, 3], [[0, 0, 0], [4, 0, 0]])
    path = scene.gltf(tmp_path / "a.gltf", "buffer.bin")
    moving = ModelFile(path, ScenePart(animation="move")).motion()
    assert (moving.times.tolist(), moving.rate) == ([1.0, 3.0], None)
    assert moving.is_fixed and moving.is_continuous and len(moving.files.files) == 2
    still = ModelFile(path).reader
    assert still is not None
    for seconds, x in [(0.0, 0.0), (1.5, 1.0), (3.0, 4.0), (2.0, 2.0)]:
        surface = moving.at(seconds)
        assert surface.points == pytest.approx(BOX.vertices + np.array([x, 0, 0]))
        assert np.array_equal(surface.corners, still.read(path).corners)
    turned = animate(box_scene(BOX), 0, "scale", [0, 1], [[1, 1, 1], [-1, 1, 1]]).glb(tmp_path / "b.glb")
    with pytest.raises(
        MeshError, match=r"b\.glb: at 0\.75 s: .* a scale mirrors it from then on. Export it again"
    ):
        ModelFile(turned).motion().at(0.75)
    os.utime(tmp_path / "buffer.bin", ns=(1, 1))
    with pytest.raises(MissingInputError, match=r"a\.gltf: it changed, or a file that it names"):
        moving.at(1.0)
    moving.close()
    with pytest.raises(MeshError, match=r"a\.stl: \.stl is not a format of moving surfaces; use one of"):
        (tmp_path / "a.stl").write_bytes(b"solid")
        ModelFile(tmp_path / "a.stl").motion()
