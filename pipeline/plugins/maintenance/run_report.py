"""CPU seconds of a run by stage, by part of rendering, and the rest.

Every process counts its own CPU seconds and those of its children. In the event log frames have theirs, jobs
theirs when they end, and the run those of all its processes. What the frames of a job do not account for
went into starting and ending it; what no job accounts for, into planning and Snakemake.

Waiting is apart: wall time minus CPU seconds divided by threads. Meanwhile other programs had the cores, or
the disk was slow, or not all threads had work.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from flowsculpt import MissingInputError
from flowsculpt.api import RunObserver
from flowsculpt.api.frames import PipelineStage, Runs
from flowsculpt.api.options import Common

Event = Mapping[str, Any]

STARTING, PLANNING, UNENDED = "starting", "planning", "unended"
"""CPU seconds that no frame accounts for. UNENDED takes the place of PLANNING where jobs were killed or
interrupted, whose own are not known."""

ANIMATIC = "animatic"
"""Stands for the stage, and the job, of the process that shows the first pictures of a run."""

_PARTS = {
    "preparing": "preparing",
    "building": "building scenes",
    "rendering": "light and auxiliary AOVs",
    "reading and writing": "reading and writing",
}
"""Parts of rendering, as statistics name them."""

_FARM_STAGES = {name for name, stage in PipelineStage.all().items() if stage.on_farm}

LABELS = {
    **{name: stage.doing for name, stage in PipelineStage.all().items()},
    **{name: f"rendering: {part}" for name, part in _PARTS.items()},
    ANIMATIC: "drawing the animatic",
    STARTING: "starting and ending jobs",
    PLANNING: "planning, Snakemake",
    UNENDED: "planning, Snakemake, jobs that did not end",
}


class Spent(NamedTuple):
    """Wall time and CPU seconds."""

    seconds: float
    cpu: float


@dataclass(frozen=True)
class RunReport:
    """The time of one run, by what it went into (see LABELS).

    seconds      wall time
    cores        of this machine, for the run
    on_farm      True if the nodes of a farm did its jobs
    is_counted   False for logs of earlier versions, which hold no CPU seconds: `cpu_seconds` are then wall
                 time on all threads, the most that they can have been
    cpu_seconds  by what they went into
    waiting      seconds, by what jobs did meanwhile; empty if not `is_counted`
    frames       made, by stage
    """

    run: str
    seconds: float
    cores: int
    on_farm: bool
    is_counted: bool
    cpu_seconds: Mapping[str, float]
    waiting: Mapping[str, float]
    frames: Mapping[str, int]

    @classmethod
    def of(cls, root: Path, run: str, cores: int) -> RunReport:
        """Return the report of a run; `cores` is used if its log does not name them."""
        events = list(Runs(root).reader(run).new())
        about = next((event for event in events if event["event"] == "run"), {})
        cores, on_farm = int(about.get("cores", cores)), bool(about.get("farm"))
        times = [float(event["time"]) for event in events]
        seconds = max(times, default=0.0) - min(times, default=0.0)
        is_counted = "farm" in about or any("cpu" in event for event in events)
        jobs = _jobs(events, max(times, default=0.0), is_counted)
        spent: dict[str, float] = defaultdict(float)
        waiting: dict[str, float] = defaultdict(float)
        for job in jobs.values():
            for what, taken in (*_parts(root, job), (STARTING, job.rest)):
                spent[what] += taken.cpu
                waiting[what] += taken.seconds - taken.cpu / job.threads
        whole = _cpu_of_run(events) if is_counted else seconds * cores
        if whole is not None:
            ours = [job for job in jobs.values() if not (on_farm and job.stage in _FARM_STAGES)]
            name = PLANNING if all(job.began is None for job in ours) else UNENDED
            spent[name] = max(0.0, whole - sum(job.cpu for job in ours))
        waiting = {what: waited for what, waited in waiting.items() if is_counted and waited > 0.0}
        made = Counter(
            str(e["stage"]) for e in events if e["event"] == "frame" and "stage" in e and not e.get("found")
        )
        return cls(run, seconds, cores, on_farm, is_counted, dict(spent), waiting, dict(made))

    @property
    def shares(self) -> dict[str, float]:
        """Fractions of all CPU seconds of the run, in the order of LABELS."""
        whole = max(sum(self.cpu_seconds.values()), 1e-9)
        return {
            what: self.cpu_seconds[what] / whole for what in LABELS if self.cpu_seconds.get(what, 0.0) > 0.0
        }

    @property
    def share_of_cores(self) -> float | None:
        """The CPU seconds over those that the cores had; None where that is not known, and for a farm."""
        if self.on_farm or not self.is_counted or not self.seconds:
            return None
        return sum(self.cpu_seconds.values()) / (self.seconds * self.cores)

    def as_data(self) -> dict[str, Any]:
        return {
            "run": self.run,
            "seconds": round(self.seconds, 3),
            "cores": self.cores,
            "on_farm": self.on_farm,
            "is_counted": self.is_counted,
            "cpu_seconds": {what: round(taken, 3) for what, taken in self.cpu_seconds.items()},
            "waiting_seconds": {what: round(waited, 3) for what, waited in self.waiting.items()},
            "frames": dict(self.frames),
        }

    def in_brief(self) -> str:
        """Return the largest parts, in one line."""
        largest = sorted(self.shares.items(), key=lambda part: -part[1])[:4]
        return ", ".join(f"{LABELS[what]} {share:.0%}" for what, share in largest)


def _statistics_of(root: Path, event: Event) -> Path:
    """Return the place of a frame's statistics. Raises KeyError for logs that do not name it."""
    shot: str = event["shot"]
    place = Path(event["quality"]) / "statistics"
    homes = (Path("renders", shot), Path("renders", "turntable", shot))
    files = [home / place / f"{shot}.{event['frame']:04d}.json" for home in homes]
    found = [file for file in files if (root / file).exists()]
    return found[0] if found else files[0]


