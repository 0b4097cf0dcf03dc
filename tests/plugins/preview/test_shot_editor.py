"""A page edits a shot file: the file stays valid, nothing is lost, and every refusal is one message."""

from __future__ import annotations

import errno
import os
import random
import re
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from flowsculpt.pipeline.errors import MachineError, MissingInputError, ShotError, UsageError
from flowsculpt.pipeline.plugins.preview.shot_editor import ShotEditor, StaleError, digest_of, edits_in
from flowsculpt.pipeline.plugins.preview.text_edits import ValueEdit
from flowsculpt.pipeline.shot import read_shot
from flowsculpt.pipeline.shot.yaml.yaml_source import YamlSource
from tests.needed_plugins import needs_plugins

pytestmark = needs_plugins("fields")

SHOT = """\
# A cube, wrung and stirred
title: 'A cube'   # as on the slate
frames: 1-24

subject: {solid: box, size: [2, 2, 2]}   # two units
resample: {max_edge_length: 0.3}
flows:   # first the stir, then the wringing
  - sum:
      - vortex: {centre: [0.9, 0.3, 0], radius: 0.8, strength: {keys: {3: 0, 17: 7.6}, ease: bezier}} # left
      - translation: {rate: {keys: {3: [0, 0, 0], 17: {value: [0, 1, 0], right: [2, [0, 0.1, 0]]}}}}
  - twist:
      axis: y  # upright
      # in degrees
      amount:
        keys:
          1: 0    # calm
          0.5s: 30
          24: 80  # wild
  - within: # the upper half
      region: {sphere: {centre: [0, 1, 0], radius: 1.2}, falloff: 0.5}
      flows:
        - curl_noise:
look: clay
camera: {azimuth: {keys: {1: -24, 24: 38}}, # around
         elevation: 16} # above
"""


@pytest.fixture
def shot(tmp_path: Path) -> Path:
    path = tmp_path / "A010_cube.yaml"
    path.write_text(SHOT)
    return path


def comments(text: str) -> list[str]:
    return sorted(re.findall(r"#.*", text))


def by_hand(data: Any, edit: ValueEdit) -> Any:
    """The data of a file with an edit, as somebody would make it by hand."""
    name, *rest = edit.where
    if rest:
        if isinstance(data, dict) and data.get(name) is None:
            data[name] = {}
        data[name] = by_hand(data[name], ValueEdit(edit.kind, tuple(rest), edit.value))
    elif edit.kind == "set":
        data[name] = edit.value
    else:
        value = data.pop(name)
        if edit.kind == "rename":
            data[edit.value] = value
    return data


def some_edit(chance: random.Random, values: list[dict[str, Any]], last: int) -> ValueEdit:
    """An edit such as the page makes of one of the values."""
    value = chance.choice([each for each in values if each["where"][0] not in ("subject", "resample")])
    where, now = value["where"], value["value"]
    if value["curve"] is not None:
        key = chance.choice(value["curve"]["keys"])
        keys = (*where, "keys")
        kind = chance.choice(("value", "move", "add", "remove", "ease", "handle"))
        given = [round(chance.uniform(-2, 2), 3) for _ in key["value"]]
        given_value: Any = given if value["is_vector"] else given[0]
        match kind:
            case "move":
                return ValueEdit("rename", (*keys, key["time"]), chance.randint(1, last))
            case "add":
                return ValueEdit("set", (*keys, chance.randint(1, last)), given_value)
            case "remove":
                return ValueEdit("remove", (*keys, key["time"]))
            case "ease":
                return ValueEdit(
                    "set", (*where, "ease"), chance.choice(("linear", "settle 0.3", "bounce_out"))
                )
            case "handle":
                return ValueEdit(
                    "set", (*keys, key["time"]), {"value": given_value, "right": [2, given_value]}
                )
        return ValueEdit("set", (*keys, key["time"]), given_value)
    match value["form"]:
        case "number" | "whole":
            number = abs(now) if value["low"] == 0 else now
            given_value = round(number * chance.uniform(0.5, 1.5) + chance.choice((0, 0.01)), 4)
            if value["form"] == "whole":
                given_value = round(number) + chance.choice((0, 1))
            if value["can_change"] and chance.random() < 0.2:
                given_value = {"keys": {1: given_value, last: number}}
        case "vector":
            given_value = [round(part + chance.uniform(-0.2, 0.2), 3) for part in now]
        case "axis":
            given_value = chance.choice(("x", "y", "z", [0, 0.6, 0.8]))
        case "switch":
            given_value = not now
        case _:
            given_value = chance.choice(value["names"])
    return ValueEdit("set", where, given_value)


