"""A stage with one mesh: topology once, and points and normals that readers blend between frames."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from pxr import Usd, UsdGeom, UsdShade

from flowsculpt.pipeline.mesh.mesh_formats import ScenePart
from flowsculpt.pipeline.mesh.read import ModelFile
from flowsculpt.pipeline.plugins.interchange.one_mesh import OneMesh
from flowsculpt.pipeline.plugins.interchange.unifying import Unification
from flowsculpt.pipeline.plugins.interchange.usd_materials import add_material
from flowsculpt.pipeline.plugins.interchange.usd_one_mesh import write_one_mesh
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.render.post.image import read_exr, write_png
from flowsculpt.render.scene.materials import LOOKS
from flowsculpt.render.scene.rgb_spaces import srgb_of_linear
from tests.conftest import commanded
from tests.plugins.interchange.moving_meshes import RATE, painted_box
from tests.plugins.interchange.test_model_paint import painted_box as painted_model
from tests.plugins.interchange.test_usd import NAME, findings
from tests.simulated_show import simulated

SHOT = """\
title: A box, pulled apart
frames: 1-6
rate: 30
subject: {solid: box, size: [2, 2, 2]}
resample: {max_edge_length: 0.5}
flows: [twist: {axis: y, amount: {ease: linear, keys: {1: 0, 6: 250}}}]
look: speed
"""


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project whose shot is simulated and exported as one mesh."""
    root = tmp_path_factory.mktemp("usd")
    simulated(root, SHOT)
    assert exported(root) == [f"{NAME}.one_mesh.usdc", f"{NAME}.one_mesh.usda"]
    return root


