"""Versions and wedges by the real command and the real workflow, from the shot file to the comparison."""

from __future__ import annotations

import json
from typing import Any

import pytest

from flowsculpt.render.movie.probe import probe_movie

NAME = "T010_tiny"
SMALL = ("-q", "draft", "--scale", "10%")


@pytest.mark.soak
def test_a_version_is_rendered_published_edited_away_and_made_again(project: Any) -> None:
    assert project.run("render", NAME, *SMALL).code == 0
    assert project.run("publish", NAME, *SMALL, "--note", "so it was").code == 0
    project.shot.write_text(project.shot.read_text().replace("azimuth: -30", "azimuth: 40"))
    assert project.run("publish", NAME, *SMALL).code == 2
    before = sorted(path.name for path in (project.path / "renders" / NAME).rglob("*"))
    again = project.run("--json", "reproduce", f"renders/published/{NAME}/v001/provenance.json")
    assert again.code == 0, again.err
    assert json.loads(again.out)["identical"] == [*(f"frame {n}" for n in range(1, 7)), "movie"]
    assert sorted(path.name for path in (project.path / "renders" / NAME).rglob("*")) == before
    assert project.run("render", NAME, *SMALL).code == 0
    assert project.run("publish", NAME, *SMALL).code == 0
    assert [fact["version"] for fact in json.loads(project.run("--json", "versions").out)] == ["v001", "v002"]


@pytest.mark.soak
def test_a_wedge_is_one_run_and_the_second_does_nothing(project: Any) -> None:
    vary = (
        "--vary",
        "flows.0.twist.amount.keys.6=40,80",
        "--vary",
        "look=clay,glaze",
        "--vary",
        "lights.exposure=0,1",
    )
    first = project.run("--json", "wedge", NAME, *vary, "-f", "5-6", *SMALL)
    assert first.code == 0, first.err
    facts = json.loads(first.out)
    assert len(facts["cells"]) == 8 and facts["made"]["render"] == 8
    still, movie = (project.path / sheet for sheet in facts["sheets"])
    assert still.is_file() and probe_movie(movie).frames == 2
    frames = [project.path / cell["folder"] / "draft.scale10" / "frames" for cell in facts["cells"]]
    assert all(len(list(folder.glob("*.exr"))) == 2 for folder in frames)
    again = json.loads(project.run("--json", "wedge", NAME, *vary, "-f", "5-6", *SMALL).out)
    assert again["made"] == {} and again["done"]
