"""Edits by name: which file is one, what its film is called, and which part of a shot it shows."""

from __future__ import annotations

import wave
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from flowsculpt.pipeline.errors import FlowsculptError, MissingInputError, ShotError, UsageError
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.production.execution.snakefile import PlannedWorkflow
from flowsculpt.pipeline.production.request.edit import Edit
from flowsculpt.pipeline.production.request.keys import FrameKeys
from flowsculpt.pipeline.production.request.lookup import Show
from flowsculpt.pipeline.shot import read_film
from flowsculpt.pipeline.shot.yaml.named_files import is_edit
from flowsculpt.render.movie.probe import probe_movie
from tests.conftest import QUALITY
from tests.needed_plugins import installed
from tests.production.snakemake import workflow

REEL = """\
title: Reel
shots:
  - {shot: T010_tiny, frames: 2-4}
  - T010_tiny
  - {shot: T010_tiny, frames: "6,5"}
title_seconds: 0.25
credits_seconds: 0
rate: 24
"""


@pytest.fixture
def there(project, monkeypatch):
    """A project with a second edit, which is the working folder."""
    (project.path / "shots" / "reel.yaml").write_text(REEL)
    monkeypatch.chdir(project.path)
    return project


def test_an_edit_is_told_from_a_shot_even_where_it_is_no_good_yaml(there):
    Path("shots/broken.yaml").write_text("title: [\nshots: [T010_tiny\n")
    assert Show().edits() == ["broken", "film", "reel"]
    assert Show().shots() == ["T010_tiny"]
    assert not is_edit(Path("shots/T010_tiny.yaml")) and not is_edit(Path("shots/none.yaml"))


@pytest.mark.parametrize(
    ("name", "kind", "says"),
    [
        ("rel", MissingInputError, "shots/rel.yaml: no such edit; did you mean reel?"),
        ("shots/reels.yaml", MissingInputError, "shots/reels.yaml: no such edit; did you mean reel?"),
        ("T010_tiny", UsageError, "shots/T010_tiny.yaml is a shot, not an edit; flowsculpt render T010_tiny"),
        ("shots/T010_tiny.yaml", UsageError, "is a shot, not an edit"),
        ("T010_tinny", MissingInputError, "no such edit; did you mean film, reel?"),
        ("a b", UsageError, "cannot name an edit"),
    ],
)
def test_what_is_no_edit_is_told_with_the_nearest_that_is(there, name, kind, says):
    with pytest.raises(FlowsculptError) as error:
        Show().find_edit(name)
    assert type(error.value) is kind
    assert says in str(error.value)


def test_a_name_and_a_path_find_the_same_edit(there):
    assert Show().find_edit("reel") == Show().find_edit("shots/reel.yaml") == Path("shots/reel.yaml")


@pytest.mark.parametrize("name", ["reel", "shots/reel.yaml", "film"])
def test_an_edit_is_no_shot_to_render(there, name):
    with pytest.raises(UsageError, match="is an edit, not a shot; flowsculpt film"):
        Show().find_shot(name)


def test_each_edit_has_a_film_of_its_own(there):
    project = Project(there.path, cores=2)
    assert "renders/film/draft/film.mp4" in project.film("draft", Show().find_edit("film")).targets
    reel = project.film("draft", Show().find_edit("reel"))
    assert "renders/film/draft/reel.mp4" in reel.targets
    assert "renders/film/draft/film.mp4" not in reel.targets
    (film,) = [job for job in reel.jobs if job.stage == "film"]
    shown = [number for place in film.requests for number in reel.requests[place].requested]
    assert shown == [2, 3, 4, 1, 2, 3, 4, 5, 6, 6, 5]
    finished = [job for job in reel.jobs if job.output in reel.all_inputs(film)]
    assert {number for job in finished for number in job.frames} == set(shown)
    assert len(film.frames) == 6 + len(shown)


def test_only_the_part_that_an_edit_shows_is_rendered(there):
    Path("shots/reel.yaml").write_text("title: R\nshots: [{shot: T010_tiny, frames: 2-4}]\n")
    plan = Project(there.path, cores=2).film("draft", Show().find_edit("reel"))
    assert sorted(n for job in plan.jobs if job.stage == "render" for n in job.frames) == [2, 3, 4]


def test_an_edit_of_another_name_and_the_same_cut_has_the_same_key(there):
    Path("shots/other.yaml").write_text(Path("shots/film.yaml").read_text())
    films = [read_film(path) for path in ("shots/film.yaml", "shots/other.yaml")]
    clip: Any = SimpleNamespace(requested=[1], quality_name="draft", manifest=SimpleNamespace(shown_as=0.0))
    keys = {1: FrameKeys(raw="", frame="a", window=(1,))}
    found = {Edit.of(film, name).key([clip], [keys]) for film, name in zip(films, "ab", strict=True)}
    assert len(found) == 1


def never(*arguments: object, **others: object) -> None:
    raise AssertionError("it was read")


def test_an_edit_is_planned_again_without_reading_it_or_its_shots(there, monkeypatch):
    Path(".flowsculpt").mkdir()
    first = Project(there.path, cores=2).film("draft", Show().find_edit("reel"))
    monkeypatch.setattr("flowsculpt.pipeline.shot.film_reader.read_film", never)
    monkeypatch.setattr("flowsculpt.pipeline.shot.shot_reader.read_shot", never)
    again = Project(there.path, cores=2).film("draft", Show().find_edit("reel"))
    assert (again.jobs, again.film, again.targets) == (first.jobs, first.film, first.targets)


