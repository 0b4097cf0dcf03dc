"""Frames as mesh files: other programs read the numbers that were written, and printed models are closed."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from pxr import Sdf

from flowsculpt.pipeline.arrays import Floats
from flowsculpt.pipeline.errors import MeshError
from flowsculpt.pipeline.mesh import TriangleMesh, box, icosphere
from flowsculpt.pipeline.mesh.normals import split_at_creases
from flowsculpt.pipeline.mesh.read import ModelFile, read_mesh
from flowsculpt.pipeline.plugins.interchange.exported_frame import ExportedFrame
from flowsculpt.pipeline.plugins.interchange.mesh_writers import write_mesh
from flowsculpt.pipeline.plugins.interchange.model_export import (
    PrintReport,
    point_normals,
    print_model,
    wall_thickness,
    write_glb,
    write_obj,
    write_ply,
)
from flowsculpt.pipeline.plugins.interchange.ply_files import read_polygon_file
from flowsculpt.pipeline.plugins.interchange.usd_export import sampled_attributes, write_clip
from flowsculpt.pipeline.plugins.points.point_files import read_points
from flowsculpt.render.scene.materials import LOOKS
from flowsculpt.render.scene.rgb_spaces import linear_of_srgb, srgb_of_linear
from tests.conftest import commanded
from tests.simulated_show import simulated

READERS = """
import sys, threading
from concurrent.futures import ThreadPoolExecutor
from flowsculpt import read_mesh

ready = threading.Barrier(4)

def read(_):
    ready.wait()
    return len(read_mesh(sys.argv[1]).faces)

with ThreadPoolExecutor(4) as pool:
    print(*pool.map(read, range(4)))
