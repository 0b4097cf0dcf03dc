"""Animations as glTF: what players show at each frame is the sculpture, and validators do not object."""

from __future__ import annotations

import base64
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from playwright.sync_api import Browser

from flowsculpt.pipeline.arrays import AnyArray, Floats
from flowsculpt.pipeline.plugins.interchange.animated_gltf import (
    Moving,
    closes,
    quantized_animation,
    write_animated_gltf,
)
from flowsculpt.pipeline.plugins.interchange.drawn_mesh import MOST_ERROR, DrawnMesh, KeyPoses
from flowsculpt.pipeline.plugins.interchange.gltf_document import GltfDocument
from flowsculpt.pipeline.plugins.interchange.meshopt import FILTERS, MODES, decode_attributes, decode_indices
from flowsculpt.pipeline.plugins.interchange.meshopt_encoder import encode_attributes, encode_indices
from flowsculpt.render.graphics.three_js import installed_file, three_js_script
from flowsculpt.render.scene.materials import LOOKS
from tests.plugins.interchange.moving_meshes import ball, painted_box
from tests.plugins.interchange.node_programs import gltf_messages, module

TYPES = {5120: "i1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


@given(st.integers(1, 700), st.sampled_from([4, 8, 12, 64, 256]), st.integers(0, 140), st.integers(0, 2**32))
@settings(max_examples=60, deadline=None)
def test_attributes_come_back_as_they_were(count: int, stride: int, widest: int, seed: int) -> None:
    change = np.random.default_rng(seed).integers(-widest, widest + 1, (count, stride))
    elements = np.cumsum(change, axis=0).astype(np.uint8)
    assert np.array_equal(decode_attributes(encode_attributes(elements), count, stride), elements)


@given(st.lists(st.integers(0, 2**31 - 1) | st.integers(0, 200), max_size=200))
def test_indices_come_back_as_they_were(numbers: list[int]) -> None:
    indices = np.array(numbers, np.int64)
    assert np.array_equal(decode_indices(encode_indices(indices), len(numbers), 4), indices)


class Player:
    """A glTF file as a player has it: poses, and weights in time."""

    def __init__(self, path: Path) -> None:
        self._document = GltfDocument.read(path)
        self.root: dict[str, Any] = self._document.root.values
        self._content = self._document.buffer(0)
        self.primitive = self.root["meshes"][0]["primitives"][0]

    def values(self, index: int) -> Floats:
        """(N, …) the numbers of an accessor."""
        accessor = self.root["accessors"][index]
        view, kind = self.root["bufferViews"][accessor["bufferView"]], TYPES[accessor["componentType"]]
        packed = view.get("extensions", {}).get("EXT_meshopt_compression")
        at = packed or view
        content = self._content[at["byteOffset"] : at["byteOffset"] + at["byteLength"]]
        if packed:
            elements = MODES[packed["mode"]](content, packed["count"], packed["byteStride"])
            content = np.ascontiguousarray(FILTERS[packed.get("filter", "NONE")](elements)).tobytes()
        rows: AnyArray = np.frombuffer(content, kind).reshape(accessor["count"], -1)
        rows = rows[:, : WIDTHS[accessor["type"]]]
        if "min" in accessor:
            assert (rows.min(axis=0) == accessor["min"]).all() and (rows.max(axis=0) == accessor["max"]).all()
        if accessor.get("normalized"):
            rows = rows / float(np.iinfo(rows.dtype).max)
        return np.asarray(rows, np.float64)

    def at(self, second: float, name: str) -> Floats:
        """(W, 3) an attribute in the mesh's own space, blended."""
        base = self.values(self.primitive["attributes"][name])
        if "animations" not in self.root:
            return base
        sampler = self.root["animations"][0]["samplers"][0]
        times = self.values(sampler["input"])[:, 0]
        weights = self.values(sampler["output"]).reshape(len(times), -1)
        for target, column in zip(self.primitive["targets"], weights.T, strict=True):
            base = base + np.interp(second, times, column) * self.values(target[name])
        return base

    def points(self, second: float) -> Floats:
        node = self.root["nodes"][0]
        return self.at(second, "POSITION") * node.get("scale", 1.0) + node.get("translation", 0.0)


def written(place: Path, drawn: DrawnMesh, look: str = "clay", plain: bool | None = False) -> Path:
    """Write a file: compressed, plain, or neither with `plain` None."""
    path = place / f"{look}.{plain}.{len(list(place.iterdir()))}.glb"
    parts = [Moving("twisted", KeyPoses.of(drawn), LOOKS[look])]
    if plain is None:
        path.write_bytes(quantized_animation("clip", parts))
    else:
        write_animated_gltf(path, "clip", parts, plain)
    return path


@pytest.mark.parametrize("plain", [False, True, None])
@pytest.mark.parametrize(
    "drawn", [ball, painted_box, partial(ball, edge=0.05), partial(ball, frames=range(7, 8))]
)
def test_every_frame_is_within_a_quarter_of_an_edge(tmp_path: Path, drawn: Any, plain: bool | None) -> None:
    moving = drawn()
    keys, player = KeyPoses.of(moving), Player(written(tmp_path, moving, plain=plain))
    assert (len(keys.numbers) < len(moving.mesh.frames)) or len(keys.numbers) == 1
    errors = []
    for number in moving.mesh.frames:
        second = (number - moving.mesh.frames[0]) / 24.0
        points, normals = moving.frame(number)
        edge = moving.mesh.longest_at(number)
        errors.append(np.linalg.norm(player.points(second) - points, axis=1).max() / edge)
        if number in keys.numbers:
            cosines = np.einsum("ij,ij->i", player.at(second, "NORMAL"), normals)
            lengths = np.linalg.norm(player.at(second, "NORMAL"), axis=1)
            assert np.degrees(np.arccos(np.clip(cosines / lengths, -1, 1))).max() < 1.0
            assert errors[-1] < 0.01
    assert max(errors) <= keys.error <= MOST_ERROR


def test_faces_colours_and_texture_coordinates_are_those_of_the_mesh(tmp_path: Path) -> None:
    moving = painted_box()
    mesh, player = moving.mesh, Player(written(tmp_path, moving))
    faces = player.values(player.primitive["indices"]).reshape(-1, 3).astype(int)
    attributes = {name: player.values(index) for name, index in player.primitive["attributes"].items()}
    assert mesh.texture is not None and mesh.colours is not None

    def rows(points: Floats, normals: Floats, colours: Floats, texture: Floats) -> set[tuple[float, ...]]:
        """The corners of faces with all that they carry, rounded."""
        joined = np.concatenate([points, normals, colours, texture], axis=2).reshape(len(points), -1)
        turned = [
            np.roll(joined.reshape(-1, 3, 11), turn, axis=1).reshape(len(joined), -1) for turn in range(3)
        ]
        return {tuple(row) for row in np.round(np.concatenate(turned), 1) + 0.0}

    first = mesh.frame(mesh.frames[0])
    expected = rows(
        first.points[mesh.faces],
        first.normals[mesh.corner_normals],
        mesh.colours[mesh.faces],
        mesh.texture * (1, -1) + (0, 1),
    )
    shown = rows(
        player.points(0.0)[faces],
        attributes["NORMAL"][faces],
        attributes["COLOR_0"][faces][..., :3],
        attributes["TEXCOORD_0"][faces],
    )
    assert shown == expected


def test_a_clip_closes_only_where_its_last_frame_is_its_first() -> None:
    assert closes([KeyPoses.of(ball(there_and_back=True))]) and not closes([KeyPoses.of(ball())])


def test_the_validator_of_khronos_finds_no_fault(tmp_path: Path) -> None:
    paths = [
        written(tmp_path, drawn, look, plain)
        for drawn, look in (
            (painted_box(), "clay"),
            (ball(), "glass"),
            (ball(frames=range(1, 2)), "car_paint"),
        )
        for plain in (False, True, None)
        if look in LOOKS
    ]
    assert gltf_messages(*paths) == []


PAGE = """async (content) => {
  const url = (text) => URL.createObjectURL(new Blob([text], {type: 'text/javascript'}));
  const {GLTFLoader, THREE} = await import(url(content.three));
  const {MeshoptDecoder} = await import(url(content.meshopt));
  await MeshoptDecoder.ready;
  const bytes = Uint8Array.from(atob(content.file), (c) => c.charCodeAt(0)).buffer;
  const scene = await new GLTFLoader().setMeshoptDecoder(MeshoptDecoder).parseAsync(bytes, '');
  const mixer = new THREE.AnimationMixer(scene.scene), point = new THREE.Vector3();
  mixer.clipAction(scene.animations[0]).play();
  let mesh;
  scene.scene.traverse((each) => { if (each.isMesh) mesh = each; });
  return content.times.map((time) => {
    mixer.setTime(time);
    scene.scene.updateMatrixWorld(true);
    const count = mesh.geometry.attributes.position.count;
    return Array.from({length: count}, (_, v) => {
      mesh.getVertexPosition(v, point);
      return point.applyMatrix4(mesh.matrixWorld).toArray();
    });
  });
}"""


def test_three_js_plays_the_frames(tmp_path: Path, browser: Browser) -> None:
    if not installed_file().exists():
        pytest.skip("three.js is not set up here")
    moving = ball()
    numbers = [1, 10, 22]
    content = {
        "three": three_js_script("nothing plays"),
        "meshopt": (module("meshoptimizer") / "meshopt_decoder.mjs").read_text(),
        "file": base64.b64encode(written(tmp_path, moving).read_bytes()).decode(),
        "times": [(number - 1) / 24.0 for number in numbers],
    }
    tab = browser.new_page()
    for number, shown in zip(numbers, tab.evaluate(PAGE, content), strict=True):
        points, _ = moving.frame(number)
        assert np.linalg.norm(np.array(shown) - points, axis=1).max() <= MOST_ERROR * 0.3 + 1e-6
    tab.close()
