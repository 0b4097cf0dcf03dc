"""Three qualities, one default, and one former name."""

import json

import pytest

from flowsculpt.pipeline.cli.app import command_named, command_words
from flowsculpt.render.base.plural import plural
from flowsculpt.render.scene.render_quality import QUALITIES

NAME = "T010_tiny"
ALL = command_words()


def quality_option(command):
    return next((option for option in command_named(command).params if "--quality" in option.opts), None)


def test_there_are_three_qualities_from_small_to_large():
    assert list(QUALITIES) == ["draft", "daily", "final"]
    pixels = [quality.width * quality.height for quality in QUALITIES.values()]
    assert pixels == sorted(pixels)


@pytest.mark.parametrize("command", [name for name in ALL if quality_option(name)])
def test_every_command_has_the_same_default_quality(command):
    option = quality_option(command)
    if command in ("review", "frames"):
        assert option.default is None, "review shows all that is there, frames lists meshes unless asked"
    else:
        assert "draft" in (option.default, option.show_default)


@pytest.mark.parametrize("command", [*filter(ALL.__contains__, ["turntable", "sheet", "stills", "render"])])
def test_the_former_name_of_draft_is_taken_without_a_word(project, command):
    words = {"turntable": ("--frames", "2"), "sheet": ("-f", "1-2")}.get(command, ())
    today = project.call("--json", "--dry-run", command, NAME, *words)
    former = project.call("--json", "--dry-run", command, NAME, *words, "-q", "preview")
    assert today.code == former.code == 0
    assert json.loads(today.out)["jobs"] == json.loads(former.out)["jobs"]
    assert not former.err and "_draft_" in today.out


@pytest.mark.parametrize(
    ("count", "words"), [(0, "0 frames"), (1, "1 frame"), (2, "2 frames")], ids=lambda value: str(value)
)
def test_a_count_agrees_with_its_noun(count, words):
    assert plural(count, "frame") == words
    assert plural(count, "vertex", "vertices").endswith("vertex" if count == 1 else "vertices")
