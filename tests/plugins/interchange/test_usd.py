"""A shot as a USD stage: what other programs read is what was simulated, at frames and between them."""

from __future__ import annotations

import json
import math
import shutil
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from pxr import Gf, Usd, UsdGeom, UsdLux, UsdShade, UsdValidation

from flowsculpt.pipeline.animation import MeshFrame, animate, mesh_at_subframe
from flowsculpt.pipeline.errors import FrameError
from flowsculpt.pipeline.mesh.normals import split_at_creases
from flowsculpt.pipeline.plugins.interchange.usd_export import UsdExport, add_floor, clip_times
from flowsculpt.pipeline.plugins.interchange.usd_prims import add_lights
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.production.store.readers import read_npz
from flowsculpt.pipeline.shot import read_shot
from flowsculpt.render.post.image import read_exr, write_png
from flowsculpt.render.scene import clear_sky
from flowsculpt.render.scene.scene_lights import LightRig
from flowsculpt.render.scene.sky import Daylight
from tests.conftest import commanded
from tests.full_disk import disk_of
from tests.needed_plugins import needs_plugins
from tests.simulated_show import simulated

NAME = "T010_tiny"
FOLDER = Path("renders") / NAME / "usd"
SHOT = """\
title: A box, pulled apart
frames: 1-6
rate: 30
subject: {solid: box, size: [2, 2, 2]}
resample: {max_edge_length: 0.5}
flows:
  - twist: {axis: y, amount: {ease: linear, keys: {1: 0, 6: 90}}}
  - lorenz: {scale: 16, time_scale: {keys: {1: 0, 4: 0.6}}}
camera: {azimuth: {keys: {1: -30, 6: 20}}, elevation: 14, focal_length: 50, aperture: 2, unit: 100}
shutter: {angle: 180}
look: speed
"""
CLOUD = """\
title: Motes
frames: 1-3
subject: {cloud: {solid: icosphere, radius: 0.75}, count: 200, seed: 8, radius: 0.05}
flows: [translation: {rate: [3, 0, 0]}]
look: glass
lights: daylight
"""
NET = """\
title: A net
frames: 1-2
subject: {net: {solid: tube, length: 2}, rows: 6, columns: 7}
flows: [translation: {rate: [3, 0, 0]}]
look: chrome
"""
TEXTURED = """\
title: A slide
frames: 1-2
subject: {solid: icosphere, radius: 1}
resample: {max_edge_length: 0.2}
flows: [translation: {rate: [3, 0, 0]}]
look: {material: clay, colour: halves.png, projection: {kind: planar, scale: 4}}
"""


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project whose shot is simulated and exported."""
    root = tmp_path_factory.mktemp("usd")
    simulated(root, SHOT)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(root)
        code, words = commanded(root, "export", "usd", NAME)
    assert code == 0, words
    return root


@pytest.fixture
def stage(root: Path) -> Usd.Stage:
    return Usd.Stage.Open(str(root / FOLDER / f"{NAME}.usda"))


def sculpture(stage: Usd.Stage) -> UsdGeom.Mesh:
    return UsdGeom.Mesh(stage.GetPrimAtPath(f"/{NAME}/sculpture"))


def stored(root: Path, number: int) -> dict[str, NDArray[np.float64]]:
    return read_npz(root / "renders" / NAME / "meshes" / f"{NAME}.{number:04d}.npz")


def opened(path: Path) -> Usd.Stage:
    """Open a stage as it is on the disk; USD keeps layers that it has read."""
    stage = Usd.Stage.Open(str(path))
    stage.Reload()
    return stage


def findings(path: Path) -> list[str]:
    """Return what USD's validators find. usd-core knows no nodes of MaterialX: see test_openpbr.py."""
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    errors = UsdValidation.ValidationContext(validators).Validate(opened(path))
    said = [f"{error.GetName()}: {error.GetMessage()}" for error in errors]
    return [one for one in said if not one.startswith("MissingShaderIdInRegistry: shaderId 'ND_")]


