"""Time and memory that frames and runs took, by what it went into, and what jobs request therefore.

Renders request what earlier frames of their shot and quality took. Other jobs, and renders before there are
any, request defaults.

A render writes statistics with each picture, and every job appends to the event log of its run. Both are
left out where they are missing or damaged: they inform, and decide no result.

Every process counts its own CPU seconds and those of its children. In the event log frames have theirs, jobs
theirs when they end, and the run those of all its processes. What the frames of a job do not account for went
into starting and ending it; what no job accounts for, into planning and Snakemake. Waiting is apart: wall
time minus CPU seconds divided by threads. Meanwhile other programs had the cores, or the disk was slow, or
not all threads had work.
"""

from __future__ import annotations

import json
import math
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.production.planning.profile import ON_GPU
from pipeline.production.stages import STAGES
from pipeline.production.store.event_log import Event, EventReader
from pipeline.production.store.history import History
from pipeline.production.store.paths import EVENTS
from render.base.work_clock import Timing

if TYPE_CHECKING:
    from pipeline.production.planning.plan import Job, Plan
    from pipeline.production.request.render_request import RenderRequest
    from pipeline.production.store.store import Key


SHARED_STAGES = frozenset(name for name, stage in STAGES.items() if not stage.per_quality)
"""Stages whose files all qualities share, and which take as long at each."""


@dataclass(frozen=True)
class RenderStatistics:
    """Time and memory that the render of one picture took.

    key              key of the raw picture
    seconds          wall time by part of the work, such as `rendering`
    threads          cores that it used
    peak_memory_mib  of its process
    resumed_batches  sample batches from an earlier process, whose seconds are not known
    pixels           of the picture; 0 where it is not known
    cpu_seconds      by part; empty in statistics of earlier versions
    """

    key: Key
    seconds: Mapping[str, float]
    threads: int
    peak_memory_mib: float
    resumed_batches: int = 0
    pixels: int = 0
    cpu_seconds: Mapping[str, float] = field(default_factory=dict)

    def growth(self, pixels: int) -> float:
        """Return the factor, at least 1, by which a picture of so many pixels is larger; 1 if not known."""
        return max(1.0, pixels / self.pixels) if self.pixels else 1.0

    @property
    def cost(self) -> Mapping[str, float]:
        """Core-seconds by part: CPU seconds or, where they were not counted, wall time on all threads."""
        return self.cpu_seconds or {part: taken * self.threads for part, taken in self.seconds.items()}

    @property
    def held_core_seconds(self) -> float:
        """The core-seconds for which the render held its threads, with those in which they waited."""
        return sum(self.seconds.values()) * self.threads


def read_statistics(path: Path) -> RenderStatistics | None:
    """Read the statistics of one picture; None where they are missing or damaged."""
    with suppress(OSError, ValueError, KeyError, TypeError, AttributeError):
        data = json.loads(path.read_text(encoding="utf-8"))
        return RenderStatistics(
            key=str(data["key"]),
            seconds={str(part): float(seconds) for part, seconds in data["seconds"].items()},
            threads=int(data["threads"]),
            peak_memory_mib=float(data["peak_memory_mib"]),
            resumed_batches=int(data.get("resumed_batches", 0)),
            pixels=int(data.get("pixels", 0)),
            cpu_seconds={str(part): float(cpu) for part, cpu in data.get("cpu_seconds", {}).items()},
        )
    return None


def statistics_in(folder: Path) -> Iterator[RenderStatistics]:
    """Yield the readable statistics of a folder."""
    for path in folder.glob("*.json"):
        if (statistics := read_statistics(path)) is not None:
            yield statistics


class LatestTimings:
    """Seconds of every frame made under a root, the last time it was made."""

    def __init__(self, root: Path) -> None:
        self._history = History.of(root)

    def by_stage(
        self, subject: str, shot: str, quality: str, stages: Iterable[str]
    ) -> dict[str, dict[int, float]]:
        """Return seconds by stage and frame, for the stages that have any.

        Runs log pictures under `subject`, a shot or a turntable; meshes perhaps under the shot's own name.
        """
        timed = {}
        for stage in stages:
            made = self._history.stage(stage, subject, quality).made
            if stage in SHARED_STAGES and not made:
                made = self._history.stage(stage, shot, quality).made
            if made:
                timed[stage] = {frame: each.seconds for frame, each in made.items()}
        return timed


def render_seconds(request: RenderRequest, root: Path) -> dict[int, Mapping[str, float]]:
    """Return by frame the seconds of its last render, in parts, where they are known."""
    read = {n: read_statistics(root / request.place("statistics", n)) for n in request.angles}
    return {number: statistics.seconds for number, statistics in read.items() if statistics is not None}


UNMEASURED_MIB = 4096
"""Memory of a job on a farm while nothing is measured: five times that of a film frame of 4 million faces."""

LEAST_MIB = 1024
"""Memory of any job: its Python, its libraries, and Snakemake's two processes beside it."""

_MEMORY_MARGIN = 1.5
"""Factor on the largest memory measured."""

_TIME_MARGIN = 4.0
"""Factor on the longest time measured: nodes differ, and so do frames."""

START_MINUTES = 10
"""Time to begin: compiled kernels, a renderer's first frame, a busy disk."""

UNMEASURED_MINUTES = 240
"""Time limit of a farm's job without measurements; `set-resources` of a profile sets another."""


