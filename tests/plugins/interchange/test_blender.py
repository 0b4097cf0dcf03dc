"""Blender opens exported stages and reads what was simulated. `make blender` installs Blender as a module."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from pxr import Usd, UsdGeom

from flowsculpt.pipeline.frames import FrameRange
from flowsculpt.pipeline.mesh.mesh_formats import ScenePart
from flowsculpt.pipeline.mesh.read import ModelFile
from flowsculpt.pipeline.plugins.interchange.unifying import Unification
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.production.store.readers import read_npz
from flowsculpt.pipeline.production.store.store import Store
from flowsculpt.render.post.image import read_exr
from tests.conftest import commanded
from tests.plugins.interchange.test_usd_instances import SHOT as COPIES
from tests.simulated_show import simulated

BLENDER = Path(os.environ.get("BLENDER_MODULE", Path(sys.prefix) / "cycles"))

pytestmark = [
    pytest.mark.soak,
    pytest.mark.skipif(not (BLENDER / "bpy").is_dir(), reason="Blender is not there: make blender"),
]

NAME = "T010_tiny"
SHOT = """\
title: A box, drawn through an attractor
frames: 1-120
subject: {solid: box, size: [2, 2, 2]}
resample: {max_edge_length: 0.4}
flows:
  - lorenz: {scale: 16, time_scale: {keys: {1: 0, 20: 0.25, 40: 0.1, 100: 0.1, 120: 0}}}
camera: {azimuth: {keys: {1: -30, 120: 20}}, elevation: 14, focal_length: 50, aperture: 2}
"""
SPUN = """\
title: A box, thrown
frames: 1-8
subject: {solid: box, size: [2, 2, 2]}
resample: {max_edge_length: 0.1}
flows:
  - twist: {axis: y, amount: {ease: linear, keys: {1: 0, 8: 60}}}
  - rotation: {axis: z, speed: 300}
