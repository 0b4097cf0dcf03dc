"""New shots, checks and schemas, as a user meets their commands."""

import json
import re

import numpy as np
import pytest

from flowsculpt.pipeline.mesh import TriangleMesh, icosphere
from tests.conftest import lines
from tests.needed_plugins import needs_plugins

NAME = "T010_tiny"


def test_flows_lists_what_there_is_and_tells_of_one(project):
    listed = project.call("flows")
    assert listed.code == 0 and "vortex_ring" in listed.out and "lorenz" in listed.out
    one = json.loads(project.call("flows", "vortex", "--json").out)
    assert {"name": "strength", "unit": "units²/s", "default": 1.0}.items() <= one["parameters"][3].items()
    unknown = project.call("flows", "vortx")
    assert unknown.code == 2 and "Did you mean 'vortex'" in unknown.err


def test_a_new_shot_is_good_and_can_be_simulated(project):
    assert project.call("new", "A020_new").code == 0
    assert project.call("validate", "A020_new").code == 0
    done = project.run("--json", "simulate", "A020_new", "-f", "1-2")
    assert done.code == 0, done.err
    assert json.loads(done.out)["made"] == {"simulate": 2}


@pytest.mark.parametrize("source", ["curl_noise", "python", NAME, f"shots/{NAME}.yaml"])
def test_a_new_shot_begins_from_a_flow_or_a_shot(project, source):
    done = project.call("--json", "new", "A020_new", "--from", source)
    assert done.code == 0, done.err
    files = json.loads(done.out)["files"]
    assert all((project.path / file).is_file() for file in files)
    assert len(files) == (2 if source == "python" else 1)
    first = (project.path / files[0]).read_text().splitlines()[0]
    named = first.partition("$schema=")[2]
    assert first.startswith("# yaml-language-server") and (project.path / "shots" / named).is_file()
    assert project.call("validate", "A020_new").code == 0


@needs_plugins("interchange", "preview")
def test_a_new_shot_of_a_model_is_good_at_once_and_tells_what_was_repaired(project, tmp_path_factory):
    from flowsculpt.pipeline.plugins.interchange.mesh_writers import write_mesh

    outside = tmp_path_factory.mktemp("outside")
    ball = icosphere(3)
    faces = np.where(np.arange(len(ball.faces))[:, None] % 2, ball.faces, ball.faces[:, ::-1])
    write_mesh(TriangleMesh(300 * ball.vertices, faces), outside / "ball.stl")
    done = project.call("--json", "new", "A030_ball", "--model", str(outside / "ball.stl"))
    assert done.code == 0, done.err
    facts = json.loads(done.out)
    assert facts["files"] == ["shots/A030_ball.yaml", "shots/models/ball.stl"]
    assert "lies outside this folder" in facts["remarks"][0]
    assert "wound against their neighbours" in facts["remarks"][1]
    text = (project.path / "shots" / "A030_ball.yaml").read_text()
    assert "{model: models/ball.stl, fit: 2, up: z}" in text and "write up: y" in text
    shown = project.call("preview", "A030_ball", "--at", "2")
    assert shown.code == 0 and shown.err.count("model repaired") == 1, shown.err
    shown = project.call("preview", "A030_ball", "--at", "3")
    assert shown.code == 0 and "model repaired" not in shown.err, "it is said once"
    assert "model repaired" in project.call("validate", "A030_ball").out
    again = project.call("--json", "new", "A040", "--model", "shots/models/ball.stl", "--from", "bend")
    assert again.code == 0 and json.loads(again.out)["files"] == ["shots/A040.yaml"], again.err
    assert "- bend:" in (project.path / "shots" / "A040.yaml").read_text()


@needs_plugins("interchange")
@pytest.mark.parametrize(
    ("model", "more", "code", "says"),
    [
        ("nothing.obj", [], 3, "nothing.obj: file not found"),
        ("a.obj", ["--from", NAME], 2, f"--from {NAME} is not a flow"),
        ("a.txt", [], 2, "not a mesh format"),
        ("a.gltf", [], 2, "export a GLB"),
    ],
)
def test_a_model_that_makes_no_shot_is_told(project, tmp_path_factory, model, more, code, says):
    outside = tmp_path_factory.mktemp("outside")
    if model != "nothing.obj":
        (outside / model).write_text("v 0 0 0\n")
    done = project.call("new", "A020_new", "--model", str(outside / model), *more)
    assert done.code == code and says in done.err and len(lines(done.err)) == 1
    assert not (project.path / "shots" / "A020_new.yaml").exists()


def test_what_is_neither_flow_nor_shot_begins_nothing(project):
    for source, says in (("vortx", "Did you mean 'vortex'"), ("T010_tinny", "Did you mean 'T010_tiny'")):
        done = project.call("new", "A020_new", "--from", source)
        assert done.code == 2 and says in done.err and len(lines(done.err)) == 1
    (project.path / "elsewhere").mkdir()
    (project.path / "elsewhere" / "bunny.yaml").write_text(
        "title: B\nframes: 1-2\nsubject: {model: b.obj}\nresample: off\n"
    )
    done = project.call("new", "A020_new", "--from", "elsewhere/bunny.yaml")
    assert done.code == 2 and "would not be good in shots/: " in done.err and "b.obj" in done.err
    assert not (project.path / "shots" / "A020_new.yaml").exists()


def test_schemas_are_printed_or_written(project):
    shown = json.loads(project.call("schema").out)
    required = shown["then"]
    assert required["required"] == ["title", "frames"] and required["then"]["required"] == ["resample"]
    assert required["oneOf"] == [{"required": ["subject"]}, {"required": ["subjects"]}]
    assert project.call("schema", "film", "-o", "made/film.json").code == 0
    assert "credits" in json.loads((project.path / "made" / "film.json").read_text())["properties"]
    (project.path / "shots" / "defaults.yaml").write_text("resample: off\n")
    assert "then" not in json.loads(project.call("schema").out)["then"]
    bad = project.call("schema", "shots")
    assert bad.code == 2 and "Did you mean 'shot'" in bad.err


def test_new_never_overwrites(project):
    before = project.shot.read_text()
    done = project.call("new", NAME)
    assert done.code == 2
    assert project.shot.read_text() == before


def test_validate_tells_everything_at_once_with_line_and_column(project):
    project.shot.write_text(
        project.shot.read_text()
        .replace("max_edge_length: 0.5", "max_edge_length: 0.5, min_edge_length: 0.3")
        .replace("axis: y", "axxis: y")
    )
    done = project.call("validate", NAME)
    assert done.code == 2
    assert re.search(r"T010_tiny\.yaml:4:\d+: .*60%.*50%", done.err)
    assert re.search(r"T010_tiny\.yaml:6:\d+: .*axis", done.err)


def test_a_shot_may_extend_another_and_defaults_are_no_shot(project):
    (project.shot.parent / "T020_more.yaml").write_text(f"extends: {NAME}\ntitle: More\n")
    (project.shot.parent / "defaults.yaml").write_text("look: glaze\n")
    done = project.run("--json", "simulate", "T020_more", "-f", "1-2")
    assert done.code == 0 and json.loads(done.out)["made"] == {"simulate": 2}, done.err
    assert {fact["file"] for fact in json.loads(project.call("--json", "validate").out)} == {
        NAME,
        "T020_more",
        "film",
    }
