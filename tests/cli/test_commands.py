"""The command line, as a user meets it: exit codes, one line a fault.

Most commands run in this process, for Python takes longer to start than they take; some run as a user's do.
"""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from typer.main import get_command

from flowsculpt import pipeline
from flowsculpt.pipeline.cli.app import all_commands, command_line, command_named, command_words
from flowsculpt.pipeline.cli.options import REFERENCE
from flowsculpt.pipeline.mesh import TriangleMesh, icosphere
from flowsculpt.pipeline.plugin import plugins
from flowsculpt.pipeline.plugins.interchange.mesh_writers import write_mesh
from flowsculpt.pipeline.production.execution.run import PATIENCE
from flowsculpt.render.movie.probe import probe_movie
from flowsculpt.render.post.image import read_png
from tests.conftest import QUALITY

NAME = "T010_tiny"


def lines(text):
    return [line for line in text.splitlines() if line.strip()]


def common_options():
    """The options that stand before a command, without --version."""
    return [option for option in get_command(command_line()).params if option.name != "version_"]


ALL = command_words()


def test_help_names_every_command_and_the_exit_codes(project):
    done = project.run("--help")
    assert done.code == 0
    for word in (*all_commands(), "130"):
        assert word in done.out


def test_every_module_of_commands_is_in_the_help():
    commands = plugins().commands.values()
    named = {command.function.split(":")[0].rsplit(".")[-1] for command in commands}
    assert {path.stem for path in Path(pipeline.__file__).parent.rglob("*_command*.py")} <= named


def test_help_tells_after_how_long_a_silent_job_is_ended(project):
    assert f"again. Default: {PATIENCE / 60.0:g}." in " ".join(
        project.call("--help").out.replace("│", "").split()
    )


@pytest.mark.parametrize("command", ALL)
def test_every_command_explains_itself_and_takes_the_common_options(project, command):
    done = project.call(*command.split(), "--help")
    assert done.code == 0
    assert done.out.rstrip().endswith(REFERENCE) and "<str>" not in done.out
    assert "`flowsculpt " in done.out, "an example"
    taken = {word for option in command_named(command).params for word in option.opts}
    assert {word for option in common_options() for word in option.opts} <= taken


def test_the_help_lists_the_options_of_every_command_once(project):
    listed = project.call("--help").out
    for option in ("--json", "--no-progress", "-j", "--dry-run", "--root", "--profile", "--wait"):
        assert f" {option} " in listed
        assert f" {option} " not in project.call("render", "--help").out.replace(REFERENCE, "")


def test_common_options_may_stand_before_or_after_the_command(project):
    before = project.call("--json", "--dry-run", "simulate", NAME)
    after = project.call("simulate", NAME, "--json", "--dry-run")
    assert before.code == after.code == 0
    assert json.loads(before.out)["targets"] == json.loads(after.out)["targets"]


def test_a_dry_run_says_what_would_be_done_and_does_nothing(project):
    done = project.run("--dry-run", "render", NAME, "-f", "1-3")
    assert "rendering 3 frames" in done.out
    assert not (project.path / "renders").exists()
    assert not (project.path / ".flowsculpt").exists()


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


def test_a_value_is_set_for_one_command(project):
    """Meshes made with it are others than the shot's own; what is wrong with it is told by its own words."""
    done = project.call("--json", "simulate", NAME, "-f", "1-2", "--set", "flows.0.twist.amount=0")
    assert done.code == 0, done.err
    again = project.call("--json", "--dry-run", "simulate", NAME, "-f", "1-2")
    assert json.loads(again.out)["jobs"]
    same = project.call(
        "--json", "--dry-run", "simulate", NAME, "-f", "1-2", "--set", "flows.0.twist.amount=0"
    )
    assert json.loads(same.out)["jobs"] == []
    for command in ("simulate", "render", "validate", "turntable"):
        bad = project.call("--dry-run", command, NAME, "--set", "flows.0.twst.amount=0")
        assert bad.code == 2
        (line,) = lines(bad.err)
        assert line == "--set flows.0.twst.amount=0: flows.0 has no twst. Did you mean 'twist'?"


