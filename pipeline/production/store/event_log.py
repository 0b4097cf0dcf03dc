"""The event log of a run: one JSON object a line, appended by every task; and its readers.

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
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pipeline.production.store.paths import EVENTS

Event = dict[str, Any]

RUNS = 20
"""The most runs whose logs are kept."""


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