def edit_at_random(path: Path, times: int, seed: int) -> int:
    """Edit a file by the page's API and by hand alike, and return how many edits were accepted."""
    chance, editor, accepted = random.Random(seed), ShotEditor(path), 0
    state, before = editor.state(), comments(path.read_text())
    data = YamlSource.read(path).data
    for _ in range(times):
        text = path.read_text()
        edit = some_edit(chance, state["values"], state["last"])
        try:
            state = editor.edit(state["digest"], [edit])
        except ShotError as error:
            assert path.read_text() == text, "a refused edit leaves the file as it was"
            assert str(error).startswith(f"{path}:") and "Traceback" not in str(error)
            continue
        accepted += 1
        data = by_hand(data, edit)
        text = path.read_text()
        assert YamlSource.read(path, text).data == data
        assert comments(text) == before
        assert state["digest"] == digest_of(text)
    read_shot(path)
    return accepted


@pytest.mark.slow
def test_random_edits_keep_the_file_valid_its_comments_and_equal_edits_by_hand(shot: Path) -> None:
    assert edit_at_random(shot, 25, seed=1) > 12


@pytest.mark.soak
def test_a_thousand_random_edits_keep_the_file_valid_and_equal_edits_by_hand(shot: Path) -> None:
    for seed in range(10):
        shot.write_text(SHOT)
        assert edit_at_random(shot, 100, seed) > 50


def test_undo_and_redo_lead_through_the_very_texts(shot: Path) -> None:
    editor = ShotEditor(shot)
    state, texts = editor.state(), [SHOT]
    assert not state["can_undo"] and not state["can_redo"]
    for value in (10, 20, 30):
        state = editor.edit(state["digest"], [ValueEdit("set", ("camera", "elevation"), value)])
        texts.append(shot.read_text())
    for text in texts[-2::-1]:
        state = editor.undo(state["digest"])
        assert shot.read_text() == text
    assert not state["can_undo"]
    with pytest.raises(UsageError, match="nothing to undo"):
        editor.undo(state["digest"])
    for text in texts[1:]:
        state = editor.redo(state["digest"])
        assert shot.read_text() == text
    state = editor.undo(state["digest"])
    state = editor.edit(state["digest"], [ValueEdit("set", ("camera", "elevation"), 5)])
    assert not state["can_redo"], "an edit begins another line"


def test_edits_of_one_gesture_are_undone_together(shot: Path) -> None:
    editor = ShotEditor(shot)
    state = editor.state()
    for value in (17, 18, 19):
        state = editor.edit(state["digest"], [ValueEdit("set", ("camera", "elevation"), value)], "drag 1")
    state = editor.edit(state["digest"], [ValueEdit("set", ("camera", "elevation"), 20)], "drag 2")
    state = editor.undo(state["digest"])
    assert "elevation: 19" in shot.read_text()
    editor.undo(state["digest"])
    assert shot.read_text() == SHOT