def test_the_validators_of_usd_find_nothing(root):
    assert findings(root / FOLDER / f"{NAME}.usda") == []


@pytest.mark.slow
def test_exported_frames_come_back_as_models_to_the_last_bit(root, stage, tmp_path):
    source = root / FOLDER / f"{NAME}.usda"
    for frame in (1, 5):
        part = f"prim: /{NAME}/sculpture, time_code: {frame}"
        text = f"title: A\nframes: 1-2\nsubject: {{model: {source}, {part}}}\nresample: off\nflows: []\n"
        model = read_shot(tmp_path / "a.yaml", text)
        read, arrays, time = model.motion.mesh_at_rest(), stored(root, frame), float(frame)
        assert np.array_equal(read.vertices, arrays["vertices"].astype(np.float32).astype(np.float64))
        assert np.array_equal(read.faces, arrays["faces"])
        creases = np.array(sculpture(stage).GetCreaseIndicesAttr().Get(time)).reshape(-1, 2)
        assert len(creases) and np.array_equal(np.unique(creases, axis=0), np.unique(read.creases, axis=0))
        assert len(model.files) == 8  # the stage, its manifest and six clips


def test_every_frame_is_the_mesh_that_was_simulated(root, stage):
    mesh, counts = sculpture(stage), set()
    shot = read_shot(root / "shots" / f"{NAME}.yaml")
    for frame in Project(root, 1).request(root / "shots" / f"{NAME}.yaml", "draft").requested:
        arrays, time = stored(root, frame), float(frame)
        points = np.array(mesh.GetPointsAttr().Get(time))
        assert np.array_equal(points, arrays["vertices"].astype(np.float32))
        faces = np.array(mesh.GetFaceVertexIndicesAttr().Get(time)).reshape(-1, 3)
        assert np.array_equal(faces, arrays["faces"])
        assert len(mesh.GetFaceVertexCountsAttr().Get(time)) == len(faces)
        normals = UsdGeom.PrimvarsAPI(mesh).GetPrimvar("normals")
        assert normals.GetInterpolation() == UsdGeom.Tokens.faceVarying
        welded = MeshFrame.from_arrays(arrays, frame).mesh
        split = split_at_creases(welded, shot.motion.thresholds_at(frame).hard_angles(welded))
        corners = split.normals[split.faces].reshape(-1, 3).astype(np.float32)
        assert np.array_equal(np.array(normals.ComputeFlattened(time)), corners)
        creases = np.array(mesh.GetCreaseIndicesAttr().Get(time)).reshape(-1, 2)
        assert len(creases) and np.array_equal(creases, arrays["creases"])
        assert set(mesh.GetCreaseLengthsAttr().Get(time)) <= {2}
        low, high = np.array(mesh.GetExtentAttr().Get(time))
        assert np.array_equal(low, points.min(axis=0)) and np.array_equal(high, points.max(axis=0))
        counts.add(len(points))
    assert len(counts) > 2, "the number of vertices changes"


def test_between_frames_the_topology_holds_and_velocities_lead_to_the_next_frame(root, stage):
    mesh = sculpture(stage)
    for frame in (1, 2, 3, 4, 5):
        for share in (0.25, 0.5, 0.99):
            time = Usd.TimeCode(frame + share)
            held = np.array(mesh.GetPointsAttr().Get(time))
            assert np.allclose(held, mesh.GetPointsAttr().Get(float(frame)), rtol=1e-6, atol=1e-7)
            indices = mesh.GetFaceVertexIndicesAttr()
            assert indices.Get(time) == indices.Get(float(frame))
        velocities = np.array(mesh.GetVelocitiesAttr().Get(float(frame)))
        points = np.array(mesh.GetPointsAttr().Get(float(frame)))
        halfway = np.array(mesh.ComputePointsAtTime(Usd.TimeCode(frame + 0.5), Usd.TimeCode(frame + 0.5)))
        assert np.allclose(halfway, points + velocities * (0.5 / 30.0), atol=1e-5)
    assert list(clip_times((1, 2, 5))) == [(1, 1), (2, 1), (2, 2), (5, 2), (5, 5), (6, 5)]


