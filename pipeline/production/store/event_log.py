"""The event log: one JSON object a line, appended by every task, read by whoever shows progress.

A line is written with one `write` on a descriptor opened for appending, so lines of several processes
never mix. Network file systems promise that for one host only, so every other host of a farm has a log of its
own beside, `<plan>.<host>.jsonl`. Events: `run`, with its cores, and `ran`; `begin`, with its threads, its
process and host, `end` and `fail` of a job; `start` of a frame, `pass` of a picture, and `frame` once it is
there, with the seconds it took and whether the store had it already; `healed` for what is made again; `warn`
for what a frame was made in spite of; `resumed` for a frame that goes on from its last pass; `renewed` for a
rendering process replaced by a fresh one; `hung` and `killed` for a job that went silent and was ended, and
for one that something else ended.
"""

from __future__ import annotations

import contextlib
import json
import os
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pipeline.production.store.paths import EVENTS

Event = dict[str, Any]


@dataclass
class EventLog:
    """The log of one run, to append to."""

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
    """Reads a log that is being written, and those of other hosts, from where the last reading ended."""

    path: Path
    _offsets: dict[Path, int] = field(default_factory=dict, init=False)

    def skip(self) -> None:
        """Leave out what was told until now."""
        self._offsets = {path: path.stat().st_size for path in self._logs()}

    def new(self, saying: str = "") -> Iterator[Event]:
        """Those told since the last reading; `saying` leaves out all that do not have it for a value, and
        need not take them apart: jobs of a long run look for a few of very many."""
        sought = json.dumps(saying).encode() if saying else b""
        for path in self._logs():
            yield from self._new_in(path, sought)

    def _logs(self) -> list[Path]:
        """That of the host where the plan was made, and of others."""
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
    """The log of every run under a root, the latest last; those of other hosts belong to them."""
    return sorted(path for path in (root / EVENTS).glob("*.jsonl") if "." not in path.stem)
