"""Planning stays quick for long films: what it does once a frame is counted, not timed."""

from __future__ import annotations

import hashlib
import json
import os
import sys
import threading
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from benchmarks.orchestration import CORES, fill, write_shots
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.production.planning.frame_states import FrameStates
from flowsculpt.pipeline.production.planning.plan import Plan
from flowsculpt.pipeline.production.store.history import History

SHOTS, FRAMES = 10, 100
A_SHOT = 25
"""Calls that a shot may take beside those of its frames: its file, its cache entries, its cameras."""


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> Iterator[list[str]]:
    """A film of which every file is in the store and shown, planned once before; the names of its shots."""
    folder = tmp_path_factory.mktemp("film")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        names = write_shots(SHOTS, FRAMES)
        Path("shots/film.yaml").write_text(f"title: Planned\nrate: 24\nshots: [{', '.join(names)}]\n")
        fill(planned())
        project = Project(folder, CORES)
        planned().restore_links(project.store)
        yield names


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """Counts of looks at files of the film, of digests, and of JSON files that are parsed, by this thread."""
    counts, thread = Counter[str](), threading.get_ident()
    elsewhere = (sys.prefix, sys.base_prefix, str(Path(__file__).parents[2]))  # Python reads sources

    def count(module: Any, name: str, what: str) -> None:
        function = getattr(module, name)

        def counted(*arguments: Any, **named: Any) -> Any:
            if threading.get_ident() == thread and not str(arguments[0]).startswith(elsewhere):
                counts[what] += 1
            return function(*arguments, **named)

        monkeypatch.setattr(module, name, counted)

    count(os, "stat", "looks")
    count(hashlib, "sha256", "digests")
    count(json, "loads", "parsed")
    return counts


def planned() -> Plan:
    return Project(Path.cwd(), CORES).film("draft")


def test_a_plan_that_finds_everything_looks_once_at_each_file(film: list[str], calls: Counter[str]) -> None:
    assert not planned().jobs
    assert calls["looks"] <= 3 * SHOTS * FRAMES + A_SHOT * SHOTS  # mesh, normals and finished frame
    assert calls["digests"] <= A_SHOT * SHOTS, "keys of frames are in the planning cache"
    assert calls["parsed"] <= 5 * SHOTS + 1, "cameras are not parsed where all keys are known"


def test_a_plan_of_an_edited_shot_reads_that_shot_alone(film: list[str], calls: Counter[str]) -> None:
    shot = Path(f"shots/{film[0]}.yaml")
    text = shot.read_text()
    shot.write_text(text.replace("elevation: 14", "elevation: 15"))
    jobs = planned().jobs
    shot.write_text(text)
    assert {job.requests[0] for job in jobs if job.stage != "film"} == {0}
    assert calls["looks"] <= 4 * SHOTS * FRAMES + A_SHOT * SHOTS
    assert calls["digests"] <= 8 * FRAMES + A_SHOT * SHOTS


def test_status_looks_at_each_file_and_at_what_shows_it(film: list[str], calls: Counter[str]) -> None:
    project, history = Project(Path.cwd(), CORES), History.of(Path.cwd())
    for name in film:
        request = project.request(Path(f"shots/{name}.yaml"), "draft")
        found = (FrameStates.of_meshes, FrameStates.of_pictures)
        rows = [states(request, project.store, history) for states in found]
        assert [(row.what, len(row.done)) for row in rows] == [("meshes", FRAMES), ("draft", FRAMES)]
    assert calls["looks"] <= 5 * SHOTS * FRAMES + A_SHOT * SHOTS
    assert calls["digests"] <= A_SHOT * SHOTS


def test_status_of_a_shot_of_which_nothing_was_made_finds_no_keys(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (name,) = write_shots(1, FRAMES)
    monkeypatch.setattr(
        "flowsculpt.pipeline.production.request.manifest.mesh_keys", lambda motion: pytest.fail()
    )
    project = Project(tmp_path, CORES)
    request = project.request(Path(f"shots/{name}.yaml"), "draft")
    row = FrameStates.of_meshes(request, project.store, History.of(tmp_path))
    assert (row.what, len(row.missing)) == ("meshes", FRAMES)


def test_a_run_with_nothing_to_do_looks_twice_at_each_link(film: list[str], calls: Counter[str]) -> None:
    plan, store = planned(), Project(Path.cwd(), CORES).store
    calls.clear()
    assert plan.restore_links(store) == 0
    assert calls["looks"] <= 2 * len(plan.links)
    assert calls["digests"] == 0