def test_velocities_are_those_of_the_flow_in_scene_units_per_second(root, stage):
    shot = read_shot(root / "shots" / f"{NAME}.yaml")
    frame = next(frame for frame in animate(shot) if frame.number == 3)
    ahead, back = (mesh_at_subframe(shot.motion, frame, 3.0 + step).vertices for step in (1 / 64, -1 / 64))
    expected = (ahead - back) * 32.0 * 30.0
    assert np.allclose(sculpture(stage).GetVelocitiesAttr().Get(3.0), expected, rtol=1e-5, atol=1e-5)


def test_rest_positions_and_colours_lie_at_the_vertices(root, stage):
    primvars = UsdGeom.PrimvarsAPI(sculpture(stage))
    for frame in (1.0, 5.0):
        count = len(sculpture(stage).GetPointsAttr().Get(frame))
        rest = np.array(primvars.GetPrimvar("rest").Get(frame))
        assert rest.shape == (count, 3) and np.abs(rest).max() <= 1.0 + 1e-6  # the box is 2 wide
        colours = np.array(primvars.GetPrimvar("displayColor").Get(frame))
        assert colours.shape == (count, 3) and colours.min() >= 0.0 and colours.max() <= 1.0
    shader = UsdShade.MaterialBindingAPI(sculpture(stage)).ComputeBoundMaterial()[0].ComputeSurfaceSource()[0]
    source = shader.GetInput("diffuseColor").GetConnectedSource()[0]
    assert UsdShade.Shader(source.GetPrim()).GetInput("varname").Get() == "displayColor"


def test_ground_that_fades_has_an_opacity_at_each_vertex(tmp_path):
    text = "title: a\nframes: 1-1\nsubject: {solid: icosphere}\nresample: off\n"
    stage = Usd.Stage.CreateInMemory()
    shot = read_shot(tmp_path / "a.yaml", f"{text}stage: {{kind: ground, horizon_fade: 0.2}}\n")
    floor = shot.picture.stage
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/a").GetPrim())
    UsdGeom.Scope.Define(stage, "/a/materials")
    add_floor(stage, "/a", shot)
    opacity = np.array(UsdGeom.Mesh(stage.GetPrimAtPath("/a/set/floor")).GetDisplayOpacityAttr().Get())
    assert np.array_equal(opacity, floor.opacity_at(floor.mesh()[0])) and np.ptp(opacity) == 1.0
    source = (
        UsdShade.Shader.Get(stage, "/a/materials/floor/surface").GetInput("opacity").GetConnectedSources()
    )
    reader = UsdShade.Shader(source[0][0].source.GetPrim())
    assert reader.GetInput("varname").Get() == "displayOpacity"
    assert reader.GetIdAttr().Get() == "UsdPrimvarReader_float"
    stage.GetRootLayer().Export(str(tmp_path / "a.usda"))
    assert [fault for fault in findings(tmp_path / "a.usda") if "metersPerUnit" not in fault] == []


def test_the_stage_says_its_axis_unit_rate_and_range(stage):
    assert stage.GetDefaultPrim().GetPath() == f"/{NAME}"
    assert UsdGeom.GetStageUpAxis(stage) == "Y" and UsdGeom.GetStageMetersPerUnit(stage) == 0.1
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (1.0, 6.0)
    assert stage.GetTimeCodesPerSecond() == stage.GetFramesPerSecond() == 30.0
    assert sculpture(stage).GetSubdivisionSchemeAttr().Get() == "none"


