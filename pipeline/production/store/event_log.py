"""The event log: one JSON object a line, appended by every task; its readers, and the history of runs.

A line is written with one `write` on a descriptor opened for appending, so lines of several processes
never mix. Network file systems promise that for one host only, so every other host of a farm has its own log,
`<plan>.<host>.jsonl`.

run, ran       a run begins, with its cores, and ends
begin, end     of a job, with its threads, process and host
fail           of a job or a frame
start, frame   of a frame; once it is there, the seconds it took and `found`: the store had it already
pass           a sample batch of a picture is done
progress       of a mesh frame that takes long: the share that is done, and the activity
slow           a mesh frame takes very long, and why
healed         a damaged file is made again
warn           a frame was made in spite of something
resumed        a frame goes on from its checkpoint
renewed        a renderer was replaced by a fresh one
waits          a job waits for another that makes the same files
hung, killed   a job was ended since it went silent; something else ended it
"""

from __future__ import annotations

import contextlib
import json
import os
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from pipeline.production.store.paths import EVENTS

Event = dict[str, Any]

RUNS = 20
"""The number of latest runs that a history holds."""

ENDINGS = ("frame", "fail", "hung")
"""Events that end the work on a frame."""


@dataclass
class EventLog:
    """Appends to the log of one run."""

    path: Path
    job: str = ""

    def write(self, event: str, **facts: Any) -> None:
        line = json.dumps({"time": round(time.time(), 3), "event": event, "job": self.job, **facts})
        with contextlib.suppress(OSError):  # a full disk must not hide what is being told of it
            self.path.parent.mkdir(parents=True, exist_ok=True)
            descriptor = os.open(self.path, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o644)
            try:
                os.write(descriptor, line.encode() + b"\n")
            finally:
                os.close(descriptor)


@dataclass
class EventReader:
    """Reads the new events of a log that is being written, and of the logs of other hosts."""

    path: Path
    _offsets: dict[Path, int] = field(default_factory=dict, init=False)

    def skip(self) -> None:
        """Skip all events until now."""
        self._offsets = {path: path.stat().st_size for path in self._logs()}

    def new(self, saying: str = "") -> Iterator[Event]:
        """Yield the events since the last reading.

        saying  skip lines without this string as a value before parsing them; logs can be long
        """
        sought = json.dumps(saying).encode() if saying else b""
        for path in self._logs():
            yield from self._new_in(path, sought)

    def _logs(self) -> list[Path]:
        """Return the log of the host that made the plan, and those of other hosts."""
        return sorted(self.path.parent.glob(f"{self.path.stem}.*jsonl"))

    def _new_in(self, path: Path, sought: bytes) -> Iterator[Event]:
        with contextlib.suppress(FileNotFoundError), path.open("rb") as file:
            file.seek(self._offsets.get(path, 0))
            for line in file:
                if not line.endswith(b"\n"):  # still being written
                    return
                self._offsets[path] = self._offsets.get(path, 0) + len(line)
                with contextlib.suppress(ValueError):  # cut short by a full disk
                    if sought in line:
                        yield json.loads(line)


def logs_of(root: Path) -> list[Path]:
    """Return the log of every run under a root, the latest last, without those of other hosts."""
    return sorted(path for path in (root / EVENTS).glob("*.jsonl") if "." not in path.stem)


@contextmanager
def poll(seconds: float, read: Callable[[], object]) -> Iterator[None]:
    """Call `read` from a thread every so many seconds, until the context is left."""
    done = threading.Event()

    def follow() -> None:
        while not done.wait(seconds):
            read()

    thread = threading.Thread(target=follow, daemon=True)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()


@dataclass(frozen=True)
class History:
    """The events of the latest runs under a root, the latest last."""

    runs: tuple[tuple[Event, ...], ...]

    @classmethod
    def of(cls, root: Path) -> History:
        logs = logs_of(root)[-RUNS:]
        return cls(tuple(tuple(EventReader(log).new()) for log in logs))

    def failed(self, shot: str, stages: Iterable[str], quality: str | None = None) -> dict[int, str]:
        """Return the frames whose last try failed, with the message."""
        failed: dict[int, str] = {}
        for event in self._events(shot, stages, quality):
            if event["event"] in ("fail", "hung"):
                failed[event["frame"]] = event["message"]
            elif event["event"] == "frame":
                failed.pop(event["frame"], None)
        return failed

    def running(self, shot: str, stages: Iterable[str], quality: str | None = None) -> set[int]:
        """Return the frames that processes are working on now."""
        working: dict[tuple[str, int], bool] = {}
        for event in self._events(shot, stages, quality):
            place = event["job"], event["frame"]
            if event["event"] == "start":
                working[place] = event["job"] in self._alive
            elif event["event"] in ENDINGS:
                working.pop(place, None)
        return {frame for (_, frame), alive in working.items() if alive}

    def pace(self, shot: str, stages: Iterable[str], quality: str | None = None) -> float | None:
        """Return the mean seconds from one frame to the next at the slowest of the stages in its last run.

        Frames made side by side count one after the other. None where no run made two.
        """
        return max(filter(None, (self._pace(shot, stage, quality) for stage in stages)), default=None)

    def _pace(self, shot: str, stage: str, quality: str | None) -> float | None:
        for run in reversed(self.runs):
            told = [event for event in run if _is_of(event, shot, (stage,), quality)]
            made = [e["time"] for e in told if e["event"] == "frame" and not e["found"]]
            begun = [event["time"] for event in told if event["event"] == "start"]
            if made and begun and max(made) > min(begun):
                return float((max(made) - min(begun)) / len(made))
        return None

    def _events(self, shot: str, stages: Iterable[str], quality: str | None) -> Iterator[Event]:
        wanted = tuple(stages)
        for run in self.runs:
            yield from (event for event in run if _is_of(event, shot, wanted, quality))

    @cached_property
    def _alive(self) -> set[str]:
        """The jobs of the latest run whose processes are alive."""
        processes: dict[str, int] = {}
        for event in self.runs[-1] if self.runs else ():
            if event["event"] == "begin":
                processes[event["job"]] = event["process"]
            elif event["event"] == "end":
                processes.pop(event["job"], None)
        return {job for job, process in processes.items() if _works_on(process, job)}


def _is_of(event: Event, shot: str, stages: tuple[str, ...], quality: str | None) -> bool:
    return (
        event.get("frame") is not None
        and event.get("shot") == shot
        and event.get("stage") in stages
        and quality in (None, event.get("quality"))
    )


def _works_on(process: int, job: str) -> bool:
    import psutil  # which most processes never need

    with contextlib.suppress(psutil.Error):
        return job in psutil.Process(process).cmdline()
    return False
