"""The history of runs: for each frame of a shot, its last failure and what making it took.

Event logs grow with every frame of every run. When a run ends, its log is added to a summary per shot and
quality, which holds the last word on each frame and so stays small; files that all qualities share have one
summary a shot. Only logs of runs that are at work, or were killed, are read as they are. Old ones are
removed.

.flowsculpt/history/<shot>.<quality>.json    a summary
.flowsculpt/history/logs.json                the size of each log in the summaries
"""

from __future__ import annotations

import contextlib
import json
import platform
import time
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from flowsculpt.pipeline.errors import MachineError
from flowsculpt.pipeline.production.stages import STAGES
from flowsculpt.pipeline.production.store.event_log import RUNS, Event, EventReader, event_in, logs_of
from flowsculpt.pipeline.production.store.locks import Locks
from flowsculpt.pipeline.production.store.paths import LOGS, STATE
from flowsculpt.pipeline.production.store.remote_store import LOG
from flowsculpt.render.base.atomic_write import write_text
from flowsculpt.render.base.processes import command_of, is_at_work
from flowsculpt.render.base.root_files import remove_file, remove_tree
from flowsculpt.render.base.state_files import UNUSABLE, mapping, plain_data, read_state, usable

HISTORY = STATE / "history"

SHARED = "meshes"
"""Stands for the quality of files that all qualities share."""

LEFT_OUT = "what it says of failures and times is left out"

_ENDINGS = ("frame", "fail", "hung")
"""Events that end the work on a frame."""


class Made(NamedTuple):
    """The run that made a frame last, and what it took.

    seconds  wall time
    cpu      CPU seconds; None in logs of earlier versions
    """

    run: str
    seconds: float
    threads: int
    cpu: float | None = None

    @property
    def cost(self) -> float:
        """Core-seconds: CPU seconds or, where they were not counted, wall time on all threads."""
        return self.seconds * self.threads if self.cpu is None else self.cpu


class Worker(NamedTuple):
    """The process of a job, and its start as `start_of` has it; None in logs of earlier versions."""

    process: int
    start: float | None

    def is_on(self, job: str) -> bool:
        return is_at_work(*self) and job in command_of(self.process)


@dataclass
class StageHistory:
    """The last word on each frame at one stage.

    pace    mean seconds from one frame to the next in the last run that made two
    failed  messages by frame, of those that failed at the last try
    made    frames that were computed, not found in the store
    """

    pace: float | None = None
    failed: dict[int, str] = field(default_factory=dict)
    made: dict[int, Made] = field(default_factory=dict)

    def as_data(self) -> dict[str, Any]:
        by_run: defaultdict[str, dict[int, list[float | None]]] = defaultdict(dict)
        for frame, (run, *taken) in self.made.items():
            by_run[run][frame] = taken
        return {"pace": self.pace, "failed": self.failed, "made": by_run}

    @classmethod
    def from_data(cls, data: Any) -> StageHistory:
        failed = {int(frame): str(message) for frame, message in data["failed"].items()}
        made = {
            int(frame): Made(run, float(seconds), int(threads), None if cpu in ([], [None]) else float(*cpu))
            for run, frames in data["made"].items()
            for frame, (seconds, threads, *cpu) in frames.items()
        }
        return cls(None if data["pace"] is None else float(data["pace"]), failed, made)


Place = tuple[str, str]
"""A shot, or another subject of events, and a quality or SHARED."""


