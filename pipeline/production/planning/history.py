"""What the last runs told of themselves: which frames failed, which are being made, how fast they come."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import psutil

from pipeline.production.store.event_log import Event, EventReader, logs_of

RUNS = 20
"""How many of the last runs are looked at."""

SETTLING = ("frame", "fail", "hung")
"""Events after which a frame is not under way any more."""


@dataclass(frozen=True)
class History:
    """The last runs under a root folder, the latest last."""

    runs: tuple[tuple[Event, ...], ...]

    @classmethod
    def of(cls, root: Path) -> History:
        logs = logs_of(root)[-RUNS:]
        return cls(tuple(tuple(EventReader(log).new()) for log in logs))

    def failed(self, shot: str, stages: Iterable[str], quality: str | None = None) -> dict[int, str]:
        """The frames that failed when they were last tried, and why."""
        failed: dict[int, str] = {}
        for event in self._told(shot, stages, quality):
            if event["event"] in ("fail", "hung"):
                failed[event["frame"]] = event["message"]
            elif event["event"] == "frame":
                failed.pop(event["frame"], None)
        return failed

    def running(self, shot: str, stages: Iterable[str], quality: str | None = None) -> set[int]:
        """The frames that processes are at now."""
        under_way: dict[tuple[str, int], bool] = {}
        for event in self._told(shot, stages, quality):
            place = event["job"], event["frame"]
            if event["event"] == "start":
                under_way[place] = event["job"] in self._alive
            elif event["event"] in SETTLING:
                under_way.pop(place, None)
        return {frame for (_, frame), alive in under_way.items() if alive}

    def pace(self, shot: str, stages: Iterable[str], quality: str | None = None) -> float | None:
        """Seconds from one frame to the next when the slowest of the stages last made some, however many were
        made side by side; None where that is not known."""
        return max(filter(None, (self._pace(shot, stage, quality) for stage in stages)), default=None)

    def _pace(self, shot: str, stage: str, quality: str | None) -> float | None:
        for run in reversed(self.runs):
            told = [event for event in run if _is_of(event, shot, (stage,), quality)]
            made = [e["time"] for e in told if e["event"] == "frame" and not e["found"]]
            begun = [event["time"] for event in told if event["event"] == "start"]
            if made and begun and max(made) > min(begun):
                return float((max(made) - min(begun)) / len(made))
        return None

    def _told(self, shot: str, stages: Iterable[str], quality: str | None) -> Iterator[Event]:
        wanted = tuple(stages)
        for run in self.runs:
            yield from (event for event in run if _is_of(event, shot, wanted, quality))

    @cached_property
    def _alive(self) -> set[str]:
        """The jobs of the last run whose processes are there."""
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
    with contextlib.suppress(psutil.Error):
        return job in psutil.Process(process).cmdline()
    return False