def test_the_camera_shows_what_our_pictures_show(root, stage):
    camera = UsdGeom.Camera(stage.GetPrimAtPath(f"/{NAME}/camera"))
    project = Project(root, 1)
    request = project.request(root / "shots" / f"{NAME}.yaml", "draft", variant="none")
    framings = request.pictures.framings(project.store)
    points = np.random.default_rng(3).uniform(-1.0, 1.0, (50, 3))
    for frame in (1, 3, 6):
        ours, theirs = framings[frame].camera, camera.GetCamera(float(frame))
        seen = theirs.frustum.ComputeViewMatrix() * theirs.frustum.ComputeProjectionMatrix()
        projected = [tuple(seen.Transform(Gf.Vec3d(*point)))[:2] for point in points.tolist()]
        assert np.allclose(projected, ours.project(points, request.pictures.aspect)[:, :2], atol=1e-5)
        assert math.isclose(theirs.fStop, 2.0, rel_tol=1e-5)
        assert math.isclose(theirs.focusDistance, ours.focus_distance, rel_tol=1e-6)
        assert math.isclose(theirs.focalLength * 10.0, 50.0, rel_tol=1e-6)  # 0.1 m a unit
        diameter = theirs.focalLength / 10.0 / theirs.fStop
        assert math.isclose(diameter, 2.0 * ours.lens_radius, rel_tol=1e-5)
    assert (camera.GetShutterOpenAttr().Get(), camera.GetShutterCloseAttr().Get()) == (-0.25, 0.25)


def test_softboxes_keep_their_place_size_and_radiance(root, stage):
    project = Project(root, 1)
    request = project.request(root / "shots" / f"{NAME}.yaml", "draft", variant="none")
    placement = request.pictures.framings(project.store)[2].placement
    boxes = request.shot.picture.lights.softboxes
    assert len(boxes) > 1
    for box in boxes:
        light = UsdLux.RectLight(stage.GetPrimAtPath(f"/{NAME}/set/lights/{box.name}"))
        power = light.GetIntensityAttr().Get(2.0) * np.array(light.GetColorAttr().Get())
        area = box.width * box.height * placement.size**2
        assert np.allclose(power / area, box.radiance, rtol=1e-5) and light.GetNormalizeAttr().Get()
        matrix = np.array(UsdGeom.Xformable(light).ComputeLocalToWorldTransform(2.0))
        place = placement.matrix() @ [*box.position, 1.0]
        towards = placement.matrix() @ [*np.subtract(box.target, box.position), 0.0]
        assert np.allclose(matrix[3, :3], place[:3])
        assert np.allclose(
            -matrix[2, :3] / np.linalg.norm(matrix[2, :3]), towards[:3] / np.linalg.norm(towards)
        )
        assert math.isclose(np.linalg.norm(matrix[0, :3]), placement.size, rel_tol=1e-6)
        assert (light.GetWidthAttr().Get(), light.GetHeightAttr().Get()) == (
            np.float32(box.width),
            np.float32(box.height),
        )


