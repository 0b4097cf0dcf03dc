"""The forecast of a plan, estimates of it, and the time that a run still takes.

A forecast is the frames that a run makes, as far as known before cameras are framed. Time is estimated from
what earlier frames took, disk space from how large they became.

The time left goes by CPU seconds. A frame that is not made yet counts as those of its stage and shot took in
this run. Until there are any, it counts as in earlier runs, as those of other shots in this one, or as
typical. The time left is to the time so far as the work left is to the work done: other programs are taken
to leave as much of the machine as they did.
"""

from __future__ import annotations

import math
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import Any

from flowsculpt.pipeline.frames import FrameRange
from flowsculpt.pipeline.plugin import plugins
from flowsculpt.pipeline.production.planning.frame_states import KnownPictures
from flowsculpt.pipeline.production.planning.plan import Job, Plan
from flowsculpt.pipeline.production.planning.timings import SHARED_STAGES, statistics_in
from flowsculpt.pipeline.production.request.lookup import QualityName, pixels
from flowsculpt.pipeline.production.request.render_request import FORMS, RenderRequest
from flowsculpt.pipeline.production.store.event_log import Event
from flowsculpt.pipeline.production.store.history import History
from flowsculpt.pipeline.production.store.paths import RENDERS
from flowsculpt.pipeline.production.store.store import Store
from flowsculpt.render.base.plural import plural
from flowsculpt.render.scene.render_quality import DEFAULT_QUALITY, QUALITIES, Quality

_KINDS = {"render": "raw", "finish": "frame", **{form: form for form in FORMS}}
"""Kinds of files by the stage that makes them, of pictures one by one."""


@dataclass(frozen=True)
class Forecast:
    """A plan without the frames that its jobs will find.

    plan      with the jobs that make something, or perhaps do
    unframed  frames by stage that are made only if their camera moves
    """

    plan: Plan
    unframed: Mapping[str, tuple[int, ...]]

    @classmethod
    def of(cls, plan: Plan, store: Store) -> Forecast:
        """Return the forecast of a plan. Frames that are made again by force are all made."""
        known: dict[int, KnownPictures] = {}
        unframed: defaultdict[str, list[int]] = defaultdict(list)
        jobs = []
        for job in plan.jobs:
            place = job.requests[0]
            if job.stage in _KINDS and job.stage not in plan.force:
                if place not in known:
                    request = plan.requests[place]
                    known[place] = KnownPictures(request, store, request.requested)
                if not known[place].is_framed:
                    held = {n: known[place].holds(_KINDS[job.stage], n) for n in job.frames}
                    unframed[job.stage] += [n for n, is_held in held.items() if is_held is None]
                    job = replace(job, frames=FrameRange(n for n, is_held in held.items() if not is_held))
            if job.frames:
                jobs.append(job)
        return cls(replace(plan, jobs=tuple(jobs)), {stage: tuple(n) for stage, n in unframed.items() if n})

    @cached_property
    def certain(self) -> Mapping[str, int]:
        """The number of frames by stage that are made for certain."""
        counts = self.plan.frame_counts()
        return {stage: n for stage in counts if (n := counts[stage] - len(self.unframed.get(stage, ())))}


_FRAMES = 100
"""The most frames of one kind that are read."""

TYPICAL_LIGHT, TYPICAL_FEATURES = 1.8e-6, 5.6e-7
"""Core-seconds for a sample of light, and of features, of a pixel: A010_cube at final, on an AMD EPYC."""

TYPICAL = {"simulate": 0.08, "smooth_normals": 0.02, "frame_camera": 0.005}
"""CPU seconds of a frame of the shots of `shots/`, for stages that make no pictures."""

TYPICAL_OF_PIXELS = {"finish": 5e-6, "assemble": 2e-7, "film": 2e-7}
"""CPU seconds of a pixel of theirs at draft; stills take TYPICAL_OF_STILLS."""

TYPICAL_OF_STILLS = 1e-6

_FOLDERS = {"simulate": "meshes", "smooth_normals": "normals", "render": "raw", "finish": "frames"}


