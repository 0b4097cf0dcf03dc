"""No shot file brings a traceback, a hang or too much memory; those that once did are tried each time."""

from __future__ import annotations

import os
import random
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings

from flowsculpt.pipeline.errors import FlowsculptError, MissingInputError, ShotError
from flowsculpt.pipeline.production.request.lookup import Show
from flowsculpt.pipeline.shot import read_shot
from flowsculpt.pipeline.shot.yaml.yaml_source import DEEPEST, MOST_VALUES
from tests.fuzz.shots import SHOT_FILES, fault_of, faults

HEAD = "title: A\nframes: 1-12\nresample: off\n"
BOX = f"{HEAD}subject: {{solid: box}}\n"
LONG = BOX.replace("1-12", "1-100000")

PAST = {
    "a size that is a word": f"{HEAD}subject: {{solid: box, size: y}}",
    "a size with a word": f"{HEAD}subject: {{solid: box, size: [a, 1, 1]}}",
    "a list as a radius": f"{HEAD}subject: {{solid: torus, tube_radius: [0.36]}}",
    "a size without brackets": f"{HEAD}subject: {{solid: lattice, size: 2}}",
    "an empty pattern": f"{BOX}look: {{material: clay, pigment: {{marble: }}}}",
    "a handle of lists": BOX + "flows: [twist: {amount: {keys: {1: {value: 1, right: [1, [[2]]]}}}}]",
    "an infinite frame": "title: A\nframes: [.inf]\nresample: off\nsubject: {solid: box}",
    "a handle of one number": BOX + "flows: [twist: {amount: {keys: {1: {value: 1, right: {1: 2}}}}}]",
    "an infinite count": f"{BOX}substeps: .inf",
    "a line of one word": f"{BOX}camera: [{'a' * 100_000} {{",
    "a list as a name": f"{BOX}? [a, [b]]\n: 1\n",
    "aliases without limit": f"{BOX}a: &a [x, x, x, x]\nb: &b [*a, *a, *a, *a]\nc: &c [*b, *b, *b, *b]\n"
    + "".join(f"{d}: &{d} [*{c}, *{c}, *{c}, *{c}]\n" for c, d in zip("cdefghijk", "defghijkl", strict=True)),
    "an alias in itself": f"{BOX}flows: &a [*a]",
    "brackets without end": f"{BOX}flows: {'[' * 5000}",
    "compositions without end": f"{BOX}flows: {'[{sequence: {flows: ' * 200}",
    "round brackets without end": f"{BOX}flows: [{'(, ' * 3000}]",
    "a value of 100 kB": f"{BOX}look: {'a' * 100_000}",
    "a name of 100 kB": f"{BOX}{'a' * 100_000}: 1",
    "two words of 50 kB": f"{HEAD}subject: {{solid: box, size: '{'a' * 50_000} {'a' * 50_000}'}}",
    "a number far from its unit": f"{BOX}substeps: '1{' ' * 100_000}!'",
    "a formula of 100 kB": f"{BOX}speed: {{formula: {'x' * 100_000}}}",
    "one mistake a thousand times": f"{BOX}flows: [{'{twst: {amount: 1}}, ' * 1000}]",
    "a thousand unknown names": BOX + "".join(f"unheard{i}: 1\n" for i in range(1000)),
    "a changing speed over an hour": f"{LONG}speed: {{keys: {{1: 0, 100000: 4}}}}",
    "a moving camera over an hour": f"{LONG}camera: {{position: {{formula: [t, 1, 9]}}, target: [0, 0, 0]}}",
    "a comment amid a text": "title: A\nshots: # c\n  . A\n  - B\n\nrate: 24\n  - C\n",
    "a file that is too large": f"{BOX}intent: {'a ' * 200_000}",
}
"""Shot files that once ended in a traceback, took long, or echoed what they hold."""


@pytest.mark.slow
@pytest.mark.parametrize("text", PAST.values(), ids=PAST)
def test_a_file_that_once_failed_is_told_in_time(tmp_path: Path, text: str) -> None:
    assert fault_of(tmp_path, text.encode()) is None


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])
@given(content=SHOT_FILES)
def test_any_file_ends_in_a_shot_or_a_message(tmp_path: Path, content: bytes) -> None:
    assert fault_of(tmp_path, content) is None


@pytest.mark.soak
def test_no_file_fails_in_minutes_of_trying(tmp_path: Path) -> None:
    seconds = 60 * float(os.environ.get("FUZZ_MINUTES", "5"))
    found = list(faults(tmp_path, seconds, random.randrange(2**32)))
    assert not found, found[:3]


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (
            f"flows: {'[' * (DEEPEST + 5)}{']' * (DEEPEST + 5)}",
            "1:1: lists and mappings are nested too deep",
        ),
        ("a: &a [" + "1, " * 999 + "1]\nb: [" + "*a, " * 200 + "]", f"more than {MOST_VALUES} values"),
    ],
    ids=["depth", "aliases"],
)
def test_a_file_that_expands_is_refused_in_one_line(tmp_path: Path, text: str, told: str) -> None:
    with pytest.raises(ShotError) as error:
        read_shot(tmp_path / "a.yaml", f"{BOX}{text}")
    assert told in str(error.value) and len(error.value.messages) == 1


@pytest.mark.parametrize("text", ["", "[]", "title: A", BOX])
def test_any_text_can_stand_in_the_defaults(tmp_path: Path, text: str) -> None:
    (tmp_path / "defaults.yaml").write_text(text)
    try:
        read_shot(tmp_path / "a.yaml", BOX)
    except FlowsculptError as error:
        assert "fault of its own" not in str(error)


def test_a_pipe_in_place_of_a_shot_is_told_and_not_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "shots").mkdir()
    os.mkfifo(tmp_path / "shots" / "A010.yaml")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(MissingInputError, match="a named pipe"):
        Show().find_shot("A010")
