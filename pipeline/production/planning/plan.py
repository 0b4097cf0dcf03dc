"""The plan of a run: render requests and the jobs that make what they lack, frozen to a file.

A job is a batch of frames of one stage. Its output is a done-file, by which Snakemake sees that it is done
and which lists the keys of what it made, or a movie. A plan does not say which jobs wait for which: the
Snakefile says which stage reads which, and Snakemake walks that graph. The frozen file is all that Snakemake
and the tasks read, so shots may be edited while a run goes on.
"""

from __future__ import annotations

import json
import os
import platform
import time
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import datetime, timedelta
from functools import cached_property
from pathlib import Path
from typing import ClassVar

from flowsculpt.pipeline.errors import FlowsculptError
from flowsculpt.pipeline.frames import FrameRange
from flowsculpt.pipeline.plugin import plugins
from flowsculpt.pipeline.production.planning.profile import Share
from flowsculpt.pipeline.production.planning.timings import (
    LEAST_MIB,
    SHARED_STAGES,
    UNMEASURED_MIB,
    UNMEASURED_MINUTES,
    MeasuredResources,
    RenderStatistics,
    read_statistics,
)
from flowsculpt.pipeline.production.request.edit import Edit
from flowsculpt.pipeline.production.request.lookup import QualityName
from flowsculpt.pipeline.production.request.render_request import RenderRequest
from flowsculpt.pipeline.production.stages import STAGES
from flowsculpt.pipeline.production.store.event_log import RUNS, EventLog, EventReader, logs_of
from flowsculpt.pipeline.production.store.history import History
from flowsculpt.pipeline.production.store.locks import Locks
from flowsculpt.pipeline.production.store.paths import DONE, EVENTS, LOGS, PLANS, RENDERS
from flowsculpt.pipeline.production.store.remote_store import remote_stores, store_url
from flowsculpt.pipeline.production.store.shared_kernels import send_kernels
from flowsculpt.pipeline.production.store.store import Key, Store
from flowsculpt.render.base.atomic_write import write_text
from flowsculpt.render.base.root_files import remove_file, remove_tree, set_time
from flowsculpt.render.base.serialise import NOT_PLAIN, from_plain, to_plain
from flowsculpt.render.base.state_files import UNUSABLE, read_state, usable


def done_file(stage: str, shot: str, quality: str, frames: Sequence[int], key: str) -> str:
    """Return where a job says that it is done. The name holds the key, so an edited shot asks for another."""
    home = f"{DONE}/{shot}/{quality}" if STAGES[stage].per_quality else f"{DONE}/{shot}"
    return f"{home}/{stage}/{min(frames):04d}-{max(frames):04d}.{key}"


def movie_record(movie: str) -> str:
    """Return the file, relative to the root, that holds the key by which Snakemake knows a movie."""
    return f"{DONE}/{movie}.key"


def write_manifest(path: Path, kind: str, keys: Sequence[Key]) -> None:
    """Write a done-file: the kind and the keys of what its job has made."""
    write_text(path, json.dumps({"kind": kind, "keys": list(keys)}))


def check_done_files(plan: Plan, store: Store) -> None:
    """Have done-files tell the truth: what was evicted from the store is not done, what is in it is.

    All get the same old time, for Snakemake runs jobs again whose inputs are newer than their outputs.
    """
    for job in plan.jobs:
        if STAGES[job.stage].makes == "movie":
            continue
        path = store.root / job.output
        if job.output in plan.manifests and not path.exists():
            write_manifest(path, *plan.manifests[job.output])
        # Keys of pictures are unknown until their cameras are known.
        is_motion = not STAGES[job.stage].per_quality
        if job.output in plan.manifests or (is_motion and _is_true(job, path, store)):
            set_time(path, 1.0)
        else:
            remove_file(path)


def _is_true(job: Job, path: Path, store: Store) -> bool:
    """Tell whether a done-file names all that its job makes, and the store holds it."""
    made = 1 if job.stage == "frame_camera" else len(job.frames)
    kind, keys = read_state(path, lambda manifest: (manifest["kind"], list(manifest["keys"]))) or ("", [])
    return len(keys) == made and bool(usable(lambda: all(store.holds(kind, key) for key in keys)))


TIME_FORMAT = "%Y%m%d-%H%M%S"
"""The format of times in names of plans. Names in alphabetical order are in the order of their times."""