@dataclass(frozen=True)
class Sample:
    """The mean core-seconds of measured frames.

    seconds  core-seconds of one frame: CPU seconds or, of earlier versions, wall time on all threads
    frames   how many were measured
    source   the shot and quality they are from, such as `A010_cube at draft`
    """

    seconds: float
    frames: int
    source: str


class MeanTimings:
    """Mean core-seconds and bytes of the frames made under a root."""

    def __init__(self, root: Path) -> None:
        self._root = root
        self._renders: dict[Path, list[tuple[float, float]]] = {}

    def seconds(self, stage: str, shot: str, quality: str, size: int) -> Sample | None:
        """Return the mean core-seconds of a frame of `size` pixels; None where nothing was measured.

        Falls back to other shots and qualities, scaled by pixels, and rendering by samples too.
        """
        if stage == "render":
            return self._render_seconds(shot, quality, size)
        history = self._history
        places = [(shot, quality)]
        if not history.stage(stage, shot, quality).made:
            places = sorted(history.places(), key=lambda place: (place[0] != shot, place[1] != quality))
        for name, at in places:
            if made := history.stage(stage, name, at).made.values():
                known = at if QualityName.of(at).base in QUALITIES else DEFAULT_QUALITY
                scale = 1.0 if stage in SHARED_STAGES else pixels(quality) / pixels(known)
                taken = sum(each.cost for each in made)
                return Sample(scale * taken / len(made), len(made), f"{name} at {at}")
        return None

    def expected(self, stage: str, request: RenderRequest) -> float:
        """Return the core-seconds of a frame of a request: measured or, where nothing was, typical."""
        width, height = request.pictures.quality.rendered_size
        sample = self.seconds(stage, *shot_and_quality(request, stage), width * height)
        return typical_seconds(stage, request.pictures.quality) if sample is None else sample.seconds

    def _render_seconds(self, shot: str, quality: str, size: int) -> Sample | None:
        for name, at in ((shot, quality), (shot, "*"), ("*", quality), ("*", "*")):
            for folder in _statistics_folders(self._root, name, at):
                if folder not in self._renders:
                    self._renders[folder] = list(_core_seconds(folder))
                taken, known = self._renders[folder], folder.parent.name
                if taken:
                    more = samples(quality) / samples(known)
                    mean = sum(more * light + rest for light, rest in taken) / len(taken)
                    return Sample(size * mean, len(taken), f"{folder.parents[1].name} at {known}")
        return None

    def bytes(self, stage: str, shot: str, quality: str) -> float | None:
        """Return the mean size of the file that a stage makes of a frame; None where none was made."""
        kind = _FOLDERS.get(stage)
        if kind is None:
            return 0.0
        home = self._root / "renders"
        if stage in SHARED_STAGES:
            own = _mean_size(home, f"{shot}/{kind}/*")
            return _mean_size(home, f"*/{kind}/*") if own is None else own
        for pattern in (f"{shot}/{quality}", f"*/{quality}", "*/*"):
            folder = next((file.parent for file in home.glob(f"{pattern}/{kind}/*.exr")), None)
            if folder is not None and (size := _mean_size(folder, "*.exr")) is not None:
                return size * pixels(quality) / pixels(folder.parent.name)
        return None

    @cached_property
    def _history(self) -> History:
        return History.of(self._root)


def samples(quality: str) -> float:
    """Return the samples per pixel that a typical frame of a quality takes."""
    return QUALITIES[QualityName.of(quality).base].typical_samples


def typical_seconds(stage: str, quality: Quality) -> float:
    """Return the core-seconds of a frame of the shots of `shots/`, for a root where none was made yet."""
    width, height = quality.rendered_size
    if stage == "render":
        light, features = quality.typical_samples, quality.auxiliary_samples
        return width * height * (TYPICAL_LIGHT * light + TYPICAL_FEATURES * features)
    return TYPICAL.get(stage) or width * height * TYPICAL_OF_PIXELS.get(stage, TYPICAL_OF_STILLS)


