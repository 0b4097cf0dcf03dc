"""Several subjects in a USD stage: a prim for each, with its own clips and material."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pxr import Usd, UsdGeom, UsdShade

from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.plugins.interchange.usd_export import UsdExport
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.production.store import readers
from flowsculpt.pipeline.production.tasks.job import Context
from flowsculpt.pipeline.production.tasks.worker import task_of
from tests.conftest import commanded
from tests.needed_plugins import needs_plugins

NAME = "T010_two"
SHOT = """\
title: Two
frames: 1-3
subjects:
  crane: {solid: box, size: [0.6, 0.6, 0.6], place: [-0.8, 0, 0], look: glaze}
  motes: {cloud: {solid: icosphere, radius: 0.4}, count: 20, radius: 0.05, place: [0.8, 0, 0], look: chrome}
resample: {max_edge_length: 0.3}
flows:
  - twist: {axis: y, amount: {ease: linear, keys: {1: 0, 3: 40}}}
"""


def exported(root: Path, text: str = SHOT) -> UsdExport:
    (root / "shots").mkdir(exist_ok=True)
    (root / "shots" / f"{NAME}.yaml").write_text(text)
    project = Project(root, 1)
    request = project.request(root / "shots" / f"{NAME}.yaml", "draft", variant="none")
    plan = project.geometry(request)
    for job in plan.jobs:
        assert task_of(job.stage)(Context.of(root, plan, job.name)), job.name
    export = UsdExport(request, project.store, root / "usd")
    assert export.write(lambda: None) == []
    return export


@pytest.fixture(scope="module")
def export(tmp_path_factory: pytest.TempPathFactory) -> UsdExport:
    return exported(tmp_path_factory.mktemp("usd"))


@needs_plugins("points")
def test_each_subject_is_a_prim_with_its_material_and_its_points_of_each_frame(export: UsdExport) -> None:
    stage = Usd.Stage.Open(str(export.path))
    home = f"/{NAME}/sculpture"
    assert [prim.GetName() for prim in stage.GetPrimAtPath(home).GetChildren()] == ["crane", "motes"]
    kinds = (UsdGeom.Mesh, UsdGeom.Points)
    for part, kind in zip(export.request.parts, kinds, strict=True):
        prim = stage.GetPrimAtPath(f"{home}/{part.source.subject}")
        assert prim.IsA(kind)
        material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
        assert material.GetPath() == f"/{NAME}/materials/sculpture_{part.source.subject}"
        for number in (1, 3):
            key = part.keys.mesh(number)
            vertices = export.store.read("mesh", key, part.place("mesh", number), readers.vertices(key))
            shown = np.array(UsdGeom.PointBased(prim).GetPointsAttr().Get(number))
            assert np.abs(shown - vertices).max() < 1e-6


@needs_plugins("points")
def test_an_edit_of_one_subject_writes_its_clips_alone(export: UsdExport) -> None:
    again = exported(export.folder.parent, SHOT.replace("count: 20", "count: 21"))
    clips = {name for name in again.files.written if name.endswith(".usdc")}
    assert clips == {f"{NAME}.motes.{number:04d}.usdc" for number in (1, 2, 3)}


@needs_plugins("points")
def test_a_stage_is_of_all_subjects(export: UsdExport, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(export.folder.parent)
    code, said = commanded(Path.cwd(), "export", "usd", NAME, "--subject", "crane")
    assert code == UsageError.exit_code and said.startswith("--subject crane: a USD stage holds all subjects")


@needs_plugins("points")
def test_vertices_of_copies_have_the_number_of_their_copy_in_all_frames(tmp_path: Path) -> None:
    beads = "beads: {solid: box, size: [0.3, 0.3, 0.3], copies: {count: 3, region: {box: {size: [2, 1, 1]}}}}"
    written = exported(tmp_path, SHOT.replace("resample:", f"  {beads}\nresample:", 1))
    stage = Usd.Stage.Open(str(written.path))
    prim = stage.GetPrimAtPath(f"/{NAME}/sculpture/beads")
    for frame in (1, 3):
        mesh, api = UsdGeom.Mesh(prim), UsdGeom.PrimvarsAPI(prim)
        copies, rest = (np.array(api.GetPrimvar(name).Get(frame)) for name in ("copy", "rest"))
        faces = np.array(mesh.GetFaceVertexIndicesAttr().Get(frame)).reshape(-1, 3)
        assert set(copies) == {1, 2, 3}
        assert (copies[faces] == copies[faces[:, :1]]).all()
        for number in (1, 2, 3):
            own = rest[copies == number]
            assert np.allclose(own.max(axis=0) - own.min(axis=0), 0.3, atol=1e-5)