@dataclass(frozen=True)
class Job:
    """Frames of one stage that one process makes.

    stage     the stage, and the rule of the Snakefile that runs it
    requests  places among the plan's render requests of those that need it; it works for the first, the film
              for all
    frames    the numbers it makes, in the order in which it makes them
    reads     the numbers it reads of the stage before, None for those that it makes; a film reads all of its
              requests
    meshes    the mesh frames that it reads besides these
    key       the digest, 16 hex digits, of the keys of what it makes
    output    the file by which Snakemake sees that it is done, relative to the root
    present   true if the store holds all that it makes
    seconds   the time that a farm's node is expected to take for its frames; 0 where no time is expected
    """

    name: str
    stage: str
    requests: tuple[int, ...]
    frames: FrameRange
    reads: tuple[int, ...] | None = None
    meshes: tuple[int, ...] = ()
    key: str = ""
    output: str = ""
    threads: int = 1
    present: bool = False
    seconds: float = 0.0

    @property
    def is_local(self) -> bool:
        """True if it runs where the plan was made, even if other jobs go to a farm."""
        return not STAGES[self.stage].on_farm


@dataclass(frozen=True)
class Link:
    """A file in the store that should be visible at `target`, relative to the root."""

    kind: str
    key: Key
    target: str


@dataclass(frozen=True)
class Plan:
    """The render requests and the jobs of one run.

    film      the edit of the film, if it makes one
    goals     the stages whose outputs are asked for, each with the place of its request
    links     files of the store and where they are shown
    targets   the files that the user asked for
    notes     lines to tell the user
    spared    frames by stage that several requests need and one job makes
    manifests what the jobs that are present have made: the kind and the keys, by output
    measured  by place of a request, the memory (MiB) and the core-seconds that its pictures took before
    force     stages whose jobs ignore stored results and replace them
    farm      whether jobs run on a farm's nodes
    host      the machine that made the plan
    versions  those that keys hold, of stages and packages, where the plan was made
    kernels   names the compiled kernels that workers may take from the remote store: see `RemoteStores`
    """

    requests: tuple[RenderRequest, ...]
    film: Edit | None
    jobs: tuple[Job, ...]
    links: tuple[Link, ...] = field(default=(), metadata=NOT_PLAIN)
    targets: tuple[str, ...] = field(default=(), metadata=NOT_PLAIN)
    goals: tuple[tuple[int, str], ...] = ()
    notes: tuple[str, ...] = ()
    spared: Mapping[str, int] = field(default_factory=dict, metadata=NOT_PLAIN)
    manifests: Mapping[str, tuple[str, list[Key]]] = field(default_factory=dict, metadata=NOT_PLAIN)
    measured: Mapping[int, MeasuredResources] = field(default_factory=dict)
    force: tuple[str, ...] = ()
    farm: bool = False
    name: str = field(default_factory=lambda: f"{time.strftime(TIME_FORMAT)}-{os.getpid()}")
    host: str = field(default_factory=platform.node)
    versions: Mapping[str, str] = field(default_factory=lambda: Plan.versions_here())
    kernels: str = ""

    def named_last(self, root: Path) -> Plan:
        """Return the plan under a name after those of all runs under `root`, whatever the clock was set to.

        Histories and reports sort runs by their names.
        """
        latest = max((log.stem for log in logs_of(root)), default="")
        if self.name > latest:
            return self
        try:
            when = datetime.strptime(latest[:15], TIME_FORMAT) + timedelta(seconds=1)
        except ValueError:  # of somebody else
            return self
        return replace(self, name=f"{when.strftime(TIME_FORMAT)}-{os.getpid()}")

    def remote_names(self, store: Store) -> set[tuple[str, Key]]:
        """Return kind and key of the files that the plan shows and only the remote store has."""
        if store.remote is None:
            return set()
        return {(link.kind, link.key) for link in self.links if not store.is_here(link.kind, link.key)}

    def restore_links(self, store: Store) -> int:
        """Show again what the store holds but a folder has lost; return how many links were made."""
        lost = [link for link in self.links if not store.shows(link.kind, link.key, link.target)]
        for link in lost:
            store.link(link.kind, link.key, Path(link.target))
        return len(lost)

    def all_inputs(self, job: Job) -> list[str]:
        """Return the outputs of all jobs that make what a job reads."""
        return [output for stage in STAGES[job.stage].reads for output in self.inputs(job, stage)]

    def inputs(self, job: Job, stage: str) -> list[str]:
        """Return the outputs of the jobs of `stage` that make what a job reads."""
        is_film = job.stage == "film"
        reads_all = is_film or stage == "frame_camera"
        if job.stage == "render" and stage == "simulate":
            reads = set(job.meshes)
        else:
            reads = set(job.frames if job.reads is None else job.reads)
        places = job.requests if is_film else job.requests[:1]
        others = [other for place in places for other in self.jobs_of(place, stage) if other is not job]
        read = [other.output for other in others if reads_all or not reads.isdisjoint(other.frames)]
        return list(dict.fromkeys(read))

    def jobs_of(self, place: int, stage: str) -> Sequence[Job]:
        """Return the jobs of a stage that a request needs."""
        return self._by_stage.get((place, stage), ())

    @cached_property
    def _by_stage(self) -> Mapping[tuple[int, str], Sequence[Job]]:
        jobs: defaultdict[tuple[int, str], list[Job]] = defaultdict(list)
        for job in self.jobs:
            for place in job.requests:
                jobs[place, job.stage].append(job)
        return jobs

    @property
    def outputs(self) -> list[str]:
        """The outputs of the stages that are asked for."""
        jobs = [job for goal in self.goals for job in self.jobs_of(*goal)]
        return list(dict.fromkeys(job.output for job in jobs))

    @property
    def lock_names(self) -> dict[str, str]:
        """The locks of the shots and qualities that are written, each with words for what it is for."""
        names = {}
        whole = {request.source.path for request in self.requests if not request.source.subject}
        for place, request in enumerate(self.requests):
            if request.source.subject and request.source.path in whole:
                continue  # meshes of one of several subjects, which are locked with the whole
            shot = request.name
            stages = {job.stage for job in self.jobs if place in job.requests}
            if not stages:
                continue
            per_quality = any(STAGES[stage].per_quality for stage in stages)
            home = request.home or request.folders.home.relative_to(RENDERS).as_posix()
            quality = request.quality_name if per_quality else "meshes"
            words = f"{shot} at {quality}" if per_quality else f"the meshes of {shot}"
            names[Locks.name(home, quality)] = words
        return names

    @property
    def file(self) -> Path:
        """The frozen plan, relative to the root."""
        return PLANS / f"{self.name}.json"

    @property
    def log_name(self) -> str:
        """The name of the event log that this host writes while the plan runs."""
        here = platform.node()
        return f"{self.name}.jsonl" if here == self.host else f"{self.name}.{here}.jsonl"

    @property
    def raw_places(self) -> Iterator[Path]:
        """Yield the raw pictures of the frames asked for."""
        for target in self.targets:
            home, _, name = target.rpartition("/frames/")
            if home:
                yield Path(home, "raw", name)

    @staticmethod
    def versions_here() -> dict[str, str]:
        """Return the versions that keys hold: of stages (`render's results`), plug-ins and packages."""
        of_plugins = {f"plug-in {plugin.name}": plugin.version for plugin in plugins() if plugin.sources}
        return of_plugins | {
            f"{stage.name}'s results" if part == "version" else part: str(value)
            for stage in STAGES.values()
            for part, value in stage.recipe.items()
            if part != "stage"
        }

    def freeze(self, root: Path) -> Path:
        """Write the plan under `root`; return the file, relative to `root`."""
        self.write(root / self.file)
        return self.file

    def write(self, path: Path) -> None:
        """Write the plan to a file, whole or not at all; upload the compiled kernels that workers need."""
        url = store_url()
        plan = self
        if url is not None:
            plan = replace(self, kernels=send_kernels(remote_stores().opened(url)))
        write_text(path, json.dumps(to_plain(plan)))

    @classmethod
    def thaw(cls, path: Path) -> Plan:
        """Read a frozen plan: all but links, targets and the like, which concern the process that plans."""
        plan = from_plain(cls, json.loads(path.read_text(encoding="utf-8")))
        names = (plan.name, *(job.output for job in plan.jobs), *(r.home or "" for r in plan.requests))
        if any(Path(name).is_absolute() or ".." in Path(name).parts for name in names):
            raise ValueError("a file outside of the root")
        return plan

    def job(self, name: str) -> Job:
        """Return the job of a name; with `:3,17` after it, a job of just these frames.

        Such a part may also be named by its stage alone, `render:3,17`: it is of the plan's first request.
        """
        known, _, frames = name.partition(":")
        if not frames:
            return next(job for job in self.jobs if job.name == known)
        from flowsculpt.render.mitsuba.engine import available_cores  # which takes time to import

        whole, part = (
            next(job for job in self.jobs if known in (job.name, job.stage)),
            FrameRange.parse(frames),
        )
        return replace(whole, name=name, frames=part, output="", threads=available_cores())

    def memory_mib(self, job: Job) -> int:
        """Return the memory of a job, MiB, by what earlier pictures took."""
        if (measured := self._measured_of(job)) is not None:
            return measured.memory_mib
        return UNMEASURED_MIB if self.farm else LEAST_MIB

    def minutes(self, job: Job, threads: int, frames: int | None = None) -> int | None:
        """Return the time limit of a job on so many threads; None on this machine, where it has none.

        frames  how many it renders, by default all of its own
        """
        if (measured := self._measured_of(job)) is not None:
            return measured.minutes(len(job.frames) if frames is None else frames, threads)
        return UNMEASURED_MINUTES if self.farm else None

    def gpus(self, job: Job) -> int | None:
        """Return 1 for a job of a farm that renders with CUDA, else None."""
        on_gpu = job.stage == "render" and self.requests[job.requests[0]].variant == "cuda_ad_rgb"
        return 1 if self.farm and on_gpu else None

    def _measured_of(self, job: Job) -> MeasuredResources | None:
        """Return what earlier renders took, for a job that renders."""
        return self.measured.get(job.requests[0]) if job.stage == "render" else None

    def frame_counts(self) -> Counter[str]:
        """Return how many frames the jobs of each stage make."""
        return Counter(job.stage for job in self.jobs for _ in job.frames)