def _statistics_folders(root: Path, name: str, quality: str) -> Iterator[Path]:
    """Yield the folders of render statistics of built-in qualities."""
    for home in (root / RENDERS, *(root / RENDERS / kind for kind in plugins().frame_sources)):
        for folder in sorted(home.glob(f"{name}/{quality}/statistics")):
            if QualityName.of(folder.parent.name).base in QUALITIES:
                yield folder


def _core_seconds(folder: Path) -> Iterator[tuple[float, float]]:
    """Yield core-seconds of a pixel, of light and of all else, of frames that one process rendered whole."""
    for statistics in islice(statistics_in(folder), _FRAMES):
        if not statistics.resumed_batches and "rendering" in statistics.seconds:
            light = statistics.cost["rendering"]
            size = statistics.pixels or pixels(folder.parent.name)
            yield light / size, (sum(statistics.cost.values()) - light) / size


def _mean_size(folder: Path, pattern: str) -> float | None:
    sizes = []
    for file in islice(folder.glob(pattern), _FRAMES):
        with suppress(OSError):
            sizes.append(file.stat().st_size)
    return sum(sizes) / len(sizes) if sizes else None


@dataclass(frozen=True)
class Estimate:
    """Time and disk space that a plan will take.

    seconds       wall-clock time, with `cores` for this run alone
    core_seconds  by stage
    unmeasured    stages that are left out, since nothing of them was measured
    by            the frames that the time of rendering was estimated from; empty if nothing is rendered
    bytes         growth of the store; None where the size of a file is not known
    free          bytes free on the disk
    """

    seconds: float
    cores: int
    core_seconds: Mapping[str, float]
    unmeasured: tuple[str, ...]
    by: str
    bytes: float | None
    free: int

    @property
    def fits(self) -> bool:
        """True if the disk has room for it, as far as is known."""
        return self.bytes is None or self.bytes < self.free

    def as_data(self) -> dict[str, Any]:
        return {
            "seconds": round(self.seconds, 1),
            "cores": self.cores,
            "core_seconds": {stage: round(taken, 1) for stage, taken in self.core_seconds.items()},
            "unmeasured": list(self.unmeasured),
            "by": self.by,
            "bytes": None if self.bytes is None else round(self.bytes),
            "free_bytes": self.free,
        }


def estimate(plan: Plan, root: Path, cores: int) -> Estimate:
    """Estimate a plan from what was measured under `root`."""
    timings = MeanTimings(root)
    by_stage: dict[str, float] = defaultdict(float)
    chains: dict[int, float] = defaultdict(float)
    unmeasured: dict[str, None] = {}
    render: Sample | None = None
    size: float | None = 0.0
    for job in plan.jobs:
        request = plan.requests[job.requests[0]]
        shot, quality = shot_and_quality(request, job.stage)
        width, height = request.pictures.quality.rendered_size
        sample = timings.seconds(job.stage, shot, quality, width * height)
        if sample is None:
            unmeasured[job.stage] = None
        else:
            render = sample if job.stage == "render" else render
            taken = sample.seconds * len(job.frames)
            by_stage[job.stage] += taken
            if job.stage in SHARED_STAGES:
                chains[job.requests[0]] += taken
        each = timings.bytes(job.stage, shot, quality)
        size = None if size is None or each is None else size + each * len(job.frames)
    return Estimate(
        seconds=_wall_clock(by_stage, chains, cores),
        cores=cores,
        core_seconds=dict(by_stage),
        unmeasured=tuple(unmeasured),
        by="" if render is None else f"{plural(render.frames, 'frame')} of {render.source}",
        bytes=size,
        free=Store(root).free_bytes(),
    )


def _wall_clock(by_stage: Mapping[str, float], chains: Mapping[int, float], cores: int) -> float:
    """Return seconds. Shots simulate side by side, a core each; one core cuts a film; all else is shared."""
    motion, film = sum(chains.values()), by_stage.get("film", 0.0)
    rest = sum(by_stage.values()) - motion - film
    return max(max(chains.values(), default=0.0), motion / cores) + rest / cores + film