def exported(root: Path, *words: str, form: str = "--one-mesh") -> list[str]:
    """Export the shot as one mesh, or in clips; return the names of the files that were written."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(root)
        code, said = commanded(root, "export", "usd", NAME, "--json", *filter(None, [form]), *words)
    assert code == 0, said
    return list(json.loads(said)["written"])


@pytest.fixture
def stage(root: Path) -> Path:
    return root / "renders" / NAME / "usd" / f"{NAME}.one_mesh.usda"


@pytest.fixture
def mesh(root: Path) -> OneMesh:
    project = Project(root, 1)
    return Unification(project.request(root / "shots" / f"{NAME}.yaml", "draft"), project.store).one_mesh()


def test_the_validators_of_usd_find_nothing(stage: Path) -> None:
    assert findings(stage) == []


def test_topology_is_written_once_and_points_and_normals_at_each_frame(stage: Path, mesh: OneMesh) -> None:
    opened = Usd.Stage.Open(str(stage))
    sculpture = UsdGeom.Mesh(opened.GetPrimAtPath(f"/{NAME}/sculpture"))
    primvars = UsdGeom.PrimvarsAPI(sculpture)
    varying = {each.GetName() for each in sculpture.GetPrim().GetAttributes() if each.GetNumTimeSamples()}
    assert varying == {"points", "primvars:normals", "extent"}
    assert np.array_equal(np.array(sculpture.GetFaceVertexIndicesAttr().Get()).reshape(-1, 3), mesh.faces)
    assert np.array_equal(np.array(sculpture.GetCreaseIndicesAttr().Get()).reshape(-1, 2), mesh.creases)
    assert len(mesh.creases) > 12
    assert np.allclose(primvars.GetPrimvar("rest").Get(), mesh.rest)
    assert np.allclose(primvars.GetPrimvar("displayColor").Get(), mesh.colours)
    for number in mesh.frames:
        frame = mesh.frame(number)
        points = np.array(sculpture.GetPointsAttr().Get(number))
        assert np.array_equal(points, frame.points.astype(np.float32))
        corners = np.array(primvars.GetPrimvar("normals").ComputeFlattened(number)).reshape(-1, 3, 3)
        assert np.allclose(corners, frame.normals[mesh.corner_normals], atol=1e-6)
        low, high = np.array(sculpture.GetExtentAttr().Get(number))
        assert np.array_equal(low, points.min(axis=0)) and np.array_equal(high, points.max(axis=0))
    between = np.array(sculpture.GetPointsAttr().Get(2.5))
    assert np.allclose(between, 0.5 * (mesh.points_at(2) + mesh.points_at(3)), atol=1e-5)


def test_the_stage_has_the_rate_the_camera_and_the_material_of_the_shot(stage: Path) -> None:
    opened = Usd.Stage.Open(str(stage))
    assert (opened.GetTimeCodesPerSecond(), opened.GetStartTimeCode(), opened.GetEndTimeCode()) == (30, 1, 6)
    assert opened.GetPrimAtPath(f"/{NAME}/camera").IsA(UsdGeom.Camera)
    sculpture = opened.GetPrimAtPath(f"/{NAME}/sculpture")
    assert UsdShade.MaterialBindingAPI(sculpture).ComputeBoundMaterial()[0]


def test_texture_coordinates_are_written_where_the_mesh_has_them(tmp_path: Path) -> None:
    mesh = painted_box().mesh
    write_one_mesh(tmp_path / "a.usdc", "/a", mesh)
    opened = Usd.Stage.Open(str(tmp_path / "a.usdc"))
    assert opened.GetTimeCodesPerSecond() == float(RATE.fps)
    coordinates = UsdGeom.PrimvarsAPI(opened.GetPrimAtPath("/a")).GetPrimvar("st")
    assert coordinates.GetInterpolation() == "faceVarying" and mesh.texture is not None
    assert np.allclose(coordinates.Get(), mesh.texture.reshape(-1, 2))


def test_a_current_stage_is_not_written_again_and_a_damaged_mesh_is(root: Path, stage: Path) -> None:
    assert exported(root) == []
    path = stage.with_suffix(".usdc")
    path.write_bytes(path.read_bytes()[:100])
    assert exported(root) == [path.name]
    assert findings(stage) == []


def test_fewer_vertices_are_another_mesh_and_need_the_option(root: Path, stage: Path) -> None:
    assert exported(root, "--vertices", "320", "-o", str(root / "less")) != []
    less = Usd.Stage.Open(str(root / "less" / stage.name))
    sculpture = UsdGeom.Mesh(less.GetPrimAtPath(f"/{NAME}/sculpture"))
    assert len(sculpture.GetPointsAttr().Get(1.0)) == 320
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(root)
        code, said = commanded(root, "export", "usd", NAME, "--vertices", "320")
        instances = commanded(root, "export", "usd", NAME, "--vertices", "320", "--instances")
    options = "--vertices, --until, --tolerance and --carry-from"
    assert (code, said) == (2, f"{options} change one mesh; add --one-mesh")
    assert instances == (2, f"{options} change one mesh; leave them out with --instances")


@pytest.mark.parametrize("form", ["--one-mesh", ""], ids=["one mesh", "clips"])
def test_faces_of_each_material_of_a_model_are_a_subset_with_its_pictures(tmp_path: Path, form: str) -> None:
    simulated(tmp_path, SHOT)  # a project, whose shot becomes that of a model
    shots = tmp_path / "shots"
    mtl = painted_model(shots).with_suffix(".mtl")
    mtl.write_text(mtl.read_text() + "norm -bm 0.5 bumps.png\n")
    pixels = np.random.default_rng(3).integers(0, 256, (48, 8, 3)).astype(np.uint8)
    for name in ("atlas.png", "bumps.png"):
        write_png(shots / name, pixels)
    text = SHOT.replace("{solid: box, size: [2, 2, 2]}", "{model: box.obj, paint: on}")
    simulated(tmp_path, text.replace("look: speed", "look: model"))
    stage = tmp_path / "renders" / NAME / "usd" / (f"{NAME}.one_mesh.usda" if form else f"{NAME}.usda")
    assert {f"{NAME}.0.colour.exr", f"{NAME}.1.normal.exr"} <= set(exported(tmp_path, form=form))
    assert findings(stage) == [] and exported(tmp_path, form=form) == []
    opened = Usd.Stage.Open(str(stage))
    sculpture = UsdGeom.Mesh(opened.GetPrimAtPath(f"/{NAME}/sculpture"))
    subsets = UsdGeom.Subset.GetGeomSubsets(sculpture, "face", "materialBind")
    for time in (1.0, 6.0):
        count = len(sculpture.GetFaceVertexCountsAttr().Get(time))
        faces = [np.array(each.GetIndicesAttr().Get(time)) for each in subsets]
        assert np.array_equal(np.sort(np.concatenate(faces)), np.arange(count))
        st = np.array(UsdGeom.PrimvarsAPI(sculpture).GetPrimvar("st").Get(time)).reshape(-1, 3, 2)
        assert (st[faces[0], :, 1] < 5 / 6 + 1e-6).all() and (st[faces[1], :, 1] > 5 / 6 - 1e-6).all()
    bound = [UsdShade.MaterialBindingAPI(each.GetPrim()).ComputeBoundMaterial()[0] for each in subsets]
    pictured, red = (each.ComputeSurfaceSource("")[0] for each in bound)
    assert red.GetInput("diffuseColor").Get() == (1.0, 0.0, 0.0)
    (source,), _ = pictured.GetInput("diffuseColor").GetConnectedSources()
    picture = UsdShade.Shader(source.source.GetPrim()).GetInput("file").Get()
    held, _ = read_exr(stage.parent / picture.path)
    assert np.abs(srgb_of_linear(held.arrays["beauty"]) * 255.0 - pixels).max() < 0.1
    part = ScenePart(f"/{NAME}/sculpture", 6.0)  # our own reader finds what was written
    first, second = ModelFile(stage, part).materials()[0]
    assert first.colour_texture is not None and second.normal_texture is not None
    expected = (2.0 * pixels[0, 0] / 255.0 - 1.0) * (0.5, 0.5, 1.0)
    assert second.normal_texture.normals()[0, 0] == pytest.approx(
        np.maximum(expected, (-1, -1, 1e-3)), abs=1e-3
    )
    paint = ModelFile(stage, part).paint()
    assert np.bincount(paint.materials).tolist() == [len(each) for each in faces]  # type: ignore[attr-defined]


def test_a_picture_of_roughness_is_connected_as_a_number() -> None:
    stage = Usd.Stage.CreateInMemory()
    add_material(stage, "/look", LOOKS["glaze"], {"roughness": "a.roughness.exr"})
    surface = UsdShade.Shader(stage.GetPrimAtPath("/look/surface"))
    (source,), _ = surface.GetInput("roughness").GetConnectedSources()
    assert (source.sourceName, source.source.GetPath()) == ("r", "/look/roughness")
    assert not surface.GetInput("diffuseColor").HasConnectedSource()