@dataclass(frozen=True)
class MeasuredResources:
    """The most that earlier renders of a shot at a quality took, more for pictures that were smaller.

    mib      memory of a process, MiB
    seconds  core-seconds of one picture, by wall time: a limit must not end a job that waits
    """

    mib: float
    seconds: float

    @classmethod
    def of(cls, folder: Path, pixels: int) -> MeasuredResources | None:
        """Read the statistics of a folder, for pictures of so many pixels; None while there are none."""
        renders = list(statistics_in(folder))
        if not renders:
            return None
        mib = max(r.peak_memory_mib * r.growth(pixels) for r in renders)
        return cls(mib, max(r.held_core_seconds * r.growth(pixels) for r in renders))

    @property
    def memory_mib(self) -> int:
        """The memory that a render job requests, MiB."""
        return math.ceil(max(LEAST_MIB, _MEMORY_MARGIN * self.mib + LEAST_MIB / 2))

    def minutes(self, frames: int, threads: int) -> int:
        """Return the time limit of a job that renders so many frames on so many threads."""
        return START_MINUTES + math.ceil(_TIME_MARGIN * frames * self.seconds / threads / 60.0)


def measured(
    root: Path, requests: Sequence[RenderRequest], places: Iterable[int] | None = None
) -> dict[int, MeasuredResources]:
    """Return what earlier renders of requests took, by their places, where any were measured under `root`.

    places  of the requests to look at, by default all
    """
    known = {}
    for place in range(len(requests)) if places is None else sorted(places):
        folder = root / requests[place].place("statistics", 0).parent
        width, height = requests[place].quality.rendered_size
        if (resources := MeasuredResources.of(folder, width * height)) is not None:
            known[place] = resources
    return known


def memory_mib(plan: Plan, job: Job) -> int:
    """Return the memory of a job, MiB."""
    measured = plan.measured.get(job.requests[0])
    if job.stage == "render" and measured:
        return measured.memory_mib
    return UNMEASURED_MIB if plan.farm else LEAST_MIB


def minutes(plan: Plan, job: Job, threads: int, frames: int | None = None) -> int | None:
    """Return the time limit of a job on so many threads; None on this machine, where it has none.

    frames  how many it renders, by default all of its own
    """
    measured = plan.measured.get(job.requests[0])
    if job.stage == "render" and measured:
        return measured.minutes(len(job.frames) if frames is None else frames, threads)
    return UNMEASURED_MINUTES if plan.farm else None


def gpus(plan: Plan, job: Job) -> int | None:
    """Return 1 for a job of a farm that renders with CUDA, else None."""
    on_gpu = job.stage == "render" and plan.requests[job.requests[0]].variant == ON_GPU
    return 1 if plan.farm and on_gpu else None


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

_FARM_STAGES = {name for name, stage in STAGES.items() if stage.on_farm}

LABELS = {
    **{name: stage.doing for name, stage in STAGES.items()},
    **{name: f"rendering: {part}" for name, part in _PARTS.items()},
    ANIMATIC: "drawing the animatic",
    STARTING: "starting and ending jobs",
    PLANNING: "planning, Snakemake",
    UNENDED: "planning, Snakemake, jobs that did not end",
}


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
        events = list(EventReader(root / EVENTS / f"{run}.jsonl").new())
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
        made = Counter(str(e["stage"]) for e in events if e["event"] == "frame" and not e["found"])
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


def statistics_of(root: Path, event: Event) -> Path:
    """Return the statistics file of a rendered frame. Raises KeyError for logs that do not name it."""
    shot: str = event["shot"]
    place = Path(event["quality"]) / "statistics"
    homes = (root / "renders" / shot, root / "renders" / "turntable" / shot)
    files = [home / place / f"{shot}.{event['frame']:04d}.json" for home in homes]
    found = [file for file in files if file.exists()]
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
    frames: list[tuple[Event, Timing]] = field(default_factory=list)
    work: float = 0.0

    @property
    def accounted(self) -> Timing:
        """The time of its frames, with the CPU seconds of the rest of its stage."""
        taken = [each for _, each in self.frames]
        return Timing(sum(each.seconds for each in taken), self.work + sum(each.cpu for each in taken))

    @property
    def cpu(self) -> float:
        """CPU seconds, as far as they are known."""
        return max(self.used, self.accounted.cpu)

    @property
    def rest(self) -> Timing:
        """CPU seconds that its frames do not account for; None if its total is unknown."""
        if not self.used:
            return Timing(0.0, 0.0)
        return Timing(self.held - self.accounted.seconds, self.cpu - self.accounted.cpu)


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
            seconds = float(event["seconds"])
            job.frames.append((event, Timing(seconds, float(event.get("cpu", seconds * job.threads)))))
        elif what == "work":
            job.work += float(event["cpu"])
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


def _parts(root: Path, job: _Job) -> Iterator[tuple[str, Timing]]:
    """Yield what the time of a job's frames, and of the rest of its stage, went into."""
    yield job.stage, Timing(0.0, job.work)
    for event, taken in job.frames:
        stage = str(event["stage"])
        statistics = None
        if stage == "render" and not event["found"] and "quality" in event:
            statistics = read_statistics(statistics_of(root, event))
        if statistics is None or not sum(statistics.seconds.values()):
            yield stage, taken
            continue
        seconds, cost = statistics.seconds, statistics.cost
        for part in seconds:
            shares = (each.get(part, 0.0) / max(sum(each.values()), 1e-9) for each in (seconds, cost))
            parts = (whole * share for whole, share in zip(taken, shares, strict=True))
            yield part if part in LABELS else "rendering", Timing(*parts)
