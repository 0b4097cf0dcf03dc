"""Moving meshes of USD, Alembic, PC2 and MDD: their places and velocities at a time, and what is refused."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import imath
import numpy as np
import pytest
from alembic3d import Abc, AbcCoreAbstract, AbcGeom
from pxr import Gf, Sdf, Usd, UsdGeom, UsdSkel, Vt

from flowsculpt.pipeline.arrays import Floats
from flowsculpt.pipeline.errors import MeshError, MissingInputError
from flowsculpt.pipeline.mesh import box
from flowsculpt.pipeline.mesh.mesh_formats import FileSurface
from flowsculpt.pipeline.mesh.read import ModelFile
from flowsculpt.pipeline.plugins.interchange.alembic_samples import AlembicSource
from flowsculpt.pipeline.plugins.interchange.usd_files import read_usd
from flowsculpt.render.base.render_errors import BadInputError

BOX = box(2.0)
FACES = BOX.faces.reshape(-1)
RISE = np.array([0.0, 1.0, 0.0])


def volume(surface: FileSurface) -> float:
    """Return the volume of a surface of triangles: above 0 where they face outwards."""
    a, b, c = surface.points[surface.corners.reshape(-1, 3)].transpose(1, 0, 2)
    return float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6.0


# ---- USD


def usd_mesh(stage: Usd.Stage, path: str, samples: dict[float, Floats], faces: Any = FACES) -> UsdGeom.Mesh:
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreateFaceVertexCountsAttr([3] * (len(faces) // 3))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray(list(map(int, faces))))
    for code, points in samples.items():
        mesh.CreatePointsAttr().Set(Vt.Vec3fArray.FromNumpy(points.astype(np.float32)), code)
    return mesh


def stage_at(path: Path, rate: float = 24.0, **metadata: Any) -> Usd.Stage:
    stage = Usd.Stage.CreateNew(str(path))
    stage.SetTimeCodesPerSecond(rate)
    stage.SetFramesPerSecond(rate)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    return stage


def test_time_samples_are_read_one_by_one_with_transforms_that_mirror(tmp_path: Path) -> None:
    stage = stage_at(tmp_path / "a.usda")
    parent = UsdGeom.Xform.Define(stage, "/top")
    parent.AddScaleOp().Set(Gf.Vec3f(-2.0, 1.0, 1.0))
    samples = {24.0: BOX.vertices, 25.0: BOX.vertices + RISE, 30.0: BOX.vertices + 6 * RISE}
    mesh = usd_mesh(stage, "/top/box", samples)
    mesh.CreateVelocitiesAttr(Vt.Vec3fArray(8, Gf.Vec3f(1, 24, 0)))
    stage.Save()
    moving = ModelFile(tmp_path / "a.usda").motion()
    assert moving.times == pytest.approx([1.0, 25 / 24, 30 / 24])
    assert (moving.rate, moving.is_fixed, moving.is_continuous, moving.files.up) == (24.0, True, False, "z")
    mirrored = BOX.vertices * [-2, 1, 1]
    for seconds, rise in [(0.0, 0), (1.0, 0), (25 / 24, 1), (1.2, 1), (9.0, 6)]:
        surface = moving.at(seconds)
        assert surface.points == pytest.approx(mirrored + rise * RISE)
        assert surface.velocities is not None and surface.velocities[0].tolist() == [-2.0, 24.0, 0.0]
        assert volume(surface) == pytest.approx(16.0), "a mirror turns the faces over"
    moving.close()


def test_faces_that_change_are_those_of_the_last_sample(tmp_path: Path) -> None:
    stage = stage_at(tmp_path / "a.usda")
    mesh = usd_mesh(stage, "/box", {1.0: BOX.vertices, 2.0: BOX.vertices[:4]})
    mesh.GetFaceVertexCountsAttr().Set([3] * 12, 1.0)
    mesh.GetFaceVertexCountsAttr().Set([3], 2.0)
    mesh.GetFaceVertexIndicesAttr().Set(Vt.IntArray(list(map(int, FACES))), 1.0)
    mesh.GetFaceVertexIndicesAttr().Set([0, 1, 2], 2.0)
    stage.Save()
    source = ModelFile(tmp_path / "a.usda").motion()
    assert not source.is_fixed and not source.is_continuous
    counts = [len(source.at(code / 24).offsets) - 1 for code in (1.0, 1.7, 2.0, 3.0)]
    assert counts == [12, 12, 1, 1]


def test_normals_of_corners_and_velocities_by_other_names_are_read_of_a_stage(tmp_path: Path) -> None:
    stage = stage_at(tmp_path / "a.usda")
    mesh = usd_mesh(stage, "/box", {1.0: BOX.vertices, 2.0: BOX.vertices})
    mesh.CreateFaceVertexCountsAttr().Set(Vt.IntArray([3] * 12), 1.0)
    mesh.CreateFaceVertexCountsAttr().Set(Vt.IntArray([3] * 11), 2.0)
    mesh.CreateFaceVertexIndicesAttr().Set(Vt.IntArray(BOX.faces[:11].ravel().tolist()), 2.0)
    mesh.CreateFaceVertexIndicesAttr().Set(Vt.IntArray(BOX.faces.ravel().tolist()), 1.0)
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    corners = BOX.vertices[BOX.faces.ravel()].astype(np.float32)
    corners[BOX.faces.ravel() == 3] = BOX.face_normals.repeat(3, axis=0)[BOX.faces.ravel() == 3]
    mesh.CreateNormalsAttr().Set(Vt.Vec3fArray.FromNumpy(corners), 1.0)
    named = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("velocity", Sdf.ValueTypeNames.Vector3fArray, "vertex")
    named.Set(Vt.Vec3fArray(8, Gf.Vec3f(0, 3, 0)))
    stage.Save()
    moving = ModelFile(tmp_path / "a.usda").motion()
    expected = np.where(np.arange(8)[:, None] == 3, 0.0, BOX.vertices)
    for surface in (moving.at(1 / 24), read_usd(tmp_path / "a.usda")):
        assert surface.velocities is not None and surface.velocities.tolist() == [[0.0, 3.0, 0.0]] * 8
        assert surface.normals == pytest.approx(expected), "corners that differ have no one normal"
    moving.close()


def test_layers_of_other_rates_and_transforms_between_samples_are_as_usd_combines_them(
    tmp_path: Path,
) -> None:
    fast = stage_at(tmp_path / "fast.usda", 48.0)
    usd_mesh(fast, "/box", {0.0: BOX.vertices}).AddTranslateOp().Set(Gf.Vec3d(0, 0, 0), 0.0)
    UsdGeom.Xformable(fast.GetPrimAtPath("/box")).GetOrderedXformOps()[0].Set(Gf.Vec3d(0, 8, 0), 96.0)
    fast.Save()
    stage = stage_at(tmp_path / "a.usda", 24.0)
    stage.GetRootLayer().subLayerPaths.append("fast.usda")
    stage.Save()
    source = ModelFile(tmp_path / "a.usda").motion()
    assert source.times.tolist() == [0.0, 2.0] and source.is_continuous
    assert source.at(0.5).points == pytest.approx(BOX.vertices + 2 * RISE)


def test_a_skeleton_carries_its_mesh(tmp_path: Path) -> None:
    stage = stage_at(tmp_path / "a.usda", 1.0)
    root = UsdSkel.Root.Define(stage, "/body")
    root.AddTranslateOp().Set(Gf.Vec3d(5, 0, 0))
    skeleton = UsdSkel.Skeleton.Define(stage, "/body/skeleton")
    skeleton.CreateJointsAttr(["a", "b"])
    identity = Vt.Matrix4dArray(2, Gf.Matrix4d(1.0))
    skeleton.CreateBindTransformsAttr(identity)
    skeleton.CreateRestTransformsAttr(identity)
    animation = UsdSkel.Animation.Define(stage, "/body/move")
    animation.CreateJointsAttr(["a", "b"])
    animation.CreateRotationsAttr(Vt.QuatfArray(2, Gf.Quatf(1.0)))
    animation.CreateScalesAttr(Vt.Vec3hArray(2, Gf.Vec3h(1.0)))
    for code in (0.0, 2.0):
        animation.CreateTranslationsAttr().Set(Vt.Vec3fArray([Gf.Vec3f(0.0), Gf.Vec3f(0, code, 0)]), code)
    mesh = usd_mesh(stage, "/body/box", {0.0: BOX.vertices})
    binding = UsdSkel.BindingAPI.Apply(mesh.GetPrim())
    binding.CreateSkeletonRel().SetTargets([skeleton.GetPath()])
    UsdSkel.BindingAPI.Apply(skeleton.GetPrim()).CreateAnimationSourceRel().SetTargets([animation.GetPath()])
    binding.CreateJointIndicesPrimvar(False, 1).Set(Vt.IntArray([0, 0, 0, 0, 1, 1, 1, 1]))
    binding.CreateJointWeightsPrimvar(False, 1).Set(Vt.FloatArray(8, 1.0))
    stage.Save()
    source = ModelFile(tmp_path / "a.usda").motion()
    assert source.times.tolist() == [0.0, 2.0] and source.is_continuous
    expected = BOX.vertices + np.array([5.0, 0.0, 0.0])
    expected[4:] += RISE
    assert source.at(1.0).points == pytest.approx(expected)


def test_numbered_value_clips_are_read_and_a_missing_one_is_refused(tmp_path: Path) -> None:
    for k in range(3):
        clip = stage_at(tmp_path / f"clip.{k + 9:03d}.usda")
        usd_mesh(clip, "/box", {9.0 + k: BOX.vertices + k * RISE})
        clip.Save()
    stage = stage_at(tmp_path / "a.usda")
    box = usd_mesh(stage, "/box", {}).GetPrim()
    clips = Usd.ClipsAPI(box)
    clips.SetClipPrimPath("/box")
    clips.SetClipTemplateAssetPath("./clip.###.usda")
    clips.SetClipTemplateStartTime(9)
    clips.SetClipTemplateEndTime(11)
    clips.SetClipTemplateStride(1)
    manifest = Sdf.Layer.CreateNew(str(tmp_path / "manifest.usda"))
    Sdf.CreatePrimInLayer(manifest, "/box").specifier = Sdf.SpecifierOver
    Sdf.AttributeSpec(manifest.GetPrimAtPath("/box"), "points", Sdf.ValueTypeNames.Point3fArray)
    manifest.Save()
    clips.SetClipManifestAssetPath("./manifest.usda")
    stage.Save()
    source = ModelFile(tmp_path / "a.usda").motion()
    assert source.times * 24 == pytest.approx([9, 10, 11])
    assert source.at(10 / 24).points == pytest.approx(BOX.vertices + RISE)
    (tmp_path / "clip.010.usda").unlink()
    with pytest.raises(MissingInputError, match=r"a\.usda refers to .*clip\.010\.usda: file not found"):
        ModelFile(tmp_path / "a.usda").motion()


# ---- Alembic


def alembic_mesh(
    parent: Any, name: str, rate: float, samples: list[Floats], faces: Any = None, **more: Any
) -> None:
    """Add a mesh whose samples begin at 1 s; `faces` (F, 3) of each sample, those of the box by default."""
    schema = AbcGeom.OPolyMesh(parent, name).getSchema()
    schema.setTimeSampling(AbcCoreAbstract.TimeSampling(1.0 / rate, 1.0))
    for k, points in enumerate(samples):
        corners = np.ascontiguousarray(
            (BOX.faces if faces is None else faces[k])[:, ::-1].reshape(-1), np.int32
        )
        sides = np.full(len(corners) // 3, 3, np.int32)
        values = [imath.V3fArrayFromBuffer(np.ascontiguousarray(points, np.float32))]
        values += [imath.IntArrayFromBuffer(corners), imath.IntArrayFromBuffer(sides)]
        sample = AbcGeom.OPolyMeshSchemaSample(*values)
        if "velocity" in more:
            velocities = np.tile(np.array(more["velocity"], np.float32), (len(points), 1))
            sample.setVelocities(imath.V3fArrayFromBuffer(velocities))
        if "normals" in more:
            normals = imath.V3fArrayFromBuffer(np.ascontiguousarray(more["normals"][k], np.float32))
            sample.setNormals(AbcGeom.ON3fGeomParamSample(normals, AbcGeom.GeometryScope.kVertexScope))
        schema.set(sample)


def archive(path: Path) -> Any:
    return Abc.CreateArchiveWithInfo(str(path), 24.0, "tests", "moving meshes")


def test_meshes_of_an_archive_are_joined_mirrored_and_taken_between_samples_of_other_rates(
    tmp_path: Path,
) -> None:
    made = archive(tmp_path / "a.abc")
    alembic_mesh(made.getTop(), "fast", 2.0, [BOX.vertices + k * RISE for k in range(3)])
    xform = AbcGeom.OXform(made.getTop(), "mirror")
    flip = AbcGeom.XformSample()
    flip.setScale(imath.V3d(-1, 1, 1))
    xform.getSchema().set(flip)
    leaning = [BOX.vertices, BOX.vertices + RISE]
    slow = [BOX.vertices, BOX.vertices + 4 * RISE]
    alembic_mesh(xform, "slow", 1.0, slow, velocity=(1, 4, 0), normals=leaning)
    del made, xform
    moving = ModelFile(tmp_path / "a.abc").motion()
    assert moving.times.tolist() == [1.0, 1.5, 2.0]
    assert (moving.rate, moving.is_fixed, moving.is_continuous) == (2.0, True, False)
    surface = moving.at(1.5)
    assert surface.points[:8] == pytest.approx(BOX.vertices + RISE)
    assert surface.points[8:] == pytest.approx(BOX.vertices * [-1, 1, 1] + 2 * RISE)
    assert volume(surface) == pytest.approx(16.0), "a mirror turns the faces over"
    assert surface.normals is not None and not surface.normals[:8].any(), "a mesh without normals"
    between = (BOX.vertices + 0.5 * RISE) * [-1, 1, 1]
    ours, theirs = (
        values / np.linalg.norm(values, axis=1)[:, None] for values in (surface.normals[8:], between)
    )
    assert ours == pytest.approx(theirs)
    assert moving.at(2.0).points[0] == pytest.approx(BOX.vertices[0] + 2 * RISE)
    assert np.array_equal(ModelFile(tmp_path / "a.abc").surface().mesh.vertices.min(0), [-1, -1, -1])
    moving.close()


def test_an_archive_has_faces_that_change_and_velocities(tmp_path: Path) -> None:
    made = archive(tmp_path / "a.abc")
    faces = [BOX.faces, BOX.faces[:1]]
    alembic_mesh(made.getTop(), "fluid", 24.0, [BOX.vertices, BOX.vertices[:8]], faces, velocity=(0, 3, 0))
    del made
    source = AlembicSource(str(tmp_path / "a.abc"))
    assert not source.motion.is_fixed
    first, second = (source.surface(seconds) for seconds in (1.0, 1.0 + 1 / 24))
    assert (len(first.offsets), len(second.offsets)) == (13, 2)
    assert first.velocities is not None and first.velocities.tolist() == [[0.0, 3.0, 0.0]] * 8


def test_normals_and_velocities_by_other_names_are_read_of_an_archive(tmp_path: Path) -> None:
    made = archive(tmp_path / "a.abc")
    mesh = AbcGeom.OPolyMesh(made.getTop(), "fluid")
    sides, corners = np.full(12, 3, np.int32), np.ascontiguousarray(BOX.faces[:, ::-1].ravel(), np.int32)
    points = imath.V3fArrayFromBuffer(BOX.vertices.astype(np.float32))
    values = [points, imath.IntArrayFromBuffer(corners), imath.IntArrayFromBuffer(sides)]
    sample = AbcGeom.OPolyMeshSchemaSample(*values)
    sample.setNormals(AbcGeom.ON3fGeomParamSample(points, AbcGeom.GeometryScope.kVertexScope))
    mesh.getSchema().set(sample)
    others, scope = mesh.getSchema().getArbGeomParams(), AbcGeom.GeometryScope.kVertexScope
    speeds = imath.V3fArrayFromBuffer(np.tile(np.array([0, 3, 0], np.float32), (8, 1)))
    named = AbcGeom.OV3fGeomParam(others, "v", False, scope, 1)
    named.set(AbcGeom.OV3fGeomParamSample(speeds, scope))
    del made, mesh, others, named
    surface = AlembicSource(str(tmp_path / "a.abc")).surface(0.0)
    assert surface.velocities is not None and surface.velocities.tolist() == [[0.0, 3.0, 0.0]] * 8
    assert surface.normals == pytest.approx(BOX.vertices)


def test_numbers_that_are_not_finite_in_one_sample_are_named_with_its_time(tmp_path: Path) -> None:
    made = archive(tmp_path / "a.abc")
    points = BOX.vertices.copy()
    points[5, 1] = np.nan
    alembic_mesh(made.getTop(), "box", 24.0, [BOX.vertices, points])
    del made
    moving = ModelFile(tmp_path / "a.abc").motion()
    assert len(moving.at(1.0).points) == 8
    with pytest.raises(
        MeshError, match=r"a\.abc: at 1\.04167 s: vertex 5 is \[.*nan.*\], which is not finite"
    ):
        moving.at(1.0 + 1 / 24)
    assert len(moving.at(1.0).points) == 8, "other samples can still be read"
    moving.close()


@pytest.mark.parametrize("damage", ["cut", "empty", "noise", "still", "hdf"])
def test_a_damaged_archive_is_one_line(tmp_path: Path, damage: str) -> None:
    made = archive(tmp_path / "a.abc")
    alembic_mesh(
        made.getTop(), "box", 24.0, [BOX.vertices, BOX.vertices + RISE][: 1 if damage == "still" else 2]
    )
    del made
    path, content = tmp_path / "a.abc", (tmp_path / "a.abc").read_bytes()
    changed = {
        "cut": content[:700],
        "empty": b"",
        "noise": b"Ogawa" + bytes(range(256)) * 4,
        "still": content,
    }
    path.write_bytes((changed | {"hdf": b"\x89HDF" + content})[damage])
    with pytest.raises(MeshError, match=r"a\.abc: .*(Export it|Copy or export)") as error:
        ModelFile(path).motion().at(1.0)
    assert "\n" not in str(error.value)


# ---- PC2 and MDD


def pc2(path: Path, samples: list[Floats], first: float = 1.0, step: float = 1.0) -> Path:
    head = struct.pack("<12siiffi", b"POINTCACHE2\0", 1, len(samples[0]), first, step, len(samples))
    path.write_bytes(head + b"".join(points.astype("<f4").tobytes() for points in samples))
    return path


def mdd(path: Path, times: list[float], samples: list[Floats]) -> Path:
    head = struct.pack(">ii", len(samples), len(samples[0])) + np.array(times, ">f4").tobytes()
    path.write_bytes(head + b"".join(points.astype(">f4").tobytes() for points in samples))
    return path


def obj(path: Path) -> Path:
    rows = [f"v {x} {y} {z}" for x, y, z in BOX.vertices] + [
        f"f {a + 1} {b + 1} {c + 1}" for a, b, c in BOX.faces
    ]
    path.write_text("\n".join(rows) + "\n")
    return path


def test_points_of_pc2_and_mdd_move_the_faces_of_their_model(tmp_path: Path) -> None:
    model, samples = obj(tmp_path / "a.obj"), [BOX.vertices + k * RISE for k in range(3)]
    frames = ModelFile(model).motion(pc2(tmp_path / "a.pc2", samples, step=0.5))
    assert (frames.times.tolist(), frames.is_in_frames, frames.rate) == ([1.0, 1.5, 2.0], True, None)
    seconds = ModelFile(mdd(tmp_path / "a.mdd", [0.0, 0.25, 1.0], samples)).motion()
    assert (seconds.times.tolist(), seconds.is_in_frames, seconds.is_fixed) == ([0.0, 0.25, 1.0], False, True)
    assert [path.suffix for path, _ in seconds.files.files] == [".mdd", ".obj"]
    for moving, time in ((frames, 1.6), (seconds, 0.9)):
        surface = moving.at(time)
        assert np.array_equal(surface.points, BOX.vertices + RISE)
        assert np.array_equal(surface.corners, FACES)


def test_caches_of_points_that_do_not_fit_are_refused_by_name(tmp_path: Path) -> None:
    path = pc2(tmp_path / "a.pc2", [BOX.vertices, BOX.vertices * np.nan])
    with pytest.raises(
        MeshError, match=r"a\.pc2: it holds points without faces, and no model has its name. Name"
    ):
        ModelFile(path).motion()
    model = obj(tmp_path / "a.obj")
    with pytest.raises(MeshError, match=r"a\.pc2: sample 1: vertex 0 is not finite. Export it again"):
        ModelFile(path).motion().at(2.0)
    short = pc2(tmp_path / "b.pc2", [BOX.vertices[:7]])
    with pytest.raises(MeshError, match=r"b\.pc2: it has 7 points, and a\.obj has 8 vertices. Export both"):
        ModelFile(model).motion(short)
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(MeshError, match=r"it ends early: its header promises 2 samples, and 1 is there"):
        ModelFile(path).motion()
    moving = ModelFile(model).motion(mdd(tmp_path / "a.mdd", [0, 1], [BOX.vertices] * 2))
    (tmp_path / "a.mdd").write_bytes(b"")
    with pytest.raises(MissingInputError, match=r"a\.mdd: it changed"):
        moving.at(0.0)


@pytest.mark.parametrize(
    ("suffix", "most"),
    [
        ("glb", 1 << 30),
        ("fbx", 1 << 30),
        ("usdc", 8 << 30),
        ("abc", 8 << 30),
        ("pc2", 8 << 30),
        ("mdd", 8 << 30),
    ],
)
def test_a_larger_file_is_refused_by_its_size(tmp_path: Path, suffix: str, most: int) -> None:
    obj(tmp_path / "a.obj")
    with (tmp_path / f"a.{suffix}").open("wb") as file:
        file.write(b"Kaydara FBX Binary  \0")
        file.truncate(2 * most)  # a hole, which takes no room on the disk
    with pytest.raises(BadInputError, match=rf"a\.{suffix}: .* up to {most >> 30} GiB are read") as error:
        ModelFile(tmp_path / f"a.{suffix}").motion()
    assert "\n" not in str(error.value)
