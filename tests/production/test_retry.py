"""Retries: hanging workers are ended, killed ones get more memory, and no task is retried for ever."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import psutil
import pytest

from flowsculpt.pipeline.production.execution import run
from flowsculpt.pipeline.production.execution.run import ROUNDS, RetryPolicy, Watchdog, watched
from flowsculpt.pipeline.production.store.event_log import EventLog, EventReader, poll
from flowsculpt.render.base.processes import start_of
from tests.processes import process_numbered, wait_until

pytestmark = pytest.mark.quick


@contextmanager
def stuck() -> Iterator[subprocess.Popen[bytes]]:
    """Start a process that does nothing, and kill it in the end."""
    with subprocess.Popen([sys.executable, "-c", "import time; time.sleep(3600)"]) as process:
        try:
            yield process
        finally:
            process.kill()


def begun(log: EventLog, process: int, host: str | None = None) -> None:
    log.write("begin", stage="render", process=process, host=host or platform.node())


def events(log: EventLog, kind: str) -> list[dict[str, Any]]:
    return [event for event in EventReader(log.path).new() if event["event"] == kind]


@pytest.mark.slow
@pytest.mark.parametrize("stopped", [False, True])
def test_a_job_that_is_silent_is_ended_and_the_log_says_which_frame_it_was_at(
    stopped: bool, tmp_path: Path
) -> None:
    log = EventLog(tmp_path / "a.jsonl", "job")
    with stuck() as process:
        begun(log, process.pid)
        log.write("start", stage="render", shot="A010", frame=12)
        if stopped:
            psutil.Process(process.pid).suspend()
        with watched(log.path, 0.3):
            process.wait(120)
    (hung,) = events(log, "hung")
    assert (hung["shot"], hung["frame"], hung["stage"]) == ("A010", 12, "render")
    assert "no sign of life for 0.3 s" in hung["message"]


def test_a_job_that_tells_of_itself_or_has_ended_or_is_elsewhere_is_left_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log, other = EventLog(tmp_path / "a.jsonl", "job"), EventLog(tmp_path / "a.jsonl", "other")
    now, ended = 0.0, list[int]()
    monkeypatch.setattr(time, "monotonic", lambda: now)
    monkeypatch.setattr(run, "end_family", ended.append)
    watchdog = Watchdog(log.path, 1.0)
    begun(other, os.getpid())
    other.write("end")
    begun(EventLog(log.path, "far"), os.getpid(), "another host")
    begun(log, os.getpid())
    for done in range(12):
        log.write("pass", frame=1, done=done, most=12)
        watchdog.check()
        now += 0.9
    assert not ended and not events(log, "hung")
    now += 0.9
    watchdog.check()
    assert ended == [os.getpid()] and len(events(log, "hung")) == 1, "it is silent now"


@pytest.mark.slow
def test_a_process_that_has_the_number_of_a_killed_job_by_now_is_left_alone(tmp_path: Path) -> None:
    log = EventLog(tmp_path / "a.jsonl", "job")
    with stuck() as job:
        log.write("begin", process=job.pid, started=start_of(job.pid), host=platform.node())
    with process_numbered(job.pid) as other, watched(log.path, 0.3):
        time.sleep(1.0)
        assert other.poll() is None
    assert not events(log, "hung")


@pytest.mark.slow
def test_a_log_that_cannot_be_read_for_a_while_keeps_nobody_from_ending_what_hangs(tmp_path: Path) -> None:
    log = EventLog(tmp_path / "a.jsonl", "job")
    with stuck() as process, watched(log.path, 0.3):
        log.path.mkdir()
        time.sleep(0.5)
        log.path.rmdir()
        begun(log, process.pid)
        process.wait(120)
    assert events(log, "hung")


def test_a_poll_that_is_refused_for_long_warns_once_and_goes_on(tmp_path: Path) -> None:
    seen, told = [], []
    path = tmp_path / "a.jsonl"
    path.mkdir()
    reader = EventReader(path)
    with poll(0.01, lambda: seen.extend(reader.new()), told.append):
        wait_until(lambda: told)
        time.sleep(0.3)
        path.rmdir()
        EventLog(path).write("ran")
        wait_until(lambda: seen)
    assert told == [f"{path}: cannot be used: a folder stands where a file should be; move it away"]


def event(kind: str, frame: int | None = None) -> dict[str, Any]:
    about = {"job": "render_0001", "stage": "render", "shot": "A010", "frame": frame}
    return {"event": kind, **about, "message": "it went wrong"}


def test_a_frame_that_hangs_is_tried_once_more() -> None:
    policy = RetryPolicy(2)
    assert policy.allows([event("hung", 3)])
    assert policy.allows([event("hung", 4)]), "another frame has its own try"
    assert not policy.allows([event("hung", 3)])
    (failure,) = policy.failures
    assert failure["event"] == "fail" and failure["frame"] == 3 and "--timeout" in failure["message"]


def test_what_was_killed_has_fewer_jobs_beside_it_until_it_is_alone() -> None:
    policy = RetryPolicy(4)
    assert policy.allows([event("killed")]) and policy.cores == 2
    assert policy.allows([event("killed")]) and policy.cores == 1
    assert not policy.allows([event("killed")])
    assert "memory" in policy.failures[0]["message"]


def test_a_bad_shot_is_not_tried_again_and_healing_ends_some_time() -> None:
    assert not RetryPolicy(2).allows([event("fail", 1)])
    policy = RetryPolicy(2)
    assert [policy.allows([event("healed")]) for _ in range(ROUNDS)] == [True] * (ROUNDS - 1) + [False]