def test_a_shot_may_extend_another_and_defaults_are_no_shot(project):
    (project.shot.parent / "T020_more.yaml").write_text(f"extends: {NAME}\ntitle: More\n")
    (project.shot.parent / "defaults.yaml").write_text("look: glaze\n")
    done = project.call("--json", "simulate", "T020_more", "-f", "1-2")
    assert done.code == 0 and json.loads(done.out)["made"] == {"simulate": 2}, done.err
    assert {fact["file"] for fact in json.loads(project.call("--json", "validate").out)} == {
        NAME,
        "T020_more",
        "film",
    }


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


def test_a_new_shot_of_a_model_is_good_at_once_and_tells_what_was_repaired(project, tmp_path_factory):
    outside = tmp_path_factory.mktemp("outside")
    ball = icosphere(6)
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
    assert shown.code == 0 and "model repaired" not in shown.err, "it is told once"
    assert "model repaired" in project.call("validate", "A030_ball").out
    again = project.call("--json", "new", "A040", "--model", "shots/models/ball.stl", "--from", "bend")
    assert again.code == 0 and json.loads(again.out)["files"] == ["shots/A040.yaml"], again.err
    assert "- bend:" in (project.path / "shots" / "A040.yaml").read_text()


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


def test_a_preview_is_drawn_without_rendering(project):
    done = project.call("--json", "preview", NAME, "--at", "3", "--flow")
    assert done.code == 0, done.err
    made = json.loads(done.out)["path"]
    assert made.endswith("renders/T010_tiny/preview/T010_tiny.0003.flow.png")
    assert read_png(Path(made)).shape == (540, 960, 3)
    done = project.call("--json", "preview", NAME, "-f", "2-3", "-o", "two.mp4")
    assert done.code == 0 and probe_movie(project.path / "two.mp4").frames == 2, done.err
    assert not list(project.path.rglob("*.exr"))
    for words, says in ((("--at", "9"), "1-6"), (("--at", "2", "-o", "a.mp4"), ".png")):
        bad = project.call("preview", NAME, *words)
        assert bad.code == 2 and says in bad.err and len(lines(bad.err)) == 1


def test_curves_are_drawn_to_a_page(project):
    done = project.call("--json", "curves", NAME)
    assert done.code == 0, done.err
    facts = json.loads(done.out)
    assert facts["curves"] == ["flows.0.twist.amount"]
    assert Path(facts["path"]).read_text().startswith("<?xml")
    for words, says in (
        (("--set", "flows.0.twist.amount=2"), "nothing that changes over time"),
        (("-o", "page.txt"), ".svg, .png, .pdf"),
    ):
        bad = project.call("curves", NAME, *words)
        assert bad.code == 2 and says in bad.err and len(lines(bad.err)) == 1


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
    done = project.run("new", NAME)
    assert done.code == 2
    assert project.shot.read_text() == before


def test_validate_tells_everything_at_once_with_line_and_column(project):
    project.shot.write_text(
        project.shot.read_text()
        .replace("max_edge_length: 0.5", "max_edge_length: 0.5, min_edge_length: 0.3")
        .replace("axis: y", "axxis: y")
    )
    done = project.run("validate", NAME)
    assert done.code == 2
    assert re.search(r"T010_tiny\.yaml:4:\d+: .*60%.*50%", done.err)
    assert re.search(r"T010_tiny\.yaml:6:\d+: .*axis", done.err)


@pytest.mark.parametrize(
    ("words", "code", "says"),
    [
        (("render", "T010_tinny"), 3, "did you mean T010_tiny"),
        (("render", "shots/none.yaml"), 3, "none.yaml"),
        (("render", NAME, "-f", "5-9"), 2, "7-9"),
        (("render", NAME, "-f", "a-b"), 2, "frame range"),
        (("render", NAME, "-q", "best"), 2, "Did you mean 'final'?"),
        (("turntable", "none.obj"), 3, "none.obj"),
        (("turntable", NAME, "--at", "99"), 2, "1-6"),
        (("turntable", NAME, "--frames", "1"), 2, "72"),
        (("film", "none.yaml"), 3, "none.yaml"),
    ],
)
def test_bad_usage_gets_one_line_and_its_exit_code(project, words, code, says):
    done = project.call(*words)
    assert done.code == code
    assert says in done.err
    assert len(lines(done.err)) == 1
    assert not (project.path / "renders").exists()