def shot_and_quality(request: RenderRequest, stage: str) -> tuple[str, str]:
    """Return the name of the folder of a request's shot, as a stage has it, and its quality."""
    name = request.name
    if (kind := request.frame_source.kind) and stage not in SHARED_STAGES:
        name = request.folders.home.relative_to(RENDERS / kind).as_posix()
    return name, request.quality_name


SMOOTHING = 8.0
"""Seconds in which the end that is shown comes closer by two thirds to the one that is estimated."""


@dataclass(eq=False)
class _Work:
    """The frames that a run makes of one stage of one shot and quality.

    guess    CPU seconds of a frame, by earlier runs; None where these made none
    typical  CPU seconds of a typical one
    total    how many are to be made
    settled  those that are made or failed
    made     how many were computed in this run
    cpu      their CPU seconds
    """

    stage: str
    guess: float | None
    typical: float
    total: int = 0
    settled: set[int] = field(default_factory=set)
    made: int = 0
    cpu: float = 0.0


class TimeLeft:
    """Estimates the time that a run of a plan still takes.

    root   where earlier runs left their timings
    clock  returns seconds
    """

    def __init__(self, plan: Plan, root: Path, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._jobs: dict[str, _Work] = {}
        self._began: float | None = None
        self._end: float | None = None
        self._looked = 0.0
        timings, works = MeanTimings(root), dict[tuple[str, str, str], _Work]()
        for job in plan.jobs:
            place = job.stage, *shot_and_quality(plan.requests[job.requests[0]], job.stage)
            if place not in works:
                works[place] = _new_work(plan, job, timings)
            works[place].total += len(job.frames)
            self._jobs[job.name] = works[place]
        self._works = list(works.values())
        stages = [work.stage for work in self._works]
        self._decisive = "render" if "render" in stages else next(iter(stages), "")

    def note(self, event: Event) -> None:
        """Take an event of the run into account."""
        if event["event"] == "begin" and self._began is None:
            self._began = self._clock()
        work, frame = self._jobs.get(event["job"]), event.get("frame")
        if work is None or frame is None or event["event"] not in ("frame", "fail"):
            return
        work.settled.add(frame)
        if event["event"] == "frame" and not event["found"] and "cpu" in event:
            work.made += 1
            work.cpu += float(event["cpu"])

    def share(self, under_way: Mapping[str, float]) -> float | None:
        """Return the share of the work that is done, above 0; None before the first frame is rendered.

        under_way  by job, how many frames' worth it has done of frames that are not finished
        """
        if not any(work.made for work in self._works if work.stage == self._decisive):
            return None
        parts: defaultdict[_Work, float] = defaultdict(float)
        for name, part in under_way.items():
            if name in self._jobs:
                parts[self._jobs[name]] += part
        done = whole = 0.0
        for work in self._works:
            cost = self._cost(work)
            done += cost * min(len(work.settled) + parts[work], work.total)
            whole += cost * work.total
        return done / whole if done else None

    def seconds(self, share: float) -> float:
        """Return the time left once a share of the work is done, smoothed over the last seconds."""
        now = self._clock()
        began = now if self._began is None else self._began
        end = now + (now - began) * (1.0 - share) / share
        if self._end is None:
            self._end = end
        self._end += (end - self._end) * (1.0 - math.exp(-(now - self._looked) / SMOOTHING))
        self._looked = now
        return max(0.0, self._end - now)

    def _cost(self, work: _Work) -> float:
        """Return the CPU seconds that a frame takes."""
        if work.made:
            return work.cpu / work.made
        if work.guess is not None:
            return work.guess
        alike = [other for other in self._works if other.stage == work.stage and other.made]
        if alike:
            return sum(other.cpu for other in alike) / sum(other.made for other in alike)
        return work.typical


def _new_work(plan: Plan, job: Job, timings: MeanTimings) -> _Work:
    request, stage = plan.requests[job.requests[0]], job.stage
    width, height = request.pictures.quality.rendered_size
    guess = timings.seconds(stage, *shot_and_quality(request, stage), width * height)
    typical = typical_seconds(stage, request.pictures.quality)
    return _Work(stage, None if guess is None else guess.seconds, typical)
