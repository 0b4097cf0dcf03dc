"""Tests of the commands by which other programs edit a shot and find the files of its frames."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from flowsculpt.pipeline.cli.app import command_line
from flowsculpt.pipeline.errors import FlowsculptError
from flowsculpt.pipeline.production.execution.project import Project
from tests.conftest import ProjectFolder, done

SHOT = """\
title: A box, twisted   # by hand
frames: 1-4
subject: {solid: box, size: [2, 2, 2]}
resample: {max_edge_length: 0.5}
flows:
  # the middle stays
  - twist: {axis: y, amount: {ease: linear, keys: {1: 0, 3: 36, 4: 60}}}  # wrung
camera: {azimuth: -30, elevation: 14}
"""


@pytest.fixture
def shot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    path = tmp_path / "shots" / "T010_tiny.yaml"
    path.parent.mkdir()
    path.write_text(SHOT)
    monkeypatch.chdir(tmp_path)
    return path


def answer(request: Any, *words: str) -> tuple[int, dict[str, Any]]:
    """Exit code and last answer of a command to a request on standard input."""
    text = request if isinstance(request, str) else json.dumps(request)
    ran = CliRunner().invoke(command_line(), [*words, "T010_tiny"], input=text)
    code = ran.exit_code
    if isinstance(ran.exception, FlowsculptError):
        code = ran.exception.exit_code
        assert json.loads(ran.stdout)["error"] == str(ran.exception)
    return code, json.loads(ran.stdout.splitlines()[-1])


def test_an_edit_keeps_comments_and_answers_with_the_new_state(shot: Path) -> None:
    _, before = answer({}, "edit")
    places = [value["where"] for value in before["values"]]
    assert ["flows", 0, "twist", "centre"] in places, "values that the file leaves out are listed too"
    keys = {"where": ["flows", 0, "twist", "amount", "keys"], "kind": "set", "value": {1: 0, 4: 90}}
    centre = {"where": ["flows", 0, "twist", "centre"], "kind": "set", "value": [0, 0.5, 0]}
    request = {"digest": before["digest"], "edits": [keys, centre]}
    _, tried = answer(request, "--dry-run", "edit")
    assert shot.read_text() == SHOT
    code, after = answer(request, "edit")
    assert code == 0 and after["digest"] == tried["digest"] != before["digest"]
    line = "  - twist: {axis: y, amount: {ease: linear, keys: {1: 0, 4: 90}}, centre: [0, 0.5, 0]}  # wrung"
    assert shot.read_text() == SHOT.replace(SHOT.splitlines()[6], line)
    assert next(v["value"] for v in after["values"] if v["where"] == centre["where"]) == [0, 0.5, 0]


def test_an_edit_of_a_file_that_others_changed_is_refused_as_changed(shot: Path) -> None:
    _, before = answer({}, "edit")
    shot.write_text(SHOT.replace("14", "15"))
    edit = {"where": ["camera", "azimuth"], "kind": "set", "value": 0}
    code, refused = answer({"digest": before["digest"], "edits": [edit]}, "edit")
    assert code == 2 and refused["changed"] and "nothing was written" in refused["error"]
    assert "azimuth: -30" in shot.read_text()


@pytest.mark.parametrize(
    ("request_text", "words"),
    [
        ('{"digest": "DIGEST", "edits": [{"kind": "set", "where": ["frames"], "value": "9-1"}]}', ":2:1: "),
        ('{"digest": "DIGEST", "edits": [{"kind": "set", "where": ["camera", "tilt"], "value": 1}]}', "tilt"),
        ('{"digest": "DIGEST", "edits": []}', "1 to 1000"),
        ('{"edits": []}', "names the digest of the file"),
        ('{"edits": NaN}', "a request is a JSON object"),
        ('{"edit": []}', "no edit"),
        ("", "a request is a JSON object"),
    ],
)
def test_a_bad_request_is_answered_with_one_error(shot: Path, request_text: str, words: str) -> None:
    digest = answer({}, "edit")[1]["digest"]
    code, refused = answer(request_text.replace("DIGEST", digest), "edit")
    assert code == 2 and words in refused["error"] and not refused["changed"]
    assert shot.read_text() == SHOT


def test_a_camera_with_keys_at_a_thousand_frames_is_written(shot: Path) -> None:
    shot.write_text(SHOT.replace("1-4", "1-1000").replace("azimuth: -30, elevation: 14", "distance: 6"))
    keys = {number: [number / 701, -number / 903, 6 + number / 1103] for number in range(1, 1001)}
    where = ["camera", "target"]
    edit = {"kind": "set", "where": where, "value": {"ease": "linear", "keys": keys}}
    request = {"digest": answer({}, "edit")[1]["digest"], "edits": [edit]}
    assert len(json.dumps(request)) > 65_536
    code, state = answer(request, "edit")
    assert code == 0, state
    found = next(value for value in state["values"] if value["where"] == where)
    assert len(found["value"]["keys"]) == 1000


def test_an_edit_that_makes_the_file_larger_than_any_may_be_is_refused(shot: Path) -> None:
    edit = {"where": ["title"], "kind": "set", "value": "word " * 70_000}
    request = {"digest": answer({}, "edit")[1]["digest"], "edits": [edit]}
    code, refused = answer(request, "edit")
    assert code == 2 and "would be larger than 300 kB" in refused["error"] and shot.read_text() == SHOT
    code, refused = answer({**request, "edits": [{**edit, "value": "word " * 300_000}]}, "edit")
    assert code == 2 and "at most 1048576 bytes; divide it" in refused["error"]


def test_frames_are_listed_with_files_that_appear_once_they_are_simulated(shot: Path, tmp_path: Path) -> None:
    _, before = answer("", "frames")
    rows = before["subjects"][0]["meshes"]
    assert [row["frame"] for row in rows] == [1, 2, 3, 4] and before["cameras"] is None
    assert {row["state"] for row in rows} == {"missing"} and not Path(rows[0]["file"]).exists()
    project = Project(tmp_path, 1)
    done(tmp_path, project.geometry(project.request(shot, "draft", variant="none")))
    _, after = answer("", "frames")
    assert [row["key"] for row in after["subjects"][0]["meshes"]] == [row["key"] for row in rows]
    assert all(Path(row["file"]).is_file() for row in rows)
    assert after["cameras"]["4"]["field_of_view"] == pytest.approx(26.0)
    shot.write_text(SHOT.replace("4: 60", "4: 90"))
    _, edited = answer("", "frames")
    states = [row["state"] for row in edited["subjects"][0]["meshes"]]
    assert states == ["done", "done", "done", "missing"], "an edit changes only the frames that it affects"


def test_frames_of_a_broken_shot_are_answered_with_its_line(shot: Path) -> None:
    shot.write_text(SHOT.replace("axis: y", "axis: q"))
    code, refused = answer("", "frames")
    assert code == 2 and ":7:13: " in refused["error"]


@pytest.mark.parametrize("command", ["edit", "frames"])
def test_a_shot_that_does_not_exist_is_answered_with_an_error(shot: Path, command: str) -> None:
    shot.rename(shot.with_name("T020_other.yaml"))
    code, refused = answer({}, command)
    assert code == 3 and "T010_tiny" in refused["error"]


@pytest.mark.soak
def test_make_says_how_many_frames_are_done_and_lists_pictures(project: ProjectFolder) -> None:
    ran = project.run(
        "frames", "T010_tiny", "--make", "-q", "draft", "-f", "1-2", "--set", "quality.draft.samples=1"
    )
    assert ran.code == 0, ran.err
    *steps, listing = map(json.loads, ran.out.splitlines())
    rendered = [step for step in steps if step["stage"] == "render"]
    assert [(step["done"], step["total"]) for step in rendered] == [(1, 2), (2, 2)]
    assert [row["state"] for row in listing["pictures"]] == ["done", "done"]
    assert all(Path(row["file"]).is_file() for row in listing["pictures"]) and listing["failed"] == []