class History:
    """The history of all runs under a root. Summaries are read when they are asked for.

    is_whole  False once a log or a summary was left out since the operating system refuses it; a warning is
              logged, once for each
    """

    def __init__(self, root: Path) -> None:
        self._root = root
        self._stages: dict[Place, dict[str, StageHistory]] = {}
        self._working: dict[tuple[Place, str], dict[tuple[str, int], Worker]] = {}
        self.is_whole = True

    @classmethod
    def of(cls, root: Path) -> History:
        """Return the history with the runs that are at work, and those that were killed."""
        history, ended = cls(root), logs_added(root)
        for log in logs_of(root):
            if ended.get(log.stem) != size_of(log):
                history.add(log)
        return history

    def stage(self, stage: str, shot: str, quality: str) -> StageHistory:
        """Return the history of a stage of a shot; one that all qualities share has one for all."""
        place = shot, quality if STAGES[stage].per_quality else SHARED
        return self._at(place).setdefault(stage, StageHistory())

    def failed(self, shot: str, stages: Iterable[str], quality: str) -> dict[int, str]:
        """Return the frames whose last try failed, with the message."""
        known = [self.stage(stage, shot, quality).failed for stage in stages]
        return {frame: message for failed in known for frame, message in failed.items()}

    def running(self, shot: str, stages: Iterable[str], quality: str) -> set[int]:
        """Return the frames that processes are working on now."""
        places = [(shot, quality if STAGES[stage].per_quality else SHARED) for stage in stages]
        works = [self._working.get(about, {}) for about in zip(places, stages, strict=True)]
        return {frame for jobs in works for (job, frame), worker in jobs.items() if worker.is_on(job)}

    def pace(self, shot: str, stages: Iterable[str], quality: str) -> float | None:
        """Return the mean seconds from one frame to the next at the slowest of the stages in its last run.

        Frames made side by side count one after the other. None where no run made two.
        """
        return max(filter(None, (self.stage(s, shot, quality).pace for s in stages)), default=None)

    def places(self) -> list[Place]:
        """Return the shots and qualities with a history."""
        for path in sorted((self._root / HISTORY).glob("*.*.json")):
            for place, stages in self._summary_in(path).items():
                self._stages.setdefault(place, stages)
        return list(self._stages)

    # Writing

    def add(self, log: Path) -> None:
        """Add the events of a run's log, and of those of other hosts."""
        run = _Run(self, log.stem)
        try:
            for event in EventReader(log).new():
                with contextlib.suppress(*UNUSABLE):  # a damaged line
                    run.add(event)
        except OSError as error:
            self._leave_out(Path(error.filename), error)
        run.finish()

    def write(self) -> None:
        """Write the summaries to which runs were added."""
        for (shot, quality), stages in self._stages.items():
            data = {name: stage.as_data() for name, stage in stages.items()}
            text = json.dumps({"shot": shot, "quality": quality, "stages": data})
            write_text(_summary(self._root, (shot, quality)), text, flush=False)

    def _at(self, place: Place) -> dict[str, StageHistory]:
        if place not in self._stages:
            self._stages[place] = self._summary_in(_summary(self._root, place)).get(place, {})
        return self._stages[place]

    def _summary_in(self, path: Path) -> dict[Place, dict[str, StageHistory]]:
        """Return the stages in a summary by their place; none where it is not there, or cannot be read."""
        try:
            content = path.read_bytes()
        except FileNotFoundError:
            return {}
        except OSError as error:
            self._leave_out(path, error)
            return {}
        if (stages := usable(lambda: _stages(plain_data(content)))) is None:
            _warn(f"{path}: it is damaged; {LEFT_OUT}. The next run writes it again.")
        return stages or {}

    def _leave_out(self, path: Path, error: OSError) -> None:
        self.is_whole = False
        _warn(f"{MachineError.of_path(path, error, 'read')}; {LEFT_OUT}")

    def works_on(self, place: Place, stage: str) -> dict[tuple[str, int], Worker]:
        """Return jobs and frames that are worked on, with the processes; `add` keeps them."""
        return self._working.setdefault((place, stage), {})


class _Run:
    """Adds the events of one run to a history."""

    def __init__(self, history: History, name: str) -> None:
        self._history, self._name = history, name
        self._threads: dict[str, int] = {}
        self._workers: dict[str, Worker] = {}
        self._spans: dict[tuple[Place, str], tuple[float, float, int]] = {}

    def add(self, event: Event) -> None:
        what, job = event["event"], event.get("job", "")
        if what == "begin":
            self._threads[job] = int(event.get("threads", 1))
            self._workers[job] = Worker(int(event.get("process", 0)), event.get("started"))
        elif what == "end":
            self._workers.pop(job, None)
        elif (what == "start" or what in _ENDINGS) and event.get("frame") is not None:
            self._add_frame(what, job, event)

    def _add_frame(self, what: str, job: str, event: Event) -> None:
        stage, frame = event.get("stage"), event["frame"]
        if stage not in STAGES:  # of an earlier version
            return
        place = str(event.get("shot")), str(event.get("quality", "")) if STAGES[stage].per_quality else SHARED
        known = self._history.stage(stage, *place)
        first, last, count = self._spans.get((place, stage), (float("inf"), 0.0, 0))
        works = self._history.works_on(place, stage)
        if what == "start":
            first = min(first, event["time"])
            if job in self._workers:
                works[job, frame] = self._workers[job]
        else:
            works.pop((job, frame), None)
        if what == "frame":
            known.failed.pop(frame, None)
            if not event["found"]:
                seconds, threads = float(event.get("seconds", 0.0)), self._threads.get(job, 1)
                cpu = None if event.get("cpu") is None else float(event["cpu"])
                known.made[frame] = Made(self._name, seconds, threads, cpu)
                last, count = max(last, event["time"]), count + 1
        elif what != "start":
            known.failed[frame] = str(event["message"])
        self._spans[place, stage] = first, last, count

    def finish(self) -> None:
        """Note the pace of each stage, and forget the frames of jobs that have ended."""
        for (place, stage), (first, last, count) in self._spans.items():
            if count and last > first:
                self._history.stage(stage, *place).pace = (last - first) / count
            works = self._history.works_on(place, stage)
            for job, frame in [about for about in works if about[0] not in self._workers]:
                works.pop((job, frame))