"""

NAME = "T010_tiny"
SHOT = """\
title: A box, twisted
frames: 1-4
subject: {solid: box, size: [2, 2, 2]}
resample: {max_edge_length: 0.5}
flows: [twist: {axis: y, amount: {ease: linear, keys: {1: 0, 4: 60}}}]
"""
NUMBERS = st.floats(-1e3, 1e3, width=32)


@st.composite
def frames(draw: st.DrawFn) -> ExportedFrame:
    """Frames of some closed surface with any attributes, of any number of vertices."""
    mesh = draw(st.sampled_from([box(1), box(2), icosphere(2), icosphere(3)]))
    split, count = split_at_creases(mesh), len(mesh.vertices)
    seed = draw(st.integers(0, 2**32 - 1))
    random = np.random.default_rng(seed)
    moved = mesh.vertices + 0.05 * random.uniform(-1.0, 1.0, (count, 3))

    def vectors(rows: int) -> Floats:
        scale = draw(NUMBERS)
        return (scale * random.uniform(-1.0, 1.0, (rows, 3))).astype(np.float32).astype(np.float64)

    return ExportedFrame(
        points=single(draw(st.floats(0.01, 1000.0)) * moved).astype(np.float64),
        faces=mesh.faces,
        normals=split.normals,
        corner_normals=split.faces,
        velocities=vectors(count),
        rest=vectors(count),
        creases=mesh.creases,
        colours=random.uniform(0.0, 1.0, (count, 3)) if draw(st.booleans()) else None,
        texture=random.uniform(-3.0, 3.0, (len(mesh.faces), 3, 2)) if draw(st.booleans()) else None,
    )


def single(values: Floats) -> NDArray[np.float32]:
    return np.asarray(values).astype(np.float32)


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("files")


@pytest.mark.slow
@settings(max_examples=25, deadline=None)
@given(frames(), st.integers(-100, 100_000))
def test_a_clip_holds_every_attribute_as_float32(place: Path, frame: ExportedFrame, number: int) -> None:
    attributes = sampled_attributes(False, frame.colours is not None, frame.texture is not None)
    write_clip(place / "a.usdc", "/a/sculpture", number, frame, attributes)
    layer = Sdf.Layer.OpenAsAnonymous(str(place / "a.usdc"))
    assert {spec.name for spec in layer.GetPrimAtPath("/a/sculpture").properties} == {
        attribute.name for attribute in attributes
    }
    for attribute in attributes:
        path = f"/a/sculpture.{attribute.name}"
        assert layer.ListTimeSamplesForPath(path) == [float(number)]
        assert not layer.GetAttributeAtPath(path).HasDefaultValue()
        read, written = np.array(layer.QueryTimeSample(path, float(number))), attribute.values(frame)
        assert written is not None and np.array_equal(read.reshape(written.shape), written.astype(read.dtype))


@settings(max_examples=20, deadline=None)
@given(frames())
def test_other_programs_read_the_ply_that_was_written(place: Path, frame: ExportedFrame) -> None:
    path = place / "a.ply"
    write_ply(path, frame)
    read = meshio.read(path)
    assert np.array_equal(read.points, frame.points)
    assert np.array_equal(read.cells_dict["triangle"], frame.faces)
    for name, values in (("velocity", frame.velocities), ("rest", frame.rest)):
        columns = np.stack([read.point_data[f"{name}_{axis}"] for axis in "xyz"], axis=1)
        assert np.array_equal(columns, single(values))
    normals = np.stack([read.point_data[name] for name in ("nx", "ny", "nz")], axis=1)
    assert np.array_equal(normals, point_normals(frame))
    if frame.colours is not None:
        channels = [read.point_data[name].view(np.uint8) for name in ("red", "green", "blue")]
        shown = np.stack(channels, axis=1)  # meshio 5.3.5 takes uchar for signed in binary files
        assert np.abs(shown / 255.0 - srgb_of_linear(frame.colours)).max() <= 0.5 / 255.0 + 1e-9
    given = read_polygon_file(path.read_bytes()).normals
    assert given is not None
    sides = [np.unique(frame.corner_normals[frame.faces == vertex]) for vertex in range(len(frame.points))]
    assert [not normal.any() for normal in given] == [len(rows) > 1 for rows in sides]
    ours = read_mesh(path)
    assert np.array_equal(ours.vertices, frame.points) and np.array_equal(ours.faces, frame.faces)
    theirs = trimesh.load(path, process=False)
    assert np.array_equal(theirs.vertices, frame.points) and np.array_equal(theirs.faces, frame.faces)
    if frame.colours is not None:
        assert np.array_equal(theirs.visual.vertex_colors[:, :3], shown)


@settings(max_examples=20, deadline=None)
@given(frames())
def test_the_obj_has_a_normal_and_texture_coordinates_for_each_corner(
    place: Path, frame: ExportedFrame
) -> None:
    path = place / "a.obj"
    write_obj(path, frame)
    rows: dict[str, list[list[str]]] = {"v": [], "vt": [], "vn": [], "f": [], "t": []}
    for line in path.read_text().splitlines():
        kind, *words = line.split()
        rows[kind].append(words)
    vertices = np.array(rows["v"], dtype=np.float64)
    assert np.array_equal(single(vertices[:, :3]), single(frame.points))
    corners = np.array([[word.split("/") for word in face] for face in rows["f"]])
    assert np.array_equal(corners[..., 0].astype(int) - 1, frame.faces)
    normals = np.array(rows["vn"], dtype=np.float64)[corners[..., 2].astype(int) - 1]
    assert np.array_equal(single(normals), single(frame.normals[frame.corner_normals]))
    if frame.texture is not None:
        read = np.array(rows["vt"], dtype=np.float64)[corners[..., 1].astype(int) - 1]
        assert np.array_equal(single(read), single(frame.texture))
    if frame.colours is not None:
        assert np.allclose(linear_of_srgb(vertices[:, 3:]), frame.colours, atol=1e-7)
    assert len(rows["t"]) == len(frame.creases)
    theirs = trimesh.load(path, process=False, maintain_order=True)
    assert np.allclose(np.sort(theirs.bounds, axis=0), [frame.points.min(axis=0), frame.points.max(axis=0)])
    assert len(theirs.faces) == len(frame.faces)


@settings(max_examples=20, deadline=None)
@given(frames())
def test_the_glb_holds_normals_velocities_and_rest_positions(place: Path, frame: ExportedFrame) -> None:
    path = place / "a.glb"
    write_glb(path, frame, LOOKS["chrome"])
    scene = gltf_arrays(path)
    corners, faces = scene["indices"].reshape(-1), frame.faces.reshape(-1)
    expected = {
        "POSITION": frame.points[faces],
        "NORMAL": frame.normals[frame.corner_normals.reshape(-1)],
        "_VELOCITY": frame.velocities[faces],
        "_REST": frame.rest[faces],
    }
    if frame.colours is not None:
        expected["COLOR_0"] = np.hstack([frame.colours[faces], np.ones((len(faces), 1))])
    if frame.texture is not None:
        expected["TEXCOORD_0"] = frame.texture.reshape(-1, 2) * (1.0, -1.0) + (0.0, 1.0)
    assert scene.keys() == {"indices", *expected}
    for name, values in expected.items():
        assert np.array_equal(scene[name][corners], single(values)), name
    if frame.texture is None:
        assert len(scene["POSITION"]) == len(frame.normals)
    (model,) = trimesh.load(path, process=False).geometry.values()
    assert np.array_equal(single(model.vertices[model.faces]), single(frame.points[frame.faces]))
    material = model.visual.material
    assert (material.metallicFactor, material.roughnessFactor) == (1.0, pytest.approx(0.2))


def gltf_arrays(path: Path) -> dict[str, NDArray[Any]]:
    """Return the attributes of the one mesh in a GLB as they are stored, and the indices of its faces."""
    content = path.read_bytes()
    length = int.from_bytes(content[12:16], "little")
    tree, binary = json.loads(content[20 : 20 + length]), content[28 + length :]
    (mesh,) = tree["meshes"]
    (primitive,) = mesh["primitives"]
    arrays = {}
    for name, number in {"indices": primitive["indices"], **primitive["attributes"]}.items():
        accessor = tree["accessors"][number]
        view = tree["bufferViews"][accessor["bufferView"]]
        kind = {5126: "<f4", 5125: "<u4", 5121: "u1"}[accessor["componentType"]]
        columns = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}[accessor["type"]]
        start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        values = np.frombuffer(binary, kind, columns * accessor["count"], start)
        arrays[name] = values.reshape(-1, columns)
    return arrays


@settings(max_examples=15, deadline=None)
@given(frames(), st.sampled_from(["ply", "obj", "stl"]))
def test_models_read_what_was_exported_to_the_last_bit_of_float32(
    place: Path, frame: ExportedFrame, form: str
) -> None:
    path = place / f"again.{form}"
    if form == "stl":
        write_mesh(TriangleMesh(frame.points, frame.faces), path)
    else:
        (write_ply if form == "ply" else write_obj)(path, frame)
    read = ModelFile(path).surface()
    assert read.repairs == ()
    mesh = read.mesh.triangulated()
    assert np.array_equal(single(mesh.vertices[mesh.faces]), single(frame.points[frame.faces]))
    if form != "stl":
        assert np.array_equal(mesh.faces, frame.faces)
    if form == "obj":
        assert edges(mesh.creases) == edges(frame.creases)
    if form == "ply":
        attributes = read_points(path).attributes
        for name, values in (("velocity", frame.velocities), ("rest", frame.rest)):
            columns = np.stack([attributes[f"{name}_{axis}"] for axis in "xyz"], axis=1)
            assert np.array_equal(columns, single(values))
        if frame.colours is not None:
            channels = [attributes[f"linear_{channel}"] for channel in ("red", "green", "blue")]
            assert np.array_equal(np.stack(channels, axis=1), single(frame.colours))


def edges(pairs: NDArray[Any]) -> set[tuple[int, ...]]:
    return {tuple(sorted(pair)) for pair in pairs.tolist()}


@pytest.mark.slow
@settings(max_examples=2, deadline=None)
@given(frames())
def test_a_glb_is_read_as_the_surface_before_its_vertices_were_split(
    place: Path, frame: ExportedFrame
) -> None:
    path = place / "again.glb"
    write_glb(path, frame, LOOKS["clay"])
    read = ModelFile(path).surface()
    mesh = read.mesh.triangulated()
    assert len(mesh.vertices) == len(frame.points) and read.repairs == ()
    assert np.array_equal(single(mesh.vertices[mesh.faces]), single(frame.points[frame.faces]))


def still(mesh: TriangleMesh) -> ExportedFrame:
    nothing = np.zeros_like(mesh.vertices)
    return ExportedFrame(
        mesh.vertices, mesh.faces, nothing, mesh.faces, nothing, mesh.vertices, np.empty((0, 2), np.int32)
    )


def test_a_printed_model_is_closed_upright_and_of_the_size_asked_for(tmp_path: Path) -> None:
    tall = box(3).with_vertices(box(3).vertices * (0.5, 2.0, 0.25))
    model = print_model(still(tall), 80.0, "tall")
    write_mesh(model, tmp_path / "a.stl")
    read = trimesh.load(tmp_path / "a.stl")
    assert read.is_watertight and read.is_winding_consistent
    assert np.allclose(read.bounds, [[-10.0, -5.0, 0.0], [10.0, 5.0, 80.0]], atol=1e-4)
    report = PrintReport.of(model)
    assert report.size == pytest.approx((20.0, 10.0, 80.0)) and report.volume == pytest.approx(16000.0)
    assert report.thinnest == pytest.approx(10.0) and report.crossings == 0
    assert "20.0 × 10.0 × 80.0 mm, 16 cm³, 12 triangles, closed." in report.in_words()
    inside_out = TriangleMesh(tall.vertices, tall.faces[:, ::-1])
    assert PrintReport.of(print_model(still(inside_out), 80.0, "tall")).volume == pytest.approx(16000.0)


def test_the_thinnest_wall_is_that_between_two_surfaces() -> None:
    ball, hollow = icosphere(8), icosphere(8)
    shell = TriangleMesh(
        np.concatenate([ball.vertices, 0.9 * hollow.vertices]),
        np.concatenate([ball.faces, hollow.faces[:, ::-1] + len(ball.vertices)]),
    )
    assert wall_thickness(shell).min() == pytest.approx(0.1, rel=0.05)
    assert np.allclose(wall_thickness(box(4)), np.ptp(box(4).vertices))
    brute = np.median(wall_thickness(icosphere(8)))
    assert brute == pytest.approx(2.0, rel=0.03)


def test_an_open_surface_is_refused_with_a_remedy() -> None:
    mesh = box(2)
    with pytest.raises(MeshError, match=r"A frame 3: 3 edges have a face on one side only; a printer needs"):
        print_model(still(TriangleMesh(mesh.vertices, mesh.faces[1:])), 100.0, "A frame 3")


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("models")
    simulated(root, SHOT)
    return root


def test_ranges_are_written_once_and_stills_refuse_them(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(root)
    folder = root / "renders" / NAME / "models"
    for form in ("ply", "obj"):
        names = [f"{NAME}.{n:04d}.{form}" for n in (2, 3)]
        code, words = commanded(root, "export", form, NAME, "-f", "2-3", "--json")
        assert code == 0 and json.loads(words)["written"] == names
        code, words = commanded(root, "export", form, NAME, "-f", "2-3", "--json")
        assert code == 0 and json.loads(words)["written"] == []
        assert all((folder / name).is_file() for name in names)
    for form in ("glb", "stl"):
        code, words = commanded(root, "export", form, NAME, "-f", "2-3")
        assert code == 2 and f"{form.upper()} holds one; choose it with -f" in words and "usd, ply" in words
        assert commanded(root, "export", form, NAME)[0] == 2
    code, words = commanded(root, "export", "stl", NAME, "-f", "4", "--size", "50", "--json")
    told = json.loads(words)
    assert code == 0 and max(told["model"]["size"]) == pytest.approx(50.0) and told["model"]["unit"] == "mm"
    assert trimesh.load(folder / f"{NAME}.0004.stl").is_watertight
    again = json.loads(commanded(root, "export", "stl", NAME, "-f", "4", "--size", "50", "--json")[1])
    assert again["written"] == [] and again["model"] == told["model"]
    (folder / f"{NAME}.0002.ply").write_bytes(b"ply")
    told = json.loads(commanded(root, "export", "ply", NAME, "-f", "2-3", "--json")[1])
    assert told["written"] == [f"{NAME}.0002.ply"]


@pytest.mark.slow
def test_processes_that_read_models_import_no_numba() -> None:
    readers = ("fbx_files", "fbx_paint", "gltf_files", "gltf_paint", "usd_files", "usd_paint")
    imports = "".join(f"import flowsculpt.pipeline.plugins.interchange.{reader}\n" for reader in readers)
    checked = f"{imports}import sys\nassert 'numba' not in sys.modules"
    subprocess.run([sys.executable, "-c", checked], check=True)


@pytest.mark.slow
def test_threads_read_their_first_files_at_once(tmp_path: Path) -> None:
    """Plug-ins, which bring the formats, are looked for then."""
    write_mesh(icosphere(2), tmp_path / "ball.obj")
    command = [sys.executable, "-c", READERS, str(tmp_path / "ball.obj")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert (done.stdout, done.stderr) == ("80 80 80 80\n", "")