camera: {azimuth: -30, elevation: 14, follow: 0}
shutter: {angle: 180}
look: clay
quality: {draft: {samples: 16, temporal_denoise: 0}}
"""


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("blender")
    simulated(root, SHOT)
    return root


def read_by_blender(file: Path, frames: list[int], result: Path) -> dict[str, np.ndarray]:
    script = Path(__file__).with_name("blender_reader.py")
    command = [sys.executable, "-P", str(script), str(file), json.dumps(frames), str(result)]
    environment = {**os.environ, "PYTHONPATH": str(BLENDER)}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=600)
    assert result.is_file(), done.stdout + done.stderr
    with np.load(result) as arrays:
        return dict(arrays)


def test_blender_reads_every_frame_of_an_alembic_file(root, tmp_path, monkeypatch):
    monkeypatch.chdir(root)
    code, words = commanded(root, "export", "abc", NAME, "-f", "5-40")
    assert code == 0, words
    file, frames = root / "renders" / NAME / "models" / f"{NAME}.abc", list(range(5, 41))
    read = read_by_blender(file, frames, tmp_path / "read.npz")
    assert read["range"].tolist() == [5, 40]
    mesh = Unification(
        Project(root, 1).request(root / "shots" / f"{NAME}.yaml", "draft", FrameRange.parse("5-40")),
        Store(root),
    ).one_mesh()
    upright = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]], np.float32)  # Blender has z up
    for number in frames:
        points = np.float32(mesh.frame(number).points) @ upright.T
        assert np.array_equal(read[f"{number}.points"], points), number
        turned, faces = read[f"{number}.faces"].reshape(-1, 3), mesh.faces
        starts = np.array(
            [np.flatnonzero(row == face[0])[0] for row, face in zip(turned, faces, strict=True)]
        )
        same = turned[np.arange(len(faces))[:, None], (starts[:, None] + np.arange(3)) % 3]
        assert np.array_equal(same, faces), "faces are counter-clockwise again"


def test_blender_reads_every_frame_of_a_stage_whose_topology_changes(root, tmp_path, monkeypatch):
    monkeypatch.chdir(root)
    code, words = commanded(root, "export", "usd", NAME)
    assert code == 0, words
    frames = list(range(1, 121))
    read = read_by_blender(root / "renders" / NAME / "usd" / f"{NAME}.usda", frames, tmp_path / "read.npz")
    assert read["range"].tolist() == [1, 120] and read["lights"].tolist() == ["back", "key", "rim"]
    project = Project(root, 1)
    framings = project.request(root / "shots" / f"{NAME}.yaml", "draft", variant="none").pictures.framings(
        project.store
    )
    upright = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])  # Blender has z up
    stage, counts = Usd.Stage.Open(str(root / "renders" / NAME / "usd" / f"{NAME}.usda")), set()
    velocities = UsdGeom.Mesh(stage.GetPrimAtPath(f"/{NAME}/sculpture")).GetVelocitiesAttr()
    for frame in frames:
        stored = read_npz(root / "renders" / NAME / "meshes" / f"{NAME}.{frame:04d}.npz")
        points = read[f"{frame}.points"]
        assert np.array_equal(points, stored["vertices"].astype(np.float32)), frame
        assert np.array_equal(read[f"{frame}.faces"].reshape(-1, 3), stored["faces"])
        assert np.allclose(read[f"{frame}.velocity"], velocities.Get(float(frame)), atol=1e-6)
        assert np.array_equal(read[f"{frame}.rest"], stored["attribute:rest"].astype(np.float32))
        faces = points[stored["faces"]]
        flat = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
        corners = read[f"{frame}.normals"].reshape(-1, 3, 3)
        assert np.median(np.einsum("fcx,fx->fc", corners, flat) / np.linalg.norm(flat, axis=1)[:, None]) > 0.9
        camera = framings[frame].camera
        assert np.allclose(read[f"{frame}.camera"][:3, 3], upright @ camera.origin, atol=1e-4)
        assert np.allclose(read[f"{frame}.lens"], [50.0, 36.0, camera.focus_distance], rtol=1e-4)
        counts.add(len(points))
    assert len(counts) > 30
    assert np.abs(read["60.velocity"]).max() > 0.1


@pytest.mark.parametrize(("form", "earlier"), [("usd", 0), ("gltf", 1)])
def test_blender_shows_rigid_copies_as_instances_where_they_are_at_each_frame(
    form, earlier, tmp_path, monkeypatch
):
    (tmp_path / "shots").mkdir()
    (tmp_path / "shots" / f"{NAME}.yaml").write_text(COPIES)
    monkeypatch.chdir(tmp_path)
    code, words = commanded(tmp_path, "export", form, NAME, "--instances")
    assert code == 0, words
    places = {"usd": f"usd/{NAME}.instances.usda", "gltf": f"models/{NAME}.instances.glb"}
    file = tmp_path / "renders" / NAME / places[form]
    shown = [number - earlier for number in range(1, 5)]  # the first key of a glTF is at frame 0
    read = read_by_blender(file, shown, tmp_path / "read.npz")
    request = Project(tmp_path, 1).request(tmp_path / "shots" / f"{NAME}.yaml", "draft")
    mesh = Unification(request.parts[0], Store(tmp_path)).one_mesh()
    upright = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]], np.float32)  # Blender has z up
    sizes = set()
    for number in range(1, 5):
        found = read[f"{number - earlier}.shapes"]
        true = (mesh.points_at(number) @ upright.T).reshape(20, -1, 3)
        assert len(found) == 20
        middles, ours = found.mean(axis=1), true.mean(axis=1)
        which = np.linalg.norm(middles[:, None] - ours[None], axis=2).argmin(axis=1)
        assert sorted(which) == list(range(20)), "each copy is shown once"
        for points, copy in zip(found, which, strict=True):
            apart = np.linalg.norm(points[:, None] - true[copy][None], axis=2)
            assert max(apart.min(axis=0).max(), apart.min(axis=1).max()) < 1e-3  # USD: half floats
            sizes.add(round(float(np.ptp(points, axis=0).max()), 2))
    assert len(sizes) > 5, "copies differ in size"


def test_blender_reads_the_ply_with_velocities_and_rest_positions(root, tmp_path, monkeypatch):
    monkeypatch.chdir(root)
    code, words = commanded(root, "export", "ply", NAME, "-f", "60")
    assert code == 0, words
    file = root / "renders" / NAME / "models" / f"{NAME}.0060.ply"
    read = read_by_blender(file, [1], tmp_path / "read.npz")
    stored = read_npz(root / "renders" / NAME / "meshes" / f"{NAME}.0060.npz")
    assert np.array_equal(read["1.points"], stored["vertices"].astype(np.float32))
    assert np.array_equal(read["1.faces"].reshape(-1, 3), stored["faces"])
    rest = np.hstack([read[f"1.rest_{axis}"] for axis in "xyz"])
    assert np.array_equal(rest, stored["attribute:rest"].astype(np.float32))
    assert np.abs(np.hstack([read[f"1.velocity_{axis}"] for axis in "xyz"])).max() > 0.1


def test_cycles_renders_an_exported_frame_as_we_do_blurred_by_motion(tmp_path, monkeypatch):
    simulated(tmp_path, SPUN)
    monkeypatch.chdir(tmp_path)
    for words in (("export", "usd", NAME), ("render", NAME, "-f", "5", "-q", "draft")):
        code, said = commanded(tmp_path, *words)
        assert code == 0, said
    home, theirs = tmp_path / "renders" / NAME, tmp_path / "cycles.exr"
    words = [str(home / "usd" / f"{NAME}.usda"), "5", "480", "270", "16", "0.5", str(theirs)]
    command = [sys.executable, "-P", str(Path(__file__).with_name("blender_render.py")), *words]
    environment = {**os.environ, "PYTHONPATH": str(BLENDER)}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=600)
    assert theirs.is_file(), done.stdout + done.stderr
    ours = read_exr(home / "draft" / "frames" / f"{NAME}.0005.exr")[0]["beauty"]
    pixels = oiio.ImageBuf(str(theirs)).get_pixels(oiio.FLOAT)[..., :3]
    assert np.allclose(ours.mean(axis=(0, 1)), pixels.mean(axis=(0, 1)), rtol=0.02)
    apart = np.abs(ours - pixels).mean(axis=2) / (ours.mean(axis=2) + 0.05)
    assert np.median(apart) < 0.03 and np.quantile(apart, 0.98) < 0.15


WRITER = """\
import sys
import bpy, numpy as np
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.mesh.primitive_torus_add(location=(3, 0, 1), rotation=(0.3, 0.2, 0.1))
torus = bpy.context.object
torus.name, torus.scale = "torus", (1, 2, -1)
bpy.ops.mesh.primitive_cube_add(location=(-3, 0, 0))
crease = bpy.context.object.data.attributes.new("crease_edge", "FLOAT", "EDGE")
crease.data[0].value = 1.0
bpy.ops.wm.usd_export(filepath=sys.argv[1], root_prim_path="/scene")
bpy.context.view_layer.update()
place = np.array(torus.matrix_world)
points = np.array([vertex.co for vertex in torus.data.vertices])
np.savez(sys.argv[2], points=points @ place[:3, :3].T + place[:3, 3], faces=len(torus.data.polygons))
"""


def test_a_stage_that_blender_wrote_is_read_as_it_stands_there(tmp_path: Path) -> None:
    script, stage, result = tmp_path / "write.py", tmp_path / "scene.usdc", tmp_path / "scene.npz"
    script.write_text(WRITER)
    command = [sys.executable, "-P", str(script), str(stage), str(result)]
    environment = {**os.environ, "PYTHONPATH": str(BLENDER)}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=600)
    assert result.is_file(), done.stdout + done.stderr
    with np.load(result) as arrays:
        points, faces = arrays["points"], int(arrays["faces"])
    torus = ModelFile(stage, ScenePart("/scene/torus")).surface()
    assert ModelFile(stage).up() == "z" and torus.faces == faces and torus.repairs == ()
    assert np.allclose(torus.mesh.vertices, points, atol=1e-6)
    both = ModelFile(stage).surface()
    assert (both.vertices, both.faces, len(both.mesh.creases)) == (len(points) + 8, faces + 6, 1)