def test_an_export_of_nothing_new_writes_nothing_and_a_damaged_clip_is_written_again(root, monkeypatch):
    monkeypatch.chdir(root)
    before = {path: path.stat().st_mtime_ns for path in sorted((root / FOLDER).iterdir())}
    code, words = commanded(root, "export", "usd", "--json", NAME)
    assert code == 0 and json.loads(words)["written"] == []
    assert {path: path.stat().st_mtime_ns for path in sorted((root / FOLDER).iterdir())} == before
    clip = root / FOLDER / f"{NAME}.0004.usdc"
    whole = clip.read_bytes()
    clip.write_bytes(whole[: len(whole) // 2])
    code, words = commanded(root, "export", "usd", NAME, "--json")
    assert code == 0 and json.loads(words)["written"] == [clip.name]
    assert clip.read_bytes() == whole


def test_what_changed_is_written_and_nothing_else(root, tmp_path, monkeypatch):
    monkeypatch.chdir(root)
    place = ("-o", str(tmp_path / "there"), "--json")

    def written(*words: str) -> list[str]:
        code, said = commanded(root, "export", "usd", NAME, *place, *words)
        assert code == 0, said
        return json.loads(said)["written"]

    clips = [f"{NAME}.{n:04d}.usdc" for n in range(1, 7)]
    others = [f"{NAME}.manifest.usda", f"{NAME}.usda"]
    assert written("-f", "2-3") == [*clips[1:3], *others]
    stage = opened(tmp_path / "there" / f"{NAME}.usda")
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (2.0, 3.0)
    assert written("-f", "3-5") == [*clips[3:5], others[1]]
    assert written("-f", "2-5") == []
    assert written("-f", "2-5", "--set", "lights=gallery") == [f"{NAME}.sky.exr", others[1]]
    stage = opened(tmp_path / "there" / f"{NAME}.usda")
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (2.0, 5.0)
    assert findings(tmp_path / "there" / f"{NAME}.usda") == []
    assert written("-f", "2", "--set", "look=clay") == [clips[1], *others]
    stage = opened(tmp_path / "there" / f"{NAME}.usda")
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (2.0, 2.0)  # the others show speed


@needs_plugins("points")
@pytest.mark.parametrize(("shot", "kind"), [(CLOUD, "Points"), (NET, "Mesh")])
def test_clouds_become_points_and_nets_their_smooth_surface(shot, kind, tmp_path, monkeypatch):
    simulated(tmp_path, shot)
    monkeypatch.chdir(tmp_path)
    code, words = commanded(tmp_path, "export", "usd", NAME)
    assert code == 0, words
    path = tmp_path / FOLDER / f"{NAME}.usda"
    assert findings(path) == []
    stage = opened(path)
    prim = stage.GetPrimAtPath(f"/{NAME}/sculpture")
    assert prim.GetTypeName() == kind
    velocities = np.array(UsdGeom.PointBased(prim).GetVelocitiesAttr().Get(1.0))
    assert len(velocities) > 100 and np.allclose(velocities, (3.0, 0.0, 0.0), atol=1e-3)
    if kind == "Points":
        points = UsdGeom.Points(prim)
        assert np.allclose(points.GetWidthsAttr().Get(2.0), 0.1) and len(points.GetIdsAttr().Get(2.0)) == 200


def test_frames_that_cannot_be_simulated_are_told_and_the_others_written(root, tmp_path):
    project, shot = Project(tmp_path, 1), root / "shots" / f"{NAME}.yaml"
    request = project.request(shot, "draft", variant="none")
    with pytest.raises(FrameError, match="has no cameras, which depend on all its frames"):
        UsdExport(request, project.store, tmp_path / "usd").write(lambda: None)
    there = Project(root, 1).store
    for kind, key in [
        ("cameras", request.keys.cameras),
        *(("mesh", request.keys.mesh(n)) for n in (1, 2, 4)),
    ]:
        project.store.put(kind, key, partial(shutil.copyfile, there.path(kind, key)))
    export = UsdExport(request, project.store, tmp_path / "usd")
    faults = export.write(lambda: None)
    told = [f"{NAME} frame {number}: it was not simulated, so it is not exported" for number in (3, 5, 6)]
    assert faults == told and export.shown() == [1, 2, 4]
    stage = opened(export.path)
    points = sculpture(stage).GetPointsAttr()
    assert len(points.Get(3.0)) == len(points.Get(2.0))  # frame 2 is held until 4


def test_daylight_is_the_sun_and_the_sky_of_renders():
    daylight, stage = Daylight(), Usd.Stage.CreateInMemory()
    add_lights(stage, "/a", "/a/set", LightRig(daylight=daylight), {1: 1.0}, "a.sky.exr")
    sun = UsdLux.DistantLight(stage.GetPrimAtPath("/a/sun"))
    light = sun.GetIntensityAttr().Get() * np.array(sun.GetColorAttr().Get())
    assert np.allclose(light, clear_sky.sun_irradiance(daylight), rtol=1e-5)
    assert UsdLux.DomeLight(stage.GetPrimAtPath("/a/sky")).GetTextureFileAttr().Get().path == "./a.sky.exr"
    pixels = LightRig(daylight=daylight).sky_pixels()
    row, column = np.unravel_index(pixels.sum(axis=2).argmax(), pixels.shape[:2])
    tilt, turn = (row + 0.5) / 128 * math.pi, (column + 0.5) / 128 * math.pi
    brightest = (math.sin(tilt) * math.sin(turn), math.cos(tilt), -math.sin(tilt) * math.cos(turn))
    azimuth = math.atan2(brightest[0], brightest[2])
    assert abs(azimuth - daylight.azimuth) < math.radians(3.0), "at the horizon below the sun"
    assert np.allclose(pixels[row, column], clear_sky.sky_radiance(daylight, np.array([brightest]))[0])


def test_textures_come_with_coordinates_of_corners_and_colours_of_vertices(tmp_path, monkeypatch):
    left, right = np.full((8, 4, 3), (255, 0, 0), np.uint8), np.full((8, 4, 3), (0, 0, 255), np.uint8)
    (tmp_path / "shots").mkdir()
    write_png(tmp_path / "shots" / "halves.png", np.hstack([left, right]))
    simulated(tmp_path, TEXTURED)
    monkeypatch.chdir(tmp_path)
    code, words = commanded(tmp_path, "export", "usd", NAME)
    assert code == 0, words
    stage = opened(tmp_path / FOLDER / f"{NAME}.usda")
    assert findings(tmp_path / FOLDER / f"{NAME}.usda") == []
    picture = UsdShade.Shader(stage.GetPrimAtPath(f"/{NAME}/materials/sculpture/picture"))
    file = Path(picture.GetInput("file").Get().resolvedPath)
    assert np.allclose(read_exr(file)[0]["beauty"][:, :4], (1.0, 0.0, 0.0))
    primvars, mesh = UsdGeom.PrimvarsAPI(sculpture(stage)), sculpture(stage)
    coordinates = np.array(primvars.GetPrimvar("st").Get(1.0))
    corners = np.array(mesh.GetFaceVertexIndicesAttr().Get(1.0))
    rest = np.array(primvars.GetPrimvar("rest").Get(1.0))[corners]
    assert primvars.GetPrimvar("st").GetInterpolation() == "faceVarying"
    assert np.allclose(
        coordinates, rest[:, :2] / 4.0 + 0.5, atol=1e-6
    )  # a slide, 4 units wide, from the front
    colours = np.array(primvars.GetPrimvar("displayColor").Get(1.0))[corners]
    assert np.all(colours[coordinates[:, 0] < 0.49] == (1.0, 0.0, 0.0))
    assert np.all(colours[coordinates[:, 0] > 0.51] == (0.0, 0.0, 1.0))


def test_a_full_disk_is_one_message_and_leaves_no_half_clip(root, tmp_path, monkeypatch):
    monkeypatch.chdir(root)
    with disk_of(4000):
        code, words = commanded(root, "export", "usd", NAME, "-o", str(tmp_path))
    assert code == 4 and f"{tmp_path / NAME}.0001.usdc: cannot be written: the file is larger than" in words
    assert words.count("\n") <= 1 and list(tmp_path.iterdir()) == []


def test_bad_requests_are_one_message(root, tmp_path, monkeypatch):
    monkeypatch.chdir(root)
    code, words = commanded(root, "export", "usd", NAME, "-f", "5-9")
    assert code == 2 and "frames 7-9 are not in the shot, which has 1-6" in words
    monkeypatch.setitem(sys.modules, "pxr", None)
    monkeypatch.setattr("flowsculpt.pipeline.plugins.interchange.scene_readers.find_spec", lambda name: None)
    code, words = commanded(root, "export", "usd", NAME)
    assert code == 4 and "need the package usd-core (209 MB), which is not installed" in words
    assert "-m pip install usd-core" in words


def test_a_dry_run_writes_nothing(root, tmp_path, monkeypatch):
    monkeypatch.chdir(root)
    code, words = commanded(root, "export", "usd", NAME, "-o", str(tmp_path / "new"), "--dry-run")
    assert code == 0 and "Then: writing 6 frames" in words and not (tmp_path / "new").exists()
