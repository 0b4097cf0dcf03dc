"""Alembic files have the points, normals and texture coordinates of one mesh at each frame."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from alembic3d import Abc, AbcGeom

from flowsculpt.pipeline.errors import MachineError, UsageError
from flowsculpt.pipeline.mesh import box, icosphere
from flowsculpt.pipeline.plugins.interchange.alembic_export import write_alembic
from flowsculpt.pipeline.plugins.interchange.one_mesh import OneMesh
from flowsculpt.render.base import root_files
from flowsculpt.render.base.atomic_write import atomic_write
from tests.full_disk import disk_of
from tests.plugins.interchange.moving_meshes import moving, painted


def uncounted(name: str, total: int):
    return lambda: None


def schema_of(path: Path, mesh: OneMesh):
    return AbcGeom.IPolyMesh(Abc.IArchive(str(path)).getTop(), mesh.name).getSchema()


def test_each_frame_is_at_its_number_with_its_points_normals_and_texture_coordinates(tmp_path: Path) -> None:
    ball = painted(moving(icosphere(4), range(5, 29, 2)))
    cube = replace(moving(box(2.0, 0.5), range(5, 29, 2)), name="cube")
    write_alembic(tmp_path / "a.abc", "Twisted", [ball, cube], uncounted)
    for mesh in (ball, cube):
        schema = schema_of(tmp_path / "a.abc", mesh)
        assert schema.getNumSamples() == len(mesh.frames)
        for index, number in enumerate(mesh.frames):
            assert schema.getTimeSampling().getSampleTime(index) == pytest.approx(number / 24)
            at, frame = Abc.ISampleSelector(number / 24), mesh.frame(number)
            sample = schema.getValue(at)
            assert np.array_equal(np.array(sample.getPositions()), frame.points.astype(np.float32))
            assert np.array_equal(np.array(sample.getFaceIndices()).reshape(-1, 3), mesh.faces[:, ::-1])
            normals = np.array(schema.getNormalsParam().getExpandedValue(at).getVals()).reshape(-1, 3, 3)
            assert normals == pytest.approx(frame.normals[mesh.corner_normals[:, ::-1]], abs=1e-6)
        if mesh.texture is not None:
            found = np.array(schema.getUVsParam().getExpandedValue(Abc.ISampleSelector(0.0)).getVals())
            assert found.reshape(-1, 3, 2) == pytest.approx(mesh.texture[:, ::-1], abs=1e-6)


def test_a_file_is_written_into_a_folder_that_is_held_against_links(tmp_path: Path) -> None:
    root_files.guard(tmp_path)
    path = tmp_path / "renders" / "T010" / "a.abc"
    with atomic_write(path) as draft:
        write_alembic(draft, "Twisted", [moving(icosphere(2))], uncounted)
    assert path.stat().st_size > 1000


def test_a_writer_that_ends_early_says_why(tmp_path: Path) -> None:
    (tmp_path / "a.abc").mkdir()
    with pytest.raises(MachineError, match=r"a\.abc could not be written: Could not open file"):
        write_alembic(tmp_path / "a.abc", "Twisted", [moving(icosphere(40), range(1, 60))], uncounted)


def test_a_full_disk_is_one_message_although_the_library_ends_its_process(tmp_path: Path) -> None:
    mesh = moving(icosphere(12))
    with (
        disk_of(40_000),
        pytest.raises(MachineError, match=r"a\.abc could not be written: .* Is the disk full\?"),
    ):
        write_alembic(tmp_path / "a.abc", "Twisted", [mesh], uncounted)


def test_frames_that_are_not_evenly_spaced_are_refused(tmp_path: Path) -> None:
    mesh = replace(moving(icosphere(2)), frames=(1, 2, 5))
    with pytest.raises(UsageError, match="not evenly spaced"):
        write_alembic(tmp_path / "a.abc", "Twisted", [mesh], uncounted)