@dataclass
class _Job:
    """A job of a run.

    began      when, if it has not ended
    held       seconds from its beginning to its end
    used       CPU seconds of its processes that have ended
    frames     its frames with the time that each took
    work       CPU seconds of its stage that belong to none of them
    """

    stage: str
    threads: int = 1
    began: float | None = None
    held: float = 0.0
    used: float = 0.0
    frames: list[tuple[Event, Spent]] = field(default_factory=list)
    work: float = 0.0

    @property
    def accounted(self) -> Spent:
        """The time of its frames, with the CPU seconds of the rest of its stage."""
        taken = [each for _, each in self.frames]
        return Spent(sum(each.seconds for each in taken), self.work + sum(each.cpu for each in taken))

    @property
    def cpu(self) -> float:
        """CPU seconds, as far as they are known."""
        return max(self.used, self.accounted.cpu)

    @property
    def rest(self) -> Spent:
        """CPU seconds that its frames do not account for; None if its total is unknown."""
        if not self.used:
            return Spent(0.0, 0.0)
        return Spent(self.held - self.accounted.seconds, self.cpu - self.accounted.cpu)


def _jobs(events: Iterable[Event], last: float, is_counted: bool) -> dict[str, _Job]:
    """Return the jobs of a log by name; `last` is the time at which it ends.

    Where CPU seconds were not counted, jobs and frames used all of their threads all the time.
    """
    jobs: dict[str, _Job] = {}
    for event in events:
        what, name = event["event"], event["job"]
        if what not in ("begin", "frame", "work", "renewed", "end"):
            continue
        job = jobs.setdefault(name, _Job(str(event.get("stage", name))))
        if what == "begin":
            job.threads = int(event.get("threads", 1))
            job.began = float(event["time"]) if job.began is None else job.began
        elif what == "frame":
            seconds = float(event.get("seconds", 0.0))
            job.frames.append((event, Spent(seconds, float(event.get("cpu", seconds * job.threads)))))
        elif what == "work":
            job.work += float(event.get("cpu", 0.0))
        else:
            job.used += float(event.get("cpu", 0.0))
            if what == "end" and job.began is not None:
                job.held, job.began = job.held + float(event["time"]) - job.began, None
    for job in jobs.values():
        job.held += 0.0 if job.began is None else last - job.began
        job.used = job.used if is_counted else job.held * job.threads
    return jobs


def _cpu_of_run(events: Iterable[Event]) -> float | None:
    """Return the CPU seconds of the process that ran the jobs and of its children; None if it was killed."""
    return next((float(event["cpu"]) for event in events if event["event"] == "ran" and "cpu" in event), None)


def _parts(root: Path, job: _Job) -> Iterator[tuple[str, Spent]]:
    """Yield what the time of a job's frames, and of the rest of its stage, went into."""
    yield job.stage, Spent(0.0, job.work)
    for event, taken in job.frames:
        stage = job.stage
        statistics = None
        if stage == "render" and not event.get("found") and "quality" in event:
            statistics = Runs(root).statistics(_statistics_of(root, event))
        if statistics is None or not sum(statistics.seconds.values()):
            yield stage, taken
            continue
        seconds, cost = statistics.seconds, statistics.cost
        for part in seconds:
            shares = (each.get(part, 0.0) / max(sum(each.values()), 1e-9) for each in (seconds, cost))
            parts = (whole * share for whole, share in zip(taken, shares, strict=True))
            yield part if part in LABELS else "rendering", Spent(*parts)


def named_run(root: Path, name: str | None) -> str:
    """Return a run by its name, or the last. Raises MissingInputError where there is none."""
    runs = Runs(root)
    known = runs.logged()
    if name is None and known:
        return known[-1]
    if name in known:
        return str(name)
    if not known:
        raise MissingInputError(f"{runs.folder}: no runs logged yet; flowsculpt render writes a log")
    raise MissingInputError(f"{runs.folder}: run {name!r} not found; the latest are {', '.join(known[-3:])}")


class RunSummary(RunObserver):
    """Says where the CPU time of a run went, in one line; nothing where that is not known."""

    def summary(self, common: Common, run: str) -> str:
        words = RunReport.of(common.root, run, common.cores).in_brief()
        return f"Where the CPU time went: {words}. flowsculpt report says more." if words else ""
