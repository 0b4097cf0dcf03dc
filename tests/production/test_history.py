"""The history of runs: what logs say of frames, kept small."""

from __future__ import annotations

import json
import os
import platform
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flowsculpt.pipeline.production.store import history
from flowsculpt.pipeline.production.store.event_log import RUNS, EventLog, logs_of
from flowsculpt.pipeline.production.store.history import History, Made, summarise
from flowsculpt.pipeline.production.store.paths import EVENTS

pytestmark = pytest.mark.quick

STAGES = ("simulate", "render", "finish")

OLD = "20260101-000000-1"
"""A run that was logged before CPU seconds were counted."""

events = st.tuples(
    st.sampled_from(["start", "frame", "fail", "found"]),
    st.sampled_from(STAGES),
    st.sampled_from(["A", "B"]),
    st.integers(1, 4),
)


def write_log(root: Path, name: str, happened: list[tuple[str, str, str, int]], end: str = "ran") -> Path:
    log = EventLog(root / EVENTS / f"{name}.jsonl", "job")
    log.write("begin", host=platform.node(), process=os.getpid(), threads=2)
    for what, stage, shot, frame in happened:
        facts = {"stage": stage, "shot": shot, "quality": "draft", "frame": frame}
        if what == "fail":
            log.write("fail", **facts, message=f"{name} failed")
        elif what == "start":
            log.write("start", **facts)
        else:
            cpu = {} if name == OLD else {"cpu": 2.0}
            log.write("frame", **facts, found=what == "found", seconds=1.5, **cpu)
    log.write("end")
    if end:
        log.write(end)
    return log.path


def known(root: Path) -> dict[str, object]:
    told = History.of(root)
    facts: dict[str, object] = {}
    for shot in ("A", "B"):
        for stage in STAGES:
            stage_history = told.stage(stage, shot, "draft")
            facts[f"{shot} {stage}"] = stage_history.failed, stage_history.made
    return facts


@pytest.mark.slow
@given(runs=st.lists(st.lists(events, max_size=8), min_size=1, max_size=4), ended=st.integers(0, 4))
def test_summaries_say_what_the_logs_said(
    runs: list[list[tuple[str, str, str, int]]], ended: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    as_logs, as_summaries = tmp_path_factory.mktemp("logs"), tmp_path_factory.mktemp("summaries")
    for number, happened in enumerate(runs):
        write_log(as_logs, f"20260101-00000{number}-1", happened)
        write_log(as_summaries, f"20260101-00000{number}-1", happened)
        if number < ended:
            summarise(as_summaries)
    assert known(as_summaries) == known(as_logs)


def test_the_last_run_that_made_a_frame_is_known_with_its_time(tmp_path: Path) -> None:
    for name in ("20260101-000000-1", "20260102-000000-1"):
        write_log(tmp_path, name, [("frame", "render", "A", 1), ("found", "render", "A", 2)])
        summarise(tmp_path)
    made = History.of(tmp_path).stage("render", "A", "draft").made
    assert made == {1: Made("20260102-000000-1", 1.5, 2, 2.0)}


def test_summaries_and_logs_of_earlier_versions_hold_no_cpu_seconds(tmp_path: Path) -> None:
    write_log(tmp_path, OLD, [("frame", "render", "A", 1)])
    made = History.of(tmp_path).stage("render", "A", "draft").made[1]
    assert made.cpu is None and made.cost == 3.0
    old = {"pace": None, "failed": {}, "made": {OLD: {"1": [1.5, 2]}}}
    assert history.StageHistory.from_data(old).made == {1: made}


def test_a_run_at_work_is_read_as_it_is_and_a_killed_one_is_summarised_later(tmp_path: Path) -> None:
    at_work, killed = f"20260101-000000-{os.getpid()}", "20260102-000000-999999999"
    for name, frame in ((at_work, 1), (killed, 2)):
        write_log(tmp_path, name, [("fail", "render", "A", frame)], end="")
    summarise(tmp_path)
    assert set(json.loads((tmp_path / history.HISTORY / "logs.json").read_text())) == {killed}
    assert set(History.of(tmp_path).failed("A", ["render"], "draft")) == {1, 2}


def test_logs_of_old_runs_go_once_they_are_summarised(tmp_path: Path) -> None:
    for number in range(RUNS + 3):
        write_log(tmp_path, f"20260101-0000{number:02d}-1", [("frame", "render", "A", number)])
        summarise(tmp_path)
    assert len(logs_of(tmp_path)) == RUNS
    assert len(History.of(tmp_path).stage("render", "A", "draft").made) == RUNS + 3


def test_large_logs_go_earlier(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(history, "KEPT_BYTES", 0)
    for number in range(history.LATEST + 2):
        write_log(tmp_path, f"20260101-00000{number}-1", [("frame", "render", "A", number)])
    summarise(tmp_path)
    assert [log.stem for log in logs_of(tmp_path)] == [f"20260101-00000{n}-1" for n in (2, 3, 4)]


def test_a_damaged_summary_counts_as_none(tmp_path: Path) -> None:
    write_log(tmp_path, "20260101-000000-1", [("fail", "render", "A", 1)])
    summarise(tmp_path)
    for path in (tmp_path / history.HISTORY).glob("A*.json"):
        path.write_text('{"shot": "A"')
    assert not History.of(tmp_path).failed("A", ["render"], "draft")
    assert History.of(tmp_path).places() == []
