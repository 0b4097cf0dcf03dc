"""Shots that are edited as productions do end with the files of a fresh folder (see `edited_shots`)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import chdir
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.production.store.store import Store
from tests.conftest import done
from tests.needed_plugins import needs_plugins
from tests.production.edited_shots import SUBJECTS, SUBJECTS_BY_FITS, EditedShot, edits, shots

pytestmark = [pytest.mark.quick, needs_plugins("become", "fields", "points", "polyhedra")]

Shots = Mapping[str, EditedShot]


def simulate(root: Path, edited: Shots) -> None:
    """Write the shots and simulate them; no frame is computed whose file the store holds."""
    (root / "shots").mkdir(parents=True, exist_ok=True)
    for name, shot in edited.items():
        (root / "shots" / f"{name}.yaml").write_text(shot.text)
    for name in edited:
        with chdir(root):
            project = Project(root, 1)
            store, plan = Store(root), project.meshes([name])
            parts = project.request(root / "shots" / f"{name}.yaml", "draft").parts
            wanted = {
                part.keys.mesh(n) for part in parts for n in range(edited[name].first, edited[name].last + 1)
            }
            missing = wanted - {key for kind, key, _ in store.entries() if kind == "mesh"}
            assert sum(len(job.frames) for job in plan.jobs if job.stage == "simulate") == len(missing)
            plan.restore_links(store)
            done(root, plan)


def meshes(root: Path, edited: Shots) -> dict[str, bytes]:
    """Return the mesh files of the frames of shots, by shot, subject and frame."""
    return {
        f"{name} {path.parent.name} {number}": path.read_bytes()
        for name, shot in edited.items()
        for path in (root / "renders" / name / "meshes").rglob("*.npz")
        if shot.first <= (number := int(path.stem.rpartition(".")[2])) <= shot.last
    }


def require_fresh_files(begin: Shots, changes: Iterable[tuple[str, str, int]], folder: Path) -> None:
    """Simulate shots after each edit, then in a fresh folder, and compare the files."""
    edited, now = folder / "edited", dict(begin)
    simulate(edited, now)
    for name, kind, by in changes:
        if name in now:
            now[name] = now[name].edited(kind, by)
            simulate(edited, now)
    simulate(folder / "fresh", now)
    fresh = meshes(folder / "fresh", now)
    assert len(fresh) >= sum(shot.last - shot.first + 1 for shot in now.values())
    assert meshes(edited, now) == fresh


def require_edits_leave_no_trace(
    shot: EditedShot, other: tuple[str, str, int] | None, changes: Iterable[tuple[str, str, int]]
) -> None:
    """A second shot, if any, has the same subject: it is the first one, edited once."""
    with TemporaryDirectory() as folder:
        second = {} if other is None else {"B": shot.edited(*other[1:])}
        require_fresh_files({"A": shot, **second}, changes, Path(folder))


@given(shots(SUBJECTS), st.none() | edits, st.lists(edits, min_size=1, max_size=3))
@settings(max_examples=15)
def test_a_shot_that_is_edited_ends_with_the_meshes_of_a_fresh_folder(shot, other, changes) -> None:
    require_edits_leave_no_trace(shot, other, changes)


@pytest.mark.soak
@given(shots(SUBJECTS | SUBJECTS_BY_FITS), st.none() | edits, st.lists(edits, min_size=1, max_size=5))
@settings(max_examples=300)
def test_hundreds_of_edits_end_with_the_meshes_of_fresh_folders(shot, other, changes) -> None:
    require_edits_leave_no_trace(shot, other, changes)