@pytest.mark.parametrize(
    ("file", "old", "new", "says"),
    [
        ("T010_tiny", "title:", "rate: 25\ntitle:", r"plays at 25 frames per second and the film at 24"),
        ("T010_tiny", "title:", "titlex:", r"Did you mean 'title'"),
        ("reel", "2-4", "2-9", r"frames 7-9 are not in T010_tiny"),
    ],
)
def test_what_became_wrong_since_an_edit_was_planned_is_told(there, file, old, new, says):
    Path(".flowsculpt").mkdir()
    Project(there.path, cores=2).film("draft", Show().find_edit("reel"))
    path = Path(f"shots/{file}.yaml")
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new, 1))
    with pytest.raises(ShotError, match=says):
        Project(there.path, cores=2).film("draft", Show().find_edit("reel"))


def test_an_edit_of_whole_shots_shows_what_they_have_by_now(there):
    Path(".flowsculpt").mkdir()
    shot, project = Path("shots/T010_tiny.yaml"), Project(there.path, cores=2)
    before = project.film("draft", Show().find_edit("film"))
    shot.write_text(shot.read_text().replace("frames: 1-6", "frames: 1-7"))
    after = Project(there.path, cores=2).film("draft", Show().find_edit("film"))
    assert [len(plan.requests[0].requested) for plan in (before, after)] == [6, 7]


def test_the_length_of_a_film_is_that_of_its_clips_and_cards(there):
    assert read_film("shots/reel.yaml").seconds == pytest.approx(0.25 + (3 + 6 + 2) / 24)


@pytest.mark.parametrize(
    ("entry", "says"),
    [
        (
            "{shot: T010_tiny, frames: 5-9}",
            r"reel\.yaml:2:27: frames 7-9 are not in T010_tiny, which has 1-6",
        ),
        ("{shot: T010_tiny, frames: a-b}", r"reel\.yaml:2:27: 'a-b' is not a frame range"),
        ("{shot: T010_tiny, frame: 1-2}", r"frame: unknown name. Did you mean 'frames'"),
    ],
)
def test_a_part_that_cannot_be_is_told_with_its_place(there, entry, says):
    Path("shots/reel.yaml").write_text(f"title: R\nshots: [{entry}]\n")
    with pytest.raises(ShotError, match=says):
        read_film("shots/reel.yaml")


def test_a_clip_of_a_shot_that_is_not_there_is_a_missing_input(there):
    Path("shots/reel.yaml").write_text("title: R\nshots: [{shot: T010_tinny, frames: 1-2}]\n")
    with pytest.raises(MissingInputError, match=r"reel\.yaml:2:\d+: .*Did you mean 'T010_tiny'"):
        read_film("shots/reel.yaml")


def test_plain_snakemake_plans_the_edit_that_it_is_given(there):
    plan = PlannedWorkflow(workflow(), {"edit": "reel", "quality": "draft"}).plan
    assert plan.film is not None and plan.film.name == "reel"


def test_plain_snakemake_takes_the_former_name_of_draft(there):
    plan = PlannedWorkflow(workflow(), {"edit": "reel", "quality": "preview"}).plan
    assert "renders/film/draft/reel.mp4" in plan.outputs


def test_the_command_makes_the_film_of_an_edit_beside_the_main_one(finished):
    (finished.path / "shots" / "reel.yaml").write_text(REEL)
    before = (finished.path / f"renders/film/{QUALITY}/film.mp4").read_bytes()
    done = finished.run("film", "reel", "-q", QUALITY)
    assert done.code == 0, done.err
    assert f"renders/film/{QUALITY}/reel.mp4" in done.out
    assert probe_movie(finished.path / f"renders/film/{QUALITY}/reel.mp4").frames == 6 + 11
    assert (finished.path / f"renders/film/{QUALITY}/film.mp4").read_bytes() == before
    for words in installed(["validate"]):
        assert "reel" in finished.call(*words).out


def test_the_film_dissolves_between_its_pieces_and_is_heard(finished):
    shots = finished.path / "shots"
    with wave.open(str(shots / "tone.wav"), "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(8000)
        file.writeframes(b"\x00\x20" * 8000)
    (shots / "reel.yaml").write_text(
        "title: Reel\ntitle_seconds: 0.5\nshots:\n  - {shot: T010_tiny, dissolve: 3}\n"
        "  - {card: Two, seconds: 0.5}\n  - {shot: T010_tiny, frames: 2-6, dissolve: 2}\n"
        "sound: {file: tone.wav}\n"
    )
    assert finished.run("film", "reel", "-q", QUALITY).code == 0
    facts = probe_movie(finished.path / f"renders/film/{QUALITY}/reel.mp4")
    assert facts.frames == 12 + 6 + 12 + 5 - 3 - 2
    assert facts.sound == "aac"
    assert facts.frames / 24 <= facts.seconds <= facts.frames / 24 + 0.05
    again = finished.call("film", "reel", "-q", QUALITY)
    assert "Nothing to be done" in again.out
    (shots / "tone.wav").write_bytes((shots / "tone.wav").read_bytes()[:-2] + b"\x01\x20")
    assert "encoding the film" in finished.call("--dry-run", "film", "reel", "-q", QUALITY).out
