"""End jobs of this machine that show no sign of life, so that a night is not lost to them."""

from __future__ import annotations

import platform
import time
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from pathlib import Path

from pipeline.production.execution.snakemake import end_family
from pipeline.production.store.event_log import Event, EventLog, EventReader, poll

PATIENCE = 1800.0
"""Seconds without a sign of life, by default: many times what the slowest sample batch of a picture takes."""

POLL_SECONDS = 0.5


def watched(log: Path, patience: float = PATIENCE) -> AbstractContextManager[None]:
    """End the jobs that hang, by the event log, until the context is left."""
    return poll(min(POLL_SECONDS, patience / 2.0), Watchdog(log, patience).check)


@dataclass
class _Job:
    """A job that has begun.

    process  its process
    event    what it last wrote
    written  when, by a clock that nobody sets
    """

    process: int
    event: Event
    written: float = field(default_factory=time.monotonic)


class Watchdog:
    """Watches the jobs that write to an event log.

    Whatever a job writes is a sign of life: a frame begun or done, a sample batch rendered. One that is
    silent for longer than `patience` seconds is ended with all that it started, and the log says so (`hung`).
    """

    def __init__(self, log: Path, patience: float) -> None:
        self._log, self._patience = log, patience
        self._reader = EventReader(log)
        self._jobs: dict[str, _Job] = {}

    def check(self) -> None:
        """Read what was written since the last check, and end the jobs that were silent for too long."""
        for event in self._reader.new():
            self._note(event)
        silent = time.monotonic() - self._patience
        for name in [name for name, job in self._jobs.items() if job.written < silent]:
            self._end(name, self._jobs.pop(name))

    def _note(self, event: Event) -> None:
        name = str(event["job"])
        if event["event"] == "end":
            self._jobs.pop(name, None)
        elif event["event"] == "begin":
            if event["host"] == platform.node():  # a farm ends what hangs on its nodes
                self._jobs[name] = _Job(int(event["process"]), event)
        elif name in self._jobs:
            self._jobs[name].written, self._jobs[name].event = time.monotonic(), event

    def _end(self, name: str, job: _Job) -> None:
        """End a job; the log says so first, for who waits for the process reads there why it ended."""
        about = {part: job.event.get(part) for part in ("stage", "shot", "frame")}
        message = f"{name} gave no sign of life for {self._patience:g} s and was ended"
        EventLog(self._log, name).write("hung", **about, message=message)
        end_family(job.process)
