"""Rigid copies as instances of one shape in a USD stage: where each copy is, and how it moves."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from pxr import Usd, UsdGeom

from flowsculpt.pipeline.mesh.mesh_formats import ScenePart
from flowsculpt.pipeline.mesh.read import ModelFile
from flowsculpt.pipeline.plugins.interchange.copy_instances import Instances, rigid_velocities
from flowsculpt.pipeline.plugins.interchange.unifying import Unification
from flowsculpt.pipeline.production.execution.project import Project
from tests.conftest import commanded
from tests.plugins.interchange.test_usd import NAME, findings

SHOT = """\
title: Tiles
frames: 1-4
subjects:
  tiles:
    solid: box
    size: [0.3, 0.1, 0.2]
    look: {material: ceramic, pigment: {palette: {colours: ['#a3301f', '#e7a490', '#fbf6ee']}}}
    copies: {count: 20, seed: 3, rigid: true, size: [0.5, 1], region: {sphere: {radius: 1.2}}}
resample: {max_edge_length: 0.1}
flows:
  - vortex_ring: {radius: 0.8, core: 0.3, strength: 6}
"""
PRIM = f"/{NAME}/sculpture/tiles"


def export(root: Path, text: str, *words: str) -> tuple[int, str]:
    (root / "shots").mkdir(exist_ok=True)
    (root / "shots" / f"{NAME}.yaml").write_text(text)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(root)
        return commanded(root, "export", "usd", NAME, "--json", "--instances", *words)


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("usd")
    code, said = export(root, SHOT)
    assert code == 0, said
    assert json.loads(said)["written"] == [f"{NAME}.tiles.instances.usdc", f"{NAME}.instances.usda"]
    return root


@pytest.fixture
def stage(root: Path) -> Path:
    return root / "renders" / NAME / "usd" / f"{NAME}.instances.usda"


def part(root: Path) -> Unification:
    project = Project(root, 1)
    request = project.request(root / "shots" / f"{NAME}.yaml", "draft")
    return Unification(request.parts[0], project.store)


def test_the_validators_of_usd_find_nothing(stage: Path) -> None:
    assert findings(stage) == []


def test_instances_are_where_the_copies_are_and_move_as_they_do(root: Path, stage: Path) -> None:
    mesh = part(root).one_mesh()
    opened = Usd.Stage.Open(str(stage))
    copies = UsdGeom.PointInstancer(opened.GetPrimAtPath(PRIM))
    shape = np.array(UsdGeom.Mesh(opened.GetPrimAtPath(f"{PRIM}/shape")).GetPointsAttr().Get())
    for number in mesh.frames:
        matrices = np.array([np.array(m) for m in copies.ComputeInstanceTransformsAtTime(number, number)])
        points = np.einsum("vi,nij->nvj", shape, matrices[:, :3, :3]) + matrices[:, None, 3, :3]
        true = mesh.points_at(number)
        assert np.abs(points.reshape(-1, 3) - true).max() < 2e-4  # orientations are half floats
        low, high = np.array(copies.GetExtentAttr().Get(number))
        assert np.allclose([low, high], [true.min(axis=0), true.max(axis=0)], atol=1e-6)
        turning = np.radians(copies.GetAngularVelocitiesAttr().Get(number))[:, None]
        moved = np.cross(turning, points - matrices[:, None, 3, :3])
        moved += np.array(copies.GetVelocitiesAttr().Get(number))[:, None]
        known = mesh.velocities_at(number).reshape(moved.shape)
        assert np.abs(moved - known).max() < 2e-3 * np.abs(known).max()


def test_frames_hold_places_and_no_vertices_however_many_are_exported(root: Path) -> None:
    unification = part(root)
    copies = Instances.of(unification, lambda name, total: lambda: None)
    for number in copies.mesh.frames:
        copies.at(number), copies.mesh.points_at(number)
    frames = unification.rigid_frames.values()
    assert len(frames) == 4 and not any("mesh" in vars(frame) for frame in frames if frame.number > 1)
    assert len({id(frame.own.vertices) for frame in frames}) == 1


def test_each_copy_has_the_colour_of_its_vertices(root: Path, stage: Path) -> None:
    colours = part(root).one_mesh().colours
    assert colours is not None
    opened = Usd.Stage.Open(str(stage))
    primvar = UsdGeom.PrimvarsAPI(opened.GetPrimAtPath(PRIM)).GetPrimvar("displayColor")
    assert primvar.GetInterpolation() == "vertex"
    assert np.allclose(np.repeat(primvar.Get(), len(colours) // 20, axis=0), colours)
    assert len(np.unique(np.round(primvar.Get(), 4), axis=0)) == 3


def test_our_own_reader_finds_the_copies(root: Path, stage: Path) -> None:
    read = ModelFile(stage, ScenePart(PRIM, 3.0)).surface().mesh
    mesh = Unification(part(root).request, Project(root, 1).store).one_mesh()
    assert len(read.vertices) == len(mesh.rest)
    nearest = np.linalg.norm(read.vertices[:, None] - mesh.points_at(3)[None], axis=2).min(axis=1)
    assert nearest.max() < 2e-4


def test_velocities_of_a_rigid_body_are_found_from_its_vertices() -> None:
    rng = np.random.default_rng(5)
    points, origins = rng.normal(size=(4, 9, 3)), rng.normal(size=(4, 3))
    velocities, turning = rng.normal(size=(2, 4, 3))
    moved = velocities[:, None] + np.cross(turning[:, None], points - origins[:, None])
    found = rigid_velocities(points, moved, origins)
    assert np.allclose(found, [velocities, turning])


@pytest.mark.parametrize(
    ("old", "new", "fault"),
    [
        ("rigid: true, ", "", "has no rigid copies"),
        (
            "palette: {colours: ['#a3301f', '#e7a490', '#fbf6ee']}",
            "layers: {colours: ['#a3301f', '#fbf6ee'], scale: 0.3}",
            "a pattern over all",
        ),
    ],
)
def test_what_instances_cannot_hold_is_refused(tmp_path: Path, old: str, new: str, fault: str) -> None:
    text = SHOT.replace(old, new).replace("size: [0.5, 1], ", "size: [0.1, 0.2], ")
    code, said = export(tmp_path, text.replace("frames: 1-4", "frames: 1-2"))
    assert code == 2 and fault in said and "Leave out --instances" in said, said
