"""Status, `why`, frame words and dry runs agree with each other, and with what a run then makes."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from flowsculpt.pipeline.frames import FrameRange, FrameSelection
from flowsculpt.pipeline.plugins.maintenance.why import explain
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.production.planning.estimate import Forecast
from flowsculpt.pipeline.production.planning.frame_states import FrameStates
from flowsculpt.pipeline.production.request.lookup import Show
from flowsculpt.pipeline.production.store.event_log import EventReader
from flowsculpt.pipeline.production.store.history import History
from flowsculpt.pipeline.production.store.paths import EVENTS
from tests.conftest import QUALITY, done
from tests.plugins.maintenance.test_why import CASES, NAME, Case

EXTENDED = Case("more frames", (), ("frames: 1-6", "frames: 1-8"))
STEADY = ("quality.draft={temporal_denoise: 2}",)


def forecast(project: Project, frames: str | None = None) -> tuple[set[int], set[int]]:
    """Return the finished frames that a dry run names: those made for certain, and those perhaps."""
    asked = None if frames is None else FrameSelection.of_text(frames)
    told = Forecast.of(project.pictures([NAME], QUALITY, asked), project.store)
    frames_of = {n for job in told.plan.jobs if job.stage == "finish" for n in job.frames}
    perhaps = set(told.unframed.get("finish", ()))
    return frames_of - perhaps, perhaps


def states(project: Project) -> dict[str, set[int]]:
    """Return the frames by state, as `status` lists them; `why` must say the same."""
    request = project.request(Show().find_shot(NAME), QUALITY)
    told = FrameStates.of_pictures(request, project.store, History.of(project.root))
    by_state = {name: set(getattr(told, name)) for name in ("done", "stale", "unframed", "missing")}
    for state, numbers in by_state.items():
        assert {explain(project, request, n).state for n in numbers} <= {state}
    return by_state


@pytest.fixture
def edited(finished_project: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """Return a function that makes a finished project with the edit of a case, and the project."""

    def make(case: Case) -> tuple[Any, Project]:
        folder = finished_project.copy(tmp_path / "studio")
        monkeypatch.chdir(folder.path)
        text, (old, new) = folder.shot.read_text(), case.replace
        folder.shot.write_text(text.replace(old, new, 1) if old else text + new)
        for name, content in case.files:
            (folder.shot.parent / name).write_text(content)
        return folder, Project(folder.path, 2, settings=case.settings)

    yield make


@pytest.mark.parametrize("case", [*CASES, EXTENDED], ids=lambda case: case.id)
def test_status_why_words_and_a_dry_run_name_the_same_frames(edited: Any, case: Case) -> None:
    _, project = edited(case)
    by_state = states(project)
    assert forecast(project) == (by_state["stale"] | by_state["missing"], by_state["unframed"])
    asked = project.find_request(NAME, QUALITY, FrameSelection.of_text("stale,missing")).requested
    assert set(asked) == set().union(*by_state.values()) - by_state["done"]


def check_a_run(edited: Any, case: Case) -> None:
    folder, project = edited(case)
    certain, perhaps = forecast(project)
    settings = [word for setting in case.settings for word in ("--set", setting)]
    ran = folder.run("--json", "render", NAME, "-q", QUALITY, *settings)
    assert ran.code == 0, ran.err
    events = [
        event
        for run in json.loads(ran.out)["runs"]
        for event in EventReader(folder.path / EVENTS / f"{run}.jsonl").new()
    ]
    made = {
        event["frame"]
        for event in events
        if event["event"] == "frame" and event["stage"] == "finish" and not event["found"]
    }
    assert certain <= made <= certain | perhaps
    after = states(Project(folder.path, 2, settings=case.settings))
    assert not (after["stale"] | after["unframed"] | after["missing"])


@pytest.mark.parametrize("case", [EXTENDED], ids=lambda case: case.id)
def test_a_run_makes_the_frames_that_a_dry_run_names(edited: Any, case: Case) -> None:
    check_a_run(edited, case)


@pytest.mark.soak
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.id)
def test_a_run_makes_the_frames_that_a_dry_run_names_after_any_edit(edited: Any, case: Case) -> None:
    check_a_run(edited, case)


def test_a_frame_that_was_rendered_alone_is_done_for_all_who_ask(
    project: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(project.path)
    now = Project(project.path, 2, settings=STEADY)
    done(project.path, now.stills([NAME], "png", QUALITY, FrameRange.parse("3")))
    now = Project(project.path, 2, settings=STEADY)
    assert states(now) == {"done": {3}, "stale": set(), "unframed": set(), "missing": {1, 2, 4, 5, 6}}
    assert forecast(now, "3") == (set(), set()) and 3 in forecast(now)[0], "all are averaged with all"
    alone = explain(now, now.request(Show().find_shot(NAME), QUALITY), 3)
    assert alone.reasons == ("it is averaged with frames 1-2,4-5 too once they are rendered",)


def test_a_late_edit_of_a_long_shot_leaves_early_frames_done(
    project: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Cameras depend on frames near them: those far from an edit are known before they are framed again."""
    monkeypatch.chdir(project.path)
    text = project.shot.read_text().replace("1-6", "1-64").replace("0.5}", "3}")
    project.shot.write_text(text.replace("6: 60", "60: 60, 64: 64"))
    project.render("1,12,40,64", quality="draft.scale5")
    project.shot.write_text(text.replace("6: 60", "60: 60, 64: 94"))
    now = Project(project.path, 2)
    request = now.request(Show().find_shot(NAME), "draft.scale5", FrameRange.parse("1,12,40,64"))
    known = now.known_pictures(request)
    assert [known.state(n) for n in (1, 12, 40, 64)] == ["done", "done", "unframed", "stale"]


def test_links_that_no_job_needs_are_shown_again(finished: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """A mesh that another request made, such as a cell of a wedge, is shown by the shot too."""
    monkeypatch.chdir(finished.path)
    home = finished.path / "renders" / NAME
    for lost in (home / "meshes" / f"{NAME}.0003.npz", home / "normals" / f"{NAME}.0003.npz"):
        lost.unlink()
    (home / f"{NAME}.cameras.json").unlink()
    project = Project(finished.path, 2)
    plan = project.pictures([NAME], QUALITY)
    assert not plan.jobs and plan.restore_links(project.store) == 3
    assert not FrameStates.of_meshes(
        project.request(Show().find_shot(NAME), QUALITY), project.store, History(finished.path)
    ).missing
