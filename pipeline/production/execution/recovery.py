"""Recover from what goes wrong in a run: end jobs that hang, and decide whether another round may help.

After a corrupt file was evicted or a crashed variant is avoided, another round makes what is missing. A
killed job had too little memory, in all likelihood: the next round has half as many side by side. One that
hung is tried once more. What is wrong with a shot, a mesh or the disk no round mends.
"""

from __future__ import annotations

import platform
import time
from collections import Counter
from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from pathlib import Path

from pipeline.production.execution.snakemake import end_family
from pipeline.production.store.event_log import Event, EventLog, EventReader, poll
from pipeline.production.store.processes import is_at_work

ROUNDS = 6
"""The most times that a run plans. Each may find one more damaged file on the way from a film to a mesh: a
finished frame, a rendered one, its normals, its mesh."""

TRIES = 2
"""The most times that a frame may hang."""

PATIENCE = 1800.0
"""Seconds without a sign of life, by default: many times what the slowest sample batch of a picture takes."""

POLL_SECONDS = 0.5


@dataclass
class RetryPolicy:
    """The retries of one run.

    cores     cores of the next round
    failures  events of what is beyond help, as failures
    """

    cores: int
    failures: list[Event] = field(default_factory=list)
    _rounds: int = 0
    _hung: Counter[tuple[object, ...]] = field(default_factory=Counter)

    def allows(self, events: Sequence[Event]) -> bool:
        """Tell whether another round may mend what a round with these events left undone."""
        self._rounds += 1
        may_help = any(event["event"] == "healed" for event in events)
        for event in events:
            if event["event"] == "hung":
                may_help |= self._may_try_again(event)
        killed = [event for event in events if event["event"] == "killed"]
        if killed and self.cores > 1:
            self.cores //= 2
            may_help = True
        else:
            self.failures += [_failure(e, "with nothing beside it. Is there memory enough?") for e in killed]
        return may_help and self._rounds < ROUNDS

    def _may_try_again(self, event: Event) -> bool:
        frame = (event.get("stage"), event.get("shot"), event.get("frame"))
        self._hung[frame] += 1
        if self._hung[frame] < TRIES:
            return True
        self.failures.append(_failure(event, "once more. If it is only slow, --timeout gives it longer."))
        return False


def _failure(event: Event, more: str) -> Event:
    return {**event, "event": "fail", "message": f"{event['message']} {more}"}


def watched(log: Path, patience: float = PATIENCE) -> AbstractContextManager[None]:
    """End the jobs that hang, by the event log, until the context is left."""
    watchdog = Watchdog(log, patience)
    return poll(min(POLL_SECONDS, patience / 2.0), watchdog.check, watchdog.warn)


@dataclass
class _BegunJob:
    """A job's process and its start, the event it last wrote, and when: by a clock that nobody sets."""

    process: int
    start: float | None
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
        self._jobs: dict[str, _BegunJob] = {}

    def check(self) -> None:
        """Read what was written since the last check, and end the jobs that were silent for too long."""
        for event in self._reader.new():
            self._note(event)
        silent = time.monotonic() - self._patience
        for name in [name for name, job in self._jobs.items() if job.written < silent]:
            self._end(name, self._jobs.pop(name))

    def warn(self, message: str) -> None:
        """Say in the log that it cannot be read: until then nothing that hangs is ended."""
        EventLog(self._log).write("warn", message=f"{message}; jobs that hang are not ended meanwhile")

    def _note(self, event: Event) -> None:
        name = str(event["job"])
        if event["event"] == "end":
            self._jobs.pop(name, None)
        elif event["event"] == "begin":
            if event["host"] == platform.node():  # a farm ends what hangs on its nodes
                self._jobs[name] = _BegunJob(int(event["process"]), event.get("started"), event)
        elif name in self._jobs:
            self._jobs[name] = replace(self._jobs[name], event=event, written=time.monotonic())

    def _end(self, name: str, job: _BegunJob) -> None:
        """End a job; the log says so first, for who waits for the process reads there why it ended.

        One that was killed wrote no end, and another process may have its number by now.
        """
        if not is_at_work(job.process, job.start):
            return
        about = {part: job.event.get(part) for part in ("stage", "shot", "quality", "frame")}
        message = f"{name} gave no sign of life for {self._patience:g} s and was ended"
        EventLog(self._log, name).write("hung", **about, message=message)
        end_family(job.process)