@pytest.mark.parametrize(
    ("name", "text", "says"),
    [
        ("empty.obj", "v 0 0 0\n", "no faces"),
        ("nan.obj", "v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "finite"),
    ],
)
def test_a_mesh_that_is_no_surface_is_refused_in_one_line(project, name, text, says):
    (project.path / name).write_text(text)
    done = project.call("turntable", name, "--frames", "2")
    assert done.code == 2
    assert says in done.err
    assert name in done.err
    assert len(lines(done.err)) == 1


def test_status_tells_done_stale_and_missing(finished):
    finished.render("1-3", quality="draft")
    rows = {row["what"]: row for row in json.loads(finished.call("--json", "status").out)}
    assert rows["draft"]["done"] == [1, 2, 3] and rows["draft"]["missing"] == [4, 5, 6]
    finished.frames("draft")[0].unlink()
    finished.shot.write_text(finished.shot.read_text().replace("azimuth: -30", "azimuth: 5"))
    rows = {row["what"]: row for row in json.loads(finished.call("--json", "status").out)}
    assert rows["meshes"]["done"] == [1, 2, 3, 4, 5, 6]
    assert rows["draft"]["missing"] == [1, 4, 5, 6]
    assert rows["draft"]["stale"] == [2, 3]


def test_a_shot_that_goes_wrong_on_the_way_does_not_hide_the_others(project):
    """Its speed is not a number between two half frames."""
    (project.shot.parent / "T020_wrong.yaml").write_text(
        "frames: 1-6\ntitle: Wrong\nresample: off\nsubject: {solid: box, size: [1, 1, 1]}\n"
        "flows: [vortex: {strength: 1}]\n"
        'speed: {formula: "1 + sqrt(abs(t - 0.03) - 0.002)"}\n'
    )
    done = project.call("--json", "status")
    assert done.code == 2 and "T020_wrong.yaml:6:1: speed is not finite: formula" in done.err
    assert [row["shot"] for row in json.loads(done.out)] == [NAME]


def test_doctor_says_which_renderer_is_in_use(project):
    facts = json.loads(project.run("--json", "doctor").out)
    assert re.search("llvm_ad_rgb|scalar_rgb", facts["renderer"])
    assert facts["faster"] == "" if "llvm" in facts["renderer"] else "libLLVM" in facts["faster"]


def test_stills_are_pictures_that_any_program_shows(project):
    done = project.run("stills", NAME, "-f", "2,4", "-q", QUALITY, "--as", "jpeg")
    folder = project.path / "renders" / NAME / QUALITY / "jpeg"
    assert done.code == 0 and f"renders/T010_tiny/{QUALITY}/jpeg/" in done.out
    assert sorted(file.name for file in folder.iterdir()) == [f"{NAME}.0002.jpg", f"{NAME}.0004.jpg"]
    again = project.call("stills", NAME, "-f", "2", "-q", QUALITY, "--as", "png16")
    assert again.code == 0 and "(0 frames rendered)" in again.out
    deep = read_png(project.path / "renders" / NAME / QUALITY / "png16" / f"{NAME}.0002.png")
    shown = read_png(folder / f"{NAME}.0002.jpg")
    assert deep.dtype == "uint16" and deep.shape == shown.shape == (54, 96, 3)
    assert abs(deep / 257.0 - shown).mean() < 1.0
    assert project.call("stills", NAME, "-f", "2", "-q", QUALITY, "--as", "png16").out.startswith("Nothing")
    unknown = project.call("stills", NAME, "--as", "jpg")
    assert unknown.code == 2 and "Did you mean 'jpeg'?" in unknown.err
