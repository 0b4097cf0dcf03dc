"""Frames may be asked for in words, and coarse first."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.frames import FrameRange, FrameSelection, FrameWords
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.production.planning.batches import MAX_BATCH, batches
from flowsculpt.pipeline.production.planning.frame_states import FrameStates, select_frames
from flowsculpt.pipeline.production.request.lookup import Show
from flowsculpt.pipeline.production.store.event_log import EventLog
from flowsculpt.pipeline.production.store.history import History
from flowsculpt.pipeline.production.store.paths import EVENTS

pytestmark = pytest.mark.quick

NAME = "T010_tiny"
NONE = FrameRange(())


def known() -> FrameStates:
    def some(text: str) -> FrameRange:
        return FrameRange.parse(text)

    return FrameStates("A", "draft", *map(some, ("1-4", "9", "5", "7", "6", "8", "7")), NONE, None)


def select(text: str) -> FrameRange:
    words = FrameSelection.of_text(text)
    assert isinstance(words, FrameWords)
    return select_frames(words, FrameRange.parse("1-9"), known)


def test_words_mean_what_status_tells() -> None:
    assert str(select("missing")) == "6,8-9", "rendered frames are not denoised yet"
    assert str(select("failed, missing")) == "6-9"
    assert str(select("stale")) == "5,7", "unframed ones are made if their camera moves"
    assert select("all") == FrameRange.parse("1-9")
    assert str(FrameSelection.of_text("failed, missing")) == "failed,missing"
    for text in ("1-48x2,60", "1-100:10"):
        assert FrameSelection.of_text(text) == FrameRange.parse(text)


@pytest.mark.parametrize(
    ("text", "told"), [("staled", "Did you mean 'stale'?"), ("1-4,failed", "words alone")]
)
def test_what_is_neither_is_told(text: str, told: str) -> None:
    with pytest.raises(UsageError, match="is not a frame range") as error:
        FrameSelection.of_text(text)
    assert told in str(error.value)


@given(st.permutations(range(1, 50)), st.integers(1, 7))
def test_batches_hold_every_frame_once_and_the_first_of_them_go_first(order: list[int], cores: int) -> None:
    found = batches(order, cores)
    assert sorted(n for batch in found for n in batch) == sorted(order)
    assert max(map(len, found)) <= MAX_BATCH
    if order != sorted(order):
        side_by_side = min(cores, len(found))
        assert {batch[0] for batch in found[:side_by_side]} == set(order[:side_by_side])


def test_coarse_frames_of_a_range_are_rendered_first(project: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(project.path)
    plan = Project(project.path, 1).pictures([NAME], "draft", FrameRange.parse("1-6:5"))
    (render,) = [job for job in plan.jobs if job.stage == "render"]
    assert render.frames == (1, 6, 2, 3, 4, 5) or render.frames[:2] == (1, 6)


def log_of(root: Path, *events: tuple[str, int]) -> History:
    log = EventLog(root / EVENTS / "20260101-000000-1.jsonl", "job")
    for event, frame in events:
        about = {"shot": NAME, "stage": "render", "quality": "draft", "frame": frame}
        log.write(event, **about, message="it failed", found=False)
    return History.of(root)


def test_frames_that_failed_are_known_until_they_are_made(tmp_path: Path) -> None:
    told = ("start", 1), ("fail", 1), ("start", 2), ("fail", 2), ("start", 1), ("frame", 1)
    history = log_of(tmp_path, *told)
    assert set(history.failed(NAME, ["render"], "draft")) == {2}
    assert not history.failed(NAME, ["render"], "final") and not history.failed("B", ["render"], "draft")
    assert not history.running(NAME, ["render"], "draft")


def test_what_failed_is_tried_again_by_that_word(project: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(project.path)
    log_of(project.path, ("fail", 3), ("fail", 5))
    whole_project, failed = Project(project.path, 2), FrameSelection.of_text("failed")
    assert str(whole_project.find_request(NAME, "draft", failed).requested) == "3,5"
    log_of(project.path, ("frame", 3))
    assert len(whole_project.find_request(NAME, "draft", failed).requested) == 2, "settled for this run"
    assert Project(project.path, 2).find_request(NAME, "draft", failed).requested == (5,)
    targets = Project(project.path, 2).pictures([NAME], "draft", failed).targets
    assert [Path(target).suffix for target in targets] == [".exr"]
    with pytest.raises(TypeError, match="reads text"):
        whole_project.find_request(NAME, "draft", "1-2")  # type: ignore[arg-type]  # as a script may


def test_whoever_has_no_shots_learns_where_they_were_looked_for(tmp_path: Path) -> None:
    with pytest.raises(
        UsageError, match=rf"^{tmp_path}/shots: no shots are here; .*--root is.*flowsculpt new"
    ):
        Show(tmp_path / "shots").require_shots()
