"""The first pictures of a run: an animatic from what it has simulated, and its first finished frame."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from flowsculpt.pipeline.plugins.preview.first_pictures import FirstPictures
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.production.planning.plan import Plan
from flowsculpt.pipeline.production.store.event_log import EventReader
from flowsculpt.pipeline.production.store.paths import EVENTS
from flowsculpt.pipeline.production.store.store import Store
from flowsculpt.render.movie.probe import probe_movie
from flowsculpt.render.post.image import read_png
from tests.conftest import FILM, QUALITY, ProjectFolder, done, new_project

NAME = "T010_tiny"


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[ProjectFolder, Plan]:
    """A project, and the plan of its film, whose jobs were done without a film at the end."""
    project = new_project(tmp_path_factory.mktemp("made"))
    (project.path / "shots/film.yaml").write_text(FILM.replace("[T010_tiny]", "[T010_tiny, T010_tiny]"))
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(project.path)
        plan = Project(project.path, 1).film(QUALITY)
        plan.freeze(project.path)
        done(project.path, plan)
    return project, plan


@pytest.mark.slow
def test_the_animatic_of_a_film_has_its_cards_and_every_clip(made: tuple[ProjectFolder, Plan]) -> None:
    project, plan = made
    stored = set(Store(project.path).entries())
    (line,) = FirstPictures(project.path, plan).animatics()
    assert line == "Animatic: renders/film/preview/film.mp4 (24 frames, drawn without a path tracer)"
    facts = probe_movie(project.path / "renders/film/preview/film.mp4")
    assert facts.frames == 12 + 6 + 6 and (facts.width, facts.height) == (480, 270)
    assert set(Store(project.path).entries()) == stored, "the store holds no more than before"


@pytest.mark.slow
def test_it_is_the_one_that_the_command_draws(made: tuple[ProjectFolder, Plan]) -> None:
    project, plan = made
    list(FirstPictures(project.path, plan).animatics())
    drawn = (project.path / "renders/film/preview/film.mp4").read_bytes()
    assert project.call("preview", "film").code == 0
    assert (project.path / "renders/film/preview/film.mp4").read_bytes() == drawn


@pytest.mark.slow
def test_an_edit_is_drawn_whole(made: tuple[ProjectFolder, Plan]) -> None:
    said = made[0].call("preview", "film", "--at", "3")
    assert said.code == 2 and "film is an edit, always drawn whole" in said.err


@pytest.mark.slow
def test_the_first_finished_frame_is_a_still_of_the_shot(made: tuple[ProjectFolder, Plan]) -> None:
    project, plan = made
    (line,) = FirstPictures(project.path, plan).frame()
    path = project.path / line.removeprefix("First finished frame: ")
    assert path.parent == project.path / "renders" / NAME / QUALITY / "png"
    picture = read_png(path)
    assert picture.shape == (54, 96, 3) and np.ptp(picture) > 30
    number = path.stem.rpartition(".")[2].lstrip("0")
    planned = project.call("--dry-run", "stills", NAME, "-q", QUALITY, "-f", number)
    assert "Nothing to be done" in planned.out


@pytest.mark.slow
def test_what_fails_is_one_line_and_its_time_is_in_the_log(
    made: tuple[ProjectFolder, Plan], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    project = made[0].copy(tmp_path / "copy")
    shutil.rmtree(project.path / "renders/film/preview", ignore_errors=True)
    (project.path / "renders/film/preview").write_text("in the way")
    pictures = FirstPictures(project.path, made[1])
    pictures.say("animatic", pictures.animatics)
    said = capsys.readouterr().out
    assert said.startswith("the animatic is left out: ") and said.count("\n") == 1
    log = project.path / EVENTS / f"{made[1].name}.jsonl"
    assert [event["stage"] for event in EventReader(log).new("animatic")] == ["animatic"]