def _stages(data: Any) -> dict[Place, dict[str, StageHistory]]:
    """Return the stages of a summary by their place. Raises one of UNUSABLE for other data."""
    stages = {name: StageHistory.from_data(stage) for name, stage in data["stages"].items()}
    return {(str(data["shot"]), str(data["quality"])): stages}


def logs_added(root: Path) -> dict[str, int]:
    """Return the size that each log had when it was added to the summaries."""
    sizes = read_state(root / HISTORY / "logs.json", mapping) or {}
    return {log: size for log, size in sizes.items() if isinstance(size, int)}


@cache
def _warn(message: str) -> None:
    """Warn once, however often the history is read."""
    LOG.warning(message)


def _summary(root: Path, place: Place) -> Path:
    return root / HISTORY / f"{Locks.name(*place)}.json"


def size_of(log: Path) -> int:
    """Return the bytes of a log and of those of other hosts."""
    total = 0
    for path in log.parent.glob(f"{log.stem}.*jsonl"):
        with contextlib.suppress(OSError):
            total += path.stat().st_size
    return total


KEPT_BYTES = 64 * 1024 * 1024
"""The most that the logs of ended runs take, but those of the last LATEST runs."""

LATEST = 3

SILENT_SECONDS = 24 * 3600.0
"""Seconds without a line after which a run of another host counts as ended."""

_TAIL = 4096
"""Bytes at the end of a log in which its last line is sought."""


def summarise(root: Path) -> None:
    """Add the logs of ended runs to the summaries, and remove old ones. Ignore errors of the disk."""
    logs = logs_of(root)
    if not logs:
        return
    with contextlib.suppress(OSError, MachineError), Locks(root).hold_key("history", lambda: None):
        added = before = logs_added(root)
        for log in logs:
            if added.get(log.stem) != size_of(log) and _has_ended(log):
                history, size = History(root), size_of(log)
                history.add(log)
                if not history.is_whole:
                    continue
                history.write()
                added = {**added, log.stem: size}
        kept = {log.stem for log in _rotate(root, [log for log in logs if log.stem in added])}
        added = {name: size for name, size in added.items() if name in kept}
        if added != before:
            write_text(root / HISTORY / "logs.json", json.dumps(added), flush=False)


def _rotate(root: Path, logs: Sequence[Path]) -> Iterator[Path]:
    """Remove the logs of all but the latest runs, Snakemake's too; yield those that stay."""
    total = 0
    for age, log in enumerate(reversed(logs)):
        total += size_of(log)
        if age < LATEST or (age < RUNS and total <= KEPT_BYTES):
            yield log
            continue
        for path in log.parent.glob(f"{log.stem}.*jsonl"):
            remove_file(path)
        remove_tree(root / LOGS / log.stem)


def _has_ended(log: Path) -> bool:
    """Tell whether a run has ended: its log says so, its process is gone, or it is silent for very long."""
    try:
        with log.open("rb") as file:
            first = event_in(file.readline())
            file.seek(max(0, log.stat().st_size - _TAIL))
            last = event_in(file.read().rstrip(b"\n").rpartition(b"\n")[2])
        silent = time.time() - log.stat().st_mtime
    except OSError:
        return False
    if last and last["event"] == "ran":
        return True
    if first and first.get("host") == platform.node():
        process = log.stem.rpartition("-")[2]
        return not (process.isdecimal() and is_at_work(int(process), first.get("started")))
    return silent > SILENT_SECONDS
