"""The command line, as a user meets it: exit codes, one line a fault.

Most commands run in this process, for Python takes longer to start than they take; some run as a user's do.
"""

import json
import re
from pathlib import Path

import pytest
from typer.main import get_command

from flowsculpt import pipeline
from flowsculpt.pipeline.cli.app import all_commands, command_line, command_named, command_words
from flowsculpt.pipeline.cli.options import REFERENCE
from flowsculpt.pipeline.plugin import plugins
from flowsculpt.pipeline.production.execution.run import PATIENCE
from flowsculpt.render.post.image import read_png
from tests.conftest import QUALITY, lines

NAME = "T010_tiny"


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
    for command in {"simulate", "render", "validate", "turntable"} & {*ALL}:
        bad = project.call("--dry-run", command, NAME, "--set", "flows.0.twst.amount=0")
        assert bad.code == 2
        (line,) = lines(bad.err)
        assert line == "--set flows.0.twst.amount=0: flows.0 has no twst. Did you mean 'twist'?"


@pytest.mark.parametrize(
    ("words", "code", "says"),
    [
        (("render", "T010_tinny"), 3, "did you mean T010_tiny"),
        (("render", "shots/none.yaml"), 3, "none.yaml"),
        (("render", NAME, "-f", "5-9"), 2, "7-9"),
        (("render", NAME, "-f", "a-b"), 2, "frame range"),
        (("render", NAME, "-q", "best"), 2, "Did you mean 'final'?"),
        (("film", "none.yaml"), 3, "none.yaml"),
    ],
)
def test_bad_usage_gets_one_line_and_its_exit_code(project, words, code, says):
    done = project.call(*words)
    assert done.code == code
    assert says in done.err
    assert len(lines(done.err)) == 1
    assert not (project.path / "renders").exists()


def test_doctor_prepares_in_the_background_only_where_it_prepares(project):
    refused = project.call("doctor", "--background")
    assert refused.code == 2 and "--background needs --prepare" in refused.err


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