def with_threads(jobs: Sequence[Job], cores: int, share: Share | None = None) -> list[Job]:
    """Give the simulations, and the renders, as many threads as let all of their kind run side by side; jobs
    of a farm get what `share` says."""
    if share is not None:
        return [replace(job, threads=job.threads if job.is_local else share.threads) for job in jobs]
    many = Counter(job.stage for job in jobs if not job.present)
    threads = {stage: max(1, cores // max(1, many[stage])) for stage in ("simulate", "render")}
    return [replace(job, threads=threads.get(job.stage, job.threads)) for job in jobs]


@dataclass(frozen=True)
class Runs:
    """The runs of a root, each by the name of its plan, which tells when it began.

    MOST  runs whose logs are kept
    """

    root: Path

    MOST: ClassVar[int] = RUNS

    @property
    def folder(self) -> Path:
        """The folder of their event logs."""
        return self.root / EVENTS

    @cached_property
    def _latest(self) -> History:
        return self.history()

    def statistics(self, place: str | Path) -> RenderStatistics | None:
        """Return the statistics of a picture by their file; None where it is missing or damaged."""
        return read_statistics(self.root / place)

    def stage_seconds(
        self, subject: str, shot: str, quality: str, stages: Iterable[str]
    ) -> dict[str, dict[int, float]]:
        """Return seconds by stage and frame, when last made, for the stages that have any.

        Runs log pictures under `subject`, the title of their folders; meshes perhaps under the shot's name.
        """
        timed = {}
        for stage in stages:
            made = self._latest.stage(stage, subject, quality).made
            if stage in SHARED_STAGES and not made:
                made = self._latest.stage(stage, shot, quality).made
            if made:
                timed[stage] = {frame: each.seconds for frame, each in made.items()}
        return timed

    def render_seconds(self, request: RenderRequest) -> dict[int, Mapping[str, float]]:
        """Return by frame the seconds of its last render, in parts, where they are known."""
        read = {n: self.statistics(request.place("statistics", n)) for n in request.angles}
        return {number: statistics.seconds for number, statistics in read.items() if statistics is not None}

    def history(self) -> History:
        """Read the history of frames: which were made, failed, or are being made."""
        return History.of(self.root)

    def logged(self) -> list[str]:
        """Return the names of runs with an event log, the latest last."""
        return [log.stem for log in logs_of(self.root)]

    def planned(self) -> list[str]:
        """Return the names of runs with a plan, the latest last."""
        return sorted(path.stem for path in (self.root / PLANS).glob("*.json"))

    def reader(self, run: str) -> EventReader:
        """Return a reader of the events of a run."""
        return EventReader(self.folder / f"{run}.jsonl")

    def note_work(self, plan: Plan, what: str, cpu: float) -> None:
        """Write into the log of a plan's run that a process took so many CPU seconds for something."""
        EventLog(self.folder / plan.log_name, what).write("work", stage=what, cpu=round(cpu, 4))

    def requests(self, run: str) -> Iterator[RenderRequest]:
        """Yield the requests in the plan of a run, but those that this version cannot read."""
        plan = self.root / PLANS / f"{run}.json"
        for data in read_state(plan, lambda plan: list(plan["requests"])) or ():
            with suppress(*UNUSABLE, FlowsculptError):  # of an earlier version, or damaged
                if QualityName.of(data["quality_name"]).is_known:
                    yield from_plain(RenderRequest, data)

    def forget(self, keep: int) -> None:
        """Remove what is left of all but the last runs, MOST at least; Snakemake finds out what is done.

        Only the holder of the root's lock may call this.
        """
        for folder in (PLANS, EVENTS, LOGS):
            for path in sorted((self.root / folder).glob("2*"))[: -max(keep, self.MOST)]:
                remove_tree(path)
        for folder in (DONE, LOGS / "jobs"):
            for path in (self.root / folder).glob("*"):
                if path.name != "renders":  # by which keys Snakemake knows movies
                    remove_tree(path)
