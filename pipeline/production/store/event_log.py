"""The event log of a run: one JSON object a line, appended by every task; and its readers.

A line is written with one `write` on a descriptor opened for appending, so lines of several processes
never mix. Network file systems promise that for one host only, so every other host of a farm has its own log,
`<plan>.<host>.jsonl`.

run, ran       a run begins, with its cores and whether it is a farm's, and ends, with the CPU seconds of its
               process and of its children
begin, end     of a job, with its threads, process and host, and with the CPU seconds of its process
fail           of a job or a frame
start, frame   of a frame; once it is there, the wall time (`seconds`) and CPU seconds (`cpu`) that it took,
               and `found`: the store had it already
work           of a job: CPU seconds of its stage that belong to none of its frames
pass           a sample batch of a picture is done
progress       of a mesh frame that takes long: the share that is done, and the activity
slow           a mesh frame takes very long, and why
healed         a damaged file is made again
warn           a frame was made in spite of something
resumed        a frame goes on from its checkpoint
renewed        a renderer was replaced by a fresh one, with the CPU seconds of the first
waits          a job waits for another that makes the same files
unfit          a host leaves a job to others
hung, killed   a job was ended since it went silent; something else ended it
"""

from __future__ import annotations

import contextlib
import json
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from flowsculpt.pipeline.production.store.paths import EVENTS
from flowsculpt.render.base.render_errors import MachineError
from flowsculpt.render.base.root_files import appended
from flowsculpt.render.base.state_files import plain_data

Event = dict[str, Any]

MOST_REFUSALS = 10
"""Polls in a row that the operating system may refuse before somebody is warned."""

TRIES = 5
"""Attempts at writing an event: network file systems refuse one and take the next."""

RUNS = 20
"""The most runs whose logs are kept."""


@dataclass
class EventLog:
    """Appends to the log of one run."""

    path: Path
    job: str = ""

    def write(self, event: str, **facts: Any) -> None:
        """Append an event. Where the disk refuses it several times, the event is lost and work goes on."""
        facts = {"time": round(time.time(), 3), "event": event, "job": self.job, **facts}
        line = json.dumps(facts).encode() + b"\n"
        for _ in range(TRIES):
            with contextlib.suppress(OSError), appended(self.path) as file:
                if file.write(line) == len(line):
                    return
                line = b"\n" + line.lstrip()  # after a part of it, with which readers can do nothing


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

        Raises OSError, once all others are read, where the operating system refuses one of the logs.
        """
        sought = json.dumps(saying).encode() if saying else b""
        refused = None
        for path in self._logs():
            try:
                yield from self._new_in(path, sought)
            except OSError as error:
                error.filename = str(path)
                refused = refused or error
        if refused is not None:
            raise refused

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
                if sought in line and (event := event_in(line)) is not None:
                    yield event


def event_in(line: bytes) -> Event | None:
    """Return the event of a line; None where it is damaged, or was cut short by a full disk."""
    with contextlib.suppress(ValueError, RecursionError):
        event = plain_data(line)
        if isinstance(event, dict) and "event" in event:
            event = {"job": "", "time": 0.0, **event}
            if all(isinstance(value, _KINDS.get(name, object)) for name, value in event.items()):
                return event
    return None


_KINDS: Mapping[str, Any] = {
    **dict.fromkeys(("event", "job", "stage", "shot", "quality", "message"), str | None),
    **dict.fromkeys(("time", "seconds", "cpu", "share"), int | float),
    **dict.fromkeys(("frame", "threads", "cores", "process"), int | None),
}
"""What the facts of events are, by name. A line with others is damaged, or of somebody else."""


def logs_of(root: Path) -> list[Path]:
    """Return the log of every run under a root, the latest last, without those of other hosts."""
    return sorted(path for path in (root / EVENTS).glob("*.jsonl") if "." not in path.stem)


@contextmanager
def poll(seconds: float, read: Callable[[], object], warn: Callable[[str], object]) -> Iterator[None]:
    """Call `read` from a thread every so many seconds, until the context is left.

    One call that the operating system refuses ends nothing: network folders come back.

    warn  called once, with the error, where MOST_REFUSALS calls are refused one after another
    """
    done = threading.Event()

    def follow() -> None:
        refusals, is_warned = 0, False
        while not done.wait(seconds):
            try:
                read()
                refusals = 0
            except OSError as error:
                refusals += 1
                if refusals >= MOST_REFUSALS and not is_warned:
                    is_warned = True
                    with contextlib.suppress(OSError):  # of a closed standard error
                        warn(
                            str(MachineError.of_path(Path(error.filename or "standard error"), error, "used"))
                        )

    thread = threading.Thread(target=follow, daemon=True)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()