def test_a_file_changed_meanwhile_is_not_overwritten_and_its_edits_not_undone(shot: Path) -> None:
    editor = ShotEditor(shot)
    state = editor.edit(editor.state()["digest"], [ValueEdit("set", ("camera", "elevation"), 20)])
    other = shot.read_text().replace("look: clay", "look: glaze")
    shot.write_text(other)
    for change in (
        lambda: editor.edit(state["digest"], [ValueEdit("set", ("camera", "elevation"), 30)]),
        lambda: editor.undo(state["digest"]),
    ):
        with pytest.raises(StaleError, match="changed in the meantime; nothing was written"):
            change()
    assert shot.read_text() == other
    state = editor.state()
    assert not state["can_undo"], "undoing would take the other's edit away"
    editor.edit(state["digest"], [ValueEdit("set", ("camera", "elevation"), 30)])
    assert shot.read_text() == other.replace("elevation: 20", "elevation: 30")


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (ValueEdit("set", ("resample", "max_edge_length"), -1), "must be above 0"),
        (ValueEdit("set", ("look",), "clya"), "Did you mean 'clay'"),
        (ValueEdit("set", ("flows", 0, "sum", 0, "vortex", "foo"), 1), "foo: unknown name"),
        (ValueEdit("set", ("camera", "elevation"), {"keys": {"soon": 1}}), "soon"),
        (ValueEdit("remove", ("frames",)), "frames: missing"),
    ],
)
def test_a_bad_value_is_refused_with_its_line_and_nothing_written(
    shot: Path, edit: ValueEdit, words: str
) -> None:
    editor = ShotEditor(shot)
    with pytest.raises(ShotError, match=rf"^{shot}:\d+:\d+: .*{re.escape(words)}") as refused:
        editor.edit(editor.state()["digest"], [edit])
    assert len(str(refused.value).splitlines()) == 1
    assert shot.read_text() == SHOT and not editor.state()["can_undo"]


