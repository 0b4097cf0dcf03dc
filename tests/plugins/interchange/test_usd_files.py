"""Models in USD stages are what other programs show: placed, instanced, seen, wound and creased."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pxr import Gf, Sdf, Usd, UsdGeom, UsdUtils

from flowsculpt.pipeline.errors import FlowsculptError, MachineError, MeshError, MissingInputError, ShotError
from flowsculpt.pipeline.mesh import PolygonMesh, read_mesh
from flowsculpt.pipeline.mesh.mesh_formats import ScenePart
from flowsculpt.pipeline.mesh.read import ModelFile, repair_surface
from flowsculpt.pipeline.plugins.authoring.shot_templates import model_template
from flowsculpt.pipeline.plugins.interchange import scene_readers
from flowsculpt.pipeline.plugins.interchange.scene_readers import joined
from flowsculpt.pipeline.plugins.interchange.usd_reader import StageMeshes
from flowsculpt.pipeline.shot import Model, read_shot

CORNERS = [(x, y, z) for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)]
SIDES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
SHOT = "title: A\nframes: 1-2\nsubject: {model: %s}\nresample: off\nflows: []\n"


def add_box(stage: Usd.Stage, path: str, left_handed: bool = False) -> UsdGeom.Mesh:
    """Add a box of quads from -1 to 1, with its faces outwards."""
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreatePointsAttr(CORNERS)
    mesh.CreateFaceVertexCountsAttr([4] * len(SIDES))
    sides = [side[::-1] if left_handed else side for side in SIDES]
    mesh.CreateFaceVertexIndicesAttr([corner for side in sides for corner in side])
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    if left_handed:
        mesh.CreateOrientationAttr(UsdGeom.Tokens.leftHanded)
    return mesh


def stage_at(path: Path) -> Usd.Stage:
    """Return a new stage with a default prim, which the caller saves."""
    stage = Usd.Stage.CreateNew(str(path))
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/World").GetPrim())
    return stage


def surface_of(stage: Usd.Stage, time: float | None = None) -> PolygonMesh:
    """Return the meshes of a stage in memory, not repaired."""
    meshes = StageMeshes(Usd.TimeCode.Default() if time is None else Usd.TimeCode(time))
    meshes.add(stage.GetPseudoRoot())
    return repair_surface(joined(meshes.placed.parts), repair=False).mesh


def volume(mesh: PolygonMesh) -> float:
    a, b, c = mesh.triangulated().vertices[mesh.triangulated().faces].transpose(1, 0, 2)
    return float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6.0


MATRICES = st.tuples(
    st.tuples(*[st.sampled_from([-2.0, -1.0, 0.5, 1.0, 3.0])] * 3),
    st.tuples(*[st.floats(-180.0, 180.0)] * 3),
    st.tuples(*[st.floats(-50.0, 50.0)] * 3),
)


def place(prim: Any, ops: tuple[Any, Any, Any]) -> None:
    scale, angles, offset = ops
    prim.AddTranslateOp().Set(Gf.Vec3d(*offset))
    prim.AddRotateXYZOp().Set(Gf.Vec3f(*angles))
    prim.AddScaleOp().Set(Gf.Vec3f(*scale))


@settings(max_examples=40, deadline=None)
@given(MATRICES, MATRICES, st.booleans(), st.booleans())
def test_a_mesh_stands_where_usd_computes_it_and_faces_outwards(
    outer: Any, inner: Any, left_handed: bool, instanced: bool
) -> None:
    stage = Usd.Stage.CreateInMemory()
    if instanced:
        stage.CreateClassPrim("/Box")
        add_box(stage, "/Box/mesh", left_handed)
    group = UsdGeom.Xform.Define(stage, "/group")
    place(group, outer)
    if instanced:
        placed: Any = UsdGeom.Xform.Define(stage, "/group/box")
        placed.GetPrim().GetReferences().AddInternalReference("/Box")
        placed.GetPrim().SetInstanceable(True)
    else:
        placed = add_box(stage, "/group/box", left_handed)
    place(placed, inner)
    read = surface_of(stage)
    matrix = UsdGeom.XformCache().GetLocalToWorldTransform(placed.GetPrim())
    expected = [tuple(matrix.Transform(Gf.Vec3d(*corner))) for corner in CORNERS]
    assert np.allclose(read.vertices, expected, rtol=1e-12, atol=1e-9)
    assert volume(read) == pytest.approx(8.0 * abs(np.linalg.det(np.array(matrix)[:3, :3])), rel=1e-6)


@settings(max_examples=20, deadline=None)
@given(st.lists(st.tuples(MATRICES, st.booleans()), min_size=1, max_size=4))
def test_points_of_an_instancer_show_their_prototype_unless_they_are_hidden(points: Any) -> None:
    stage = Usd.Stage.CreateInMemory()
    instancer = UsdGeom.PointInstancer.Define(stage, "/many")
    instancer.AddTranslateOp().Set(Gf.Vec3d(0.0, 1.0, 0.0))
    prototype = add_box(stage, "/many/box")
    prototype.AddScaleOp().Set(Gf.Vec3f(0.5))
    instancer.CreatePrototypesRel().AddTarget("/many/box")
    instancer.CreateProtoIndicesAttr([0] * len(points))
    instancer.CreatePositionsAttr([Gf.Vec3f(200.0 * k, 0.0, 0.0) for k in range(len(points))])
    instancer.CreateScalesAttr([Gf.Vec3f(*scale) for (scale, _, _), _ in points])
    hidden = [k for k, (_, is_hidden) in enumerate(points) if is_hidden]
    instancer.CreateInvisibleIdsAttr(hidden)
    meshes = StageMeshes(Usd.TimeCode.Default())
    meshes.add(stage.GetPseudoRoot())
    assert len(meshes.placed.parts) == len(points) - len(hidden)
    for part, k in zip(meshes.placed.parts, (k for k in range(len(points)) if k not in hidden), strict=True):
        low, high = part.points.min(axis=0), part.points.max(axis=0)
        assert 0.5 * (low + high) == pytest.approx([200.0 * k, 1.0, 0.0])
        assert high - low == pytest.approx(np.abs(points[k][0][0]))


@pytest.mark.slow
def test_only_active_visible_meshes_for_rendering_are_read(tmp_path: Path) -> None:
    stage = stage_at(tmp_path / "a.usda")
    add_box(stage, "/World/seen").CreatePurposeAttr(UsdGeom.Tokens.render)
    add_box(stage, "/World/proxy").CreatePurposeAttr(UsdGeom.Tokens.proxy)
    add_box(stage, "/World/guide").CreatePurposeAttr(UsdGeom.Tokens.guide)
    add_box(stage, "/World/off").GetPrim().SetActive(False)
    add_box(stage, "/World/hidden/below")
    UsdGeom.Scope.Define(stage, "/World/hidden").MakeInvisible()
    add_box(stage, "/elsewhere")
    stage.OverridePrim("/World/over")
    UsdGeom.Sphere.Define(stage, "/World/ball")
    stage.Save()
    read = ModelFile(tmp_path / "a.usda").surface()
    assert (read.vertices, read.faces, read.format) == (8, 6, "USDA")
    assert read.notes == ("left out, as they are not meshes: 1 Sphere",)
    with pytest.raises(MeshError, match=r"its prim /World/hidden holds no mesh that is active, visible"):
        ModelFile(tmp_path / "a.usda", ScenePart("/World/hidden")).surface()
    with pytest.raises(MeshError, match=r"no prim /World/sean. Did you mean '/World/seen'"):
        ModelFile(tmp_path / "a.usda", ScenePart("/World/sean")).surface()


def test_holes_are_left_out_and_sharp_edges_are_creases() -> None:
    stage = Usd.Stage.CreateInMemory()
    box = add_box(stage, "/box")
    box.CreateHoleIndicesAttr([0])
    box.CreateCreaseIndicesAttr([4, 6, 7, 5, 4, 2, 3])
    box.CreateCreaseLengthsAttr([5, 2])
    box.CreateCreaseSharpnessesAttr([10.0, 0.0])
    read = surface_of(stage)
    assert len(read.offsets) == 6 and len(read.vertices) == 8
    assert {tuple(sorted(edge)) for edge in read.creases.tolist()} == {(4, 6), (6, 7), (5, 7), (4, 5)}
    box.CreateCreaseSharpnessesAttr([0.0, 0.0, 0.0, 1.0, 2.0])  # one for each edge
    assert {tuple(sorted(edge)) for edge in surface_of(stage).creases.tolist()} == {(4, 5), (2, 3)}


@pytest.mark.slow
def test_a_moving_stage_is_read_at_its_start_or_the_time_asked_for(tmp_path: Path) -> None:
    stage = stage_at(tmp_path / "a.usdc")
    lift = add_box(stage, "/World/box").AddTranslateOp()
    for time in (10.0, 20.0):
        lift.Set(Gf.Vec3d(0.0, time, 0.0), time)
    stage.Save()

    def height(part: ScenePart | None = None) -> float:
        return float(ModelFile(tmp_path / "a.usdc", part).surface().mesh.bounds.mean(axis=0)[1])

    assert height() == 10.0
    stage.SetStartTimeCode(12.0)
    stage.SetEndTimeCode(20.0)
    stage.Save()
    assert height() == 12.0 and height(ScenePart(time_code=15.0)) == 15.0


@pytest.mark.slow
def test_a_shot_heeds_the_axis_and_follows_every_layer(tmp_path: Path) -> None:

    part, path = stage_at(tmp_path / "part.usda"), tmp_path / "a.usda"
    add_box(part, "/World/box").AddScaleOp().Set(Gf.Vec3f(1.0, 2.0, 3.0))
    part.Save()
    stage = stage_at(path)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.Xform.Define(stage, "/World/chair").GetPrim().GetReferences().AddReference("./part.usda")
    stage.Save()
    (tmp_path / "a.yaml").write_text(SHOT % "a.usda, prim: /World/chair")
    shot = read_shot(tmp_path / "a.yaml")
    assert np.ptp(shot.motion.mesh_at_rest().vertices, axis=0) == pytest.approx([2.0, 6.0, 4.0])
    assert [file.name for file, _ in shot.files] == ["a.usda", "part.usda"] and ModelFile(path).up() == "z"
    lying = read_shot(tmp_path / "a.yaml", settings=("subject.up=y",)).motion.mesh_at_rest()
    assert np.ptp(lying.vertices, axis=0) == pytest.approx([2.0, 4.0, 6.0])
    add_box(part, "/World/more")
    part.Save()
    changed = read_shot(tmp_path / "a.yaml")
    assert isinstance(changed.motion.subject, Model) and isinstance(shot.motion.subject, Model)
    assert changed.motion.subject.digest != shot.motion.subject.digest
    assert changed.files[0] == shot.files[0] and changed.files[1] != shot.files[1]
    template = model_template(path, "a.usda")
    assert "up: z" not in template.subject and any("its stage has z up" in f.lower() for f in template.facts)
    (tmp_path / "part.usda").unlink()
    with pytest.raises(FlowsculptError, match=r"its layer a.usda refers to .*part.usda: file not found"):
        read_shot(tmp_path / "a.yaml")


@pytest.mark.slow
def test_a_region_of_a_stage_follows_its_layers(tmp_path: Path) -> None:
    part = stage_at(tmp_path / "part.usda")
    add_box(part, "/World/box")
    part.Save()
    stage = stage_at(tmp_path / "a.usda")
    stage.GetRootLayer().subLayerPaths.append("./part.usda")
    stage.Save()
    region = "{within: {region: {mesh: a.usda}, flows: [{translation: {rate: [1, 0, 0]}}]}}"
    text = f"title: A\nframes: 1-2\nsubject: {{solid: box}}\nresample: off\nflows: [{region}]\n"
    shot = read_shot(tmp_path / "a.yaml", text)
    assert [file.name for file, _ in shot.files] == ["a.usda", "part.usda"]


def test_settings_of_stages_are_refused_for_other_models(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (tmp_path / "a.yaml").write_text(SHOT % "a.obj, prim: /World")
    with pytest.raises(ShotError, match=r"3:\d+: prim is for models of USD; this one is"):
        read_shot(tmp_path / "a.yaml")


@pytest.mark.slow
def test_every_form_of_stage_holds_the_same_model(tmp_path: Path) -> None:
    first = stage_at(tmp_path / "a.usda")
    add_box(first, "/World/box").CreateSubdivisionSchemeAttr(UsdGeom.Tokens.catmullClark)
    first.Save()
    first.GetRootLayer().Export(str(tmp_path / "b.usd"))  # binary
    assert UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(str(tmp_path / "a.usda")), str(tmp_path / "b.usdz"))
    meshes = [ModelFile(tmp_path / name).surface() for name in ("a.usda", "b.usd", "b.usdz")]
    for read in meshes:
        assert np.array_equal(read.mesh.vertices, meshes[0].mesh.vertices)
        assert np.array_equal(read.mesh.corners, meshes[0].mesh.corners)
        assert read.notes[0].startswith("1 mesh asks to be subdivided by subdivisionScheme")
    assert [file.name for file, _ in ModelFile(tmp_path / "b.usdz").files().files] == ["b.usdz"]


def test_without_usd_core_the_message_names_the_extra(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "a.usd").write_text("#usda 1.0\n")
    monkeypatch.setattr(scene_readers, "find_spec", lambda name: None)
    with pytest.raises(MachineError, match=r"usd-core .* is not installed; install the extra \[usd\]"):
        read_mesh(tmp_path / "a.usd")


def _references(folder: Path, *assets: str) -> Path:
    stage = stage_at(folder / "a.usda")
    for number, asset in enumerate(assets):
        prim = stage.DefinePrim(f"/World/p{number}", "Xform")
        prim.GetReferences().AddReference(asset)
    add_box(stage, "/World/box")
    stage.Save()
    return folder / "a.usda"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("make", "fact"),
    [
        (lambda f: _references(f, "./gone.usda"), "gone.usda: file not found; check the path"),
        (lambda f: _references(f, "/gone/there.usdc"), "/gone/there.usdc: file not found"),
        (lambda f: _references(f, "./a.usda"), "its layers do not compose"),
        (lambda f: _references(f, "/dev/zero"), "/dev/zero: it is a device"),
    ],
    ids=["missing", "absolute", "cycle", "device"],
)
def test_layers_that_cannot_be_read_are_told(tmp_path: Path, make: Any, fact: str) -> None:
    with pytest.raises(FlowsculptError) as told:
        read_mesh(make(tmp_path))
    assert fact in str(told.value) and "\n" not in str(told.value)
    assert isinstance(told.value, MissingInputError | MeshError)
