"""A frame tells why it would be made again: which part of its key differs, and what was edited."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.production.execution.project import Project
from pipeline.production.maintenance.why import Explanation, differences, explain
from pipeline.production.request.lookup import find_shot

NAME = "T010_tiny"

plain = st.recursive(
    st.none() | st.booleans() | st.integers() | st.text(max_size=3),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=2), inner, max_size=3),
    max_leaves=8,
)


@given(plain, plain)
def test_data_differ_where_they_are_not_the_same(one: Any, other: Any) -> None:
    assert not list(differences(one, one))
    assert bool(list(differences(one, other))) == (one != other)


def test_a_difference_is_told_as_a_path() -> None:
    was, now = {"look": {"roughness": 0.1}, "a": [1, 2]}, {"look": {"roughness": 0.3}, "a": [1, 3], "b": 1}
    told = [str(each) for each in differences(was, now)]
    assert told == ["look.roughness: 0.1 → 0.3", "a.1: 2 → 3", "b: nothing → 1"]


def ask(project: Any, frame: int) -> Explanation:
    there = Project(project.path, 2)
    return explain(there.request(find_shot(NAME), "draft", str(frame)), frame, there.store)


def test_why_a_frame_is_made_again(finished: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(finished.path)
    text = finished.shot.read_text()
    assert ask(finished, 2).state == "done"

    finished.shot.write_text("# a comment\n" + text)
    assert ask(finished, 2).state == "done"

    finished.shot.write_text(text.replace("subject:", "look: chrome\nsubject:"))
    relit = ask(finished, 2)
    assert relit.state == "stale" and not relit.reasons
    assert "look.model" in {".".join(map(str, part.path)) for part in relit.parts}
    assert [str(edit) for edit in relit.edits] == ["look: nothing → chrome"]

    finished.shot.write_text(text.replace("6: 60}", "6: 90}"))
    late = ask(finished, 6)
    assert late.state == "stale"
    assert "its mesh differs, as all meshes do from frame 5 on" in late.reasons
    assert [str(edit) for edit in late.edits] == ["flows.0.twist.amount.keys.6: 60 → 90"]

    finished.shot.write_text(text)
    finished.frames()[3].unlink()
    gone = ask(finished, 4)
    assert gone.state == "missing" and "without rendering" in gone.reasons[0]


def test_why_is_told_at_the_command_line(finished: Any) -> None:
    finished.shot.write_text(finished.shot.read_text().replace("azimuth: -30", "azimuth: 20"))
    told = finished.run("why", NAME, "3", "-q", "draft")
    assert told.code == 0 and "is stale" in told.out and "camera.azimuth: -30 → 20" in told.out
    outside = finished.run("why", NAME, "60", "-q", "draft")
    assert outside.code == 2 and "1-6" in outside.err
