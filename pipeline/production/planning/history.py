"""History of the latest runs: frames that failed, frames being made, and the pace, from the event logs."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import psutil

from pipeline.production.store.event_log import Event, EventReader, logs_of

RUNS = 20
"""The number of latest runs that are read."""

ENDINGS = ("frame", "fail", "hung")
"""Events that end the work on a frame."""


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
    with contextlib.suppress(psutil.Error):
        return job in psutil.Process(process).cmdline()
    return False