def test_a_full_disk_leaves_the_file_as_it_was(shot: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    editor = ShotEditor(shot)
    digest = editor.state()["digest"]
    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        with pytest.raises(MachineError, match=rf"^{shot}: cannot be written: the disk is full"):
            editor.edit(digest, [ValueEdit("set", ("camera", "elevation"), 30)])
    assert shot.read_text() == SHOT and list(shot.parent.iterdir()) == [shot]
    editor.edit(digest, [ValueEdit("set", ("camera", "elevation"), 30)])
    assert editor.state()["can_undo"]


def test_two_pages_at_once_write_one_edit_after_the_other(shot: Path) -> None:
    editor = ShotEditor(shot)
    digest, refused = editor.state()["digest"], []

    def edit(value: int) -> None:
        try:
            editor.edit(digest, [ValueEdit("set", ("camera", "elevation"), value)])
        except StaleError:
            refused.append(value)

    pages = [threading.Thread(target=edit, args=(value,)) for value in range(20, 24)]
    for page in pages:
        page.start()
    for page in pages:
        page.join()
    assert len(refused) == 3, "three have read a text that the first has changed"


def save_by_rename(path: Path, text: str) -> None:
    beside = path.with_suffix(".new")
    beside.write_text(text)
    beside.replace(path)


def save_after_a_backup(path: Path, text: str) -> None:
    path.replace(path.with_suffix(".yaml~"))
    path.write_text(text)


def save_in_place(path: Path, text: str) -> None:
    path.write_text(text)


SHORT = """\
title: A cube
frames: 1-2
subject: {solid: box}
resample: off
flows: []
camera: {elevation: 16}
"""
ELEVATION = ValueEdit("set", ("camera", "elevation"), 30)


def saves_lost(shot: Path, save: Callable[[Path, str], None], trials: int) -> int:
    """Edit a shot while somebody saves it at a random moment; return how many of their texts were lost."""
    editor, chance, lost = ShotEditor(shot), random.Random(1), 0
    for _ in range(2):  # the second time it is as fast as ever
        shot.write_text(SHORT)
        state, began = editor.state(), time.perf_counter()
        editor.edit(state["digest"], [ELEVATION])
    took = time.perf_counter() - began
    for trial in range(trials):
        shot.write_text(SHORT)
        digest, theirs = editor.state()["digest"], SHORT.replace("A cube", f"A cube {trial}")
        person = threading.Timer(chance.uniform(0.0, took), save, (shot, theirs))
        person.start()
        with suppress(StaleError, MissingInputError):
            editor.edit(digest, [ELEVATION])
        person.join()
        lost += shot.read_text() != theirs
    return lost


@pytest.mark.parametrize("save", [save_by_rename, save_after_a_backup, save_in_place])
def test_what_a_person_saves_while_an_edit_is_validated_wins(
    shot: Path, save: Callable[[Path, str], None]
) -> None:
    assert saves_lost(shot, save, trials=10) == 0


@pytest.mark.soak
@pytest.mark.parametrize("save", [save_by_rename, save_after_a_backup, save_in_place])
def test_of_hundreds_of_texts_saved_during_edits_none_is_lost(
    shot: Path, save: Callable[[Path, str], None]
) -> None:
    assert saves_lost(shot, save, trials=400) == 0


def test_line_ends_permissions_and_links_stay(tmp_path: Path, shot: Path) -> None:
    shot.write_bytes(SHOT.replace("\n", "\r\n").encode())
    shot.chmod(0o640)
    link = tmp_path / "link" / "A010_cube.yaml"
    link.parent.mkdir()
    link.symlink_to(shot)
    editor = ShotEditor(link)
    editor.edit(editor.state()["digest"], [ValueEdit("set", ("camera", "elevation"), 30)])
    assert shot.read_bytes() == SHOT.replace("elevation: 16", "elevation: 30").replace("\n", "\r\n").encode()
    assert link.is_symlink() and shot.stat().st_mode & 0o777 == 0o640


def test_inherited_values_are_written_into_the_shot_but_no_part_of_a_list(tmp_path: Path, shot: Path) -> None:
    child = tmp_path / "A020_cube.yaml"
    child.write_text("extends: A010_cube # the same\nlook: glaze\n")
    editor = ShotEditor(child)
    state = editor.state()
    by_path = {tuple(each["where"]): each for each in state["values"]}
    assert by_path["camera", "elevation"]["file"].endswith("A010_cube.yaml")
    editor.edit(state["digest"], [ValueEdit("set", ("camera", "elevation"), 3)])
    assert child.read_text() == "extends: A010_cube # the same\nlook: glaze\ncamera: {elevation: 3}\n"
    with pytest.raises(ShotError, match="comes from a file that this shot extends"):
        editor.edit(editor.state()["digest"], [ValueEdit("set", ("flows", 1, "twist", "axis"), "x")])
    assert shot.read_text() == SHOT


def test_a_value_that_the_command_line_sets_is_not_edited(shot: Path) -> None:
    editor = ShotEditor(shot, ("camera.elevation=50",))
    state = editor.state()
    assert {tuple(v["where"]): v["value"] for v in state["values"]}["camera", "elevation"] == 50
    with pytest.raises(ShotError, match=r"--set camera\.elevation=50: it overrides camera\.elevation"):
        editor.edit(state["digest"], [ValueEdit("set", ("camera", "elevation"), 3)])


BAD_REQUESTS: dict[str, Any] = {
    "nothing": None,
    "no list": {"kind": "set"},
    "no edit": [],
    "too many": [{"kind": "set", "where": ["look"], "value": "clay"}] * 1001,
    "a kind that is none": [{"kind": "drop", "where": ["look"]}],
    "a name that is none": [{"kind": "set", "where": [["look"]], "value": 1}],
    "a path that is too long": [{"kind": "set", "where": ["a"] * 25, "value": 1}],
    "a time that is none": [{"kind": "rename", "where": ["look"], "value": {}}],
    "more": [{"kind": "set", "where": ["look"], "value": "clay", "file": "/etc/passwd"}],
}


@pytest.mark.parametrize("case", BAD_REQUESTS)
def test_requests_of_another_form_are_refused(case: str) -> None:
    with pytest.raises(UsageError):
        edits_in(BAD_REQUESTS[case])


def test_times_of_keys_are_numbers_again_after_json() -> None:
    (edit,) = edits_in([{"kind": "set", "where": ["a"], "value": {"keys": {"1": 0, "2.5": 1, "3s": 2}}}])
    assert edit.value == {"keys": {1: 0, 2.5: 1, "3s": 2}}
