"""A job of this machine that shows no sign of life any more is ended, so that a night is not lost to it."""

from __future__ import annotations

import platform
import time
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from pathlib import Path

from pipeline.production.execution.poll import every
from pipeline.production.execution.snakemake import end_family
from pipeline.production.store.event_log import Event, EventLog, EventReader

PATIENCE = 1800.0
"""Seconds without a sign of life, by default: many times what the slowest pass of a picture takes."""

POLL_SECONDS = 0.5


def watched(log: Path, patience: float = PATIENCE) -> AbstractContextManager[None]:
    """While this lasts, jobs that tell of themselves in a log are ended where they hang."""
    return every(min(POLL_SECONDS, patience / 2.0), Watchdog(log, patience).look)


@dataclass
class _Job:
    """One that has begun: its process, what it last told of, and when, by a clock that nobody sets."""

    process: int
    told: Event
    heard: float = field(default_factory=time.monotonic)


class Watchdog:
    """Watches the jobs that tell of themselves in a log.

    Whatever a job writes is a sign of life: a frame begun or done, a pass rendered. One that is silent for
    longer than `patience` seconds is ended with all that it started, and the log says so (`hung`).
    """

    def __init__(self, log: Path, patience: float) -> None:
        self._log, self._patience = log, patience
        self._reader = EventReader(log)
        self._jobs: dict[str, _Job] = {}

    def look(self) -> None:
        """Hear what was told since the last look, and end who has been silent for too long."""
        for event in self._reader.new():
            self._hear(event)
        silent = time.monotonic() - self._patience
        for name in [name for name, job in self._jobs.items() if job.heard < silent]:
            self._end(name, self._jobs.pop(name))

    def _hear(self, event: Event) -> None:
        name = str(event["job"])
        if event["event"] == "end":
            self._jobs.pop(name, None)
        elif event["event"] == "begin":
            if event["host"] == platform.node():  # a farm ends what hangs on its nodes
                self._jobs[name] = _Job(int(event["process"]), event)
        elif name in self._jobs:
            self._jobs[name].heard, self._jobs[name].told = time.monotonic(), event

    def _end(self, name: str, job: _Job) -> None:
        """The log says so first, for who waits for the process reads there why it ended."""
        about = {part: job.told.get(part) for part in ("stage", "shot", "frame")}
        message = f"{name} gave no sign of life for {self._patience:g} s and was ended"
        EventLog(self._log, name).write("hung", **about, message=message)
        end_family(job.process)
