"""Make a plan: compare keys with the store, backwards from the pictures.

A file whose link shows the right store entry needs nothing; one whose entry is in the store needs the link.
Any other needs a job, and so does each file that this job reads and that is missing.

A request enters as its keys, with stand-ins for those that cameras decide. Jobs are known by the keys of what
they make, so what several requests need is made once.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.production.planning.batches import (
    FEWEST_SPLIT,
    FrameWork,
    SharedFrames,
    batch_sizes,
    batches,
    even_batches,
)
from flowsculpt.pipeline.production.planning.estimate import MeanTimings
from flowsculpt.pipeline.production.planning.plan import Link, Plan, with_threads
from flowsculpt.pipeline.production.planning.planned_jobs import PlanEntry, PlannedJobs
from flowsculpt.pipeline.production.planning.profile import Share
from flowsculpt.pipeline.production.planning.timings import measure_renders
from flowsculpt.pipeline.production.request.edit import Edit
from flowsculpt.pipeline.production.request.keys import PictureKeys
from flowsculpt.pipeline.production.request.render_request import RenderRequest
from flowsculpt.pipeline.production.stages import STAGES
from flowsculpt.pipeline.production.store.store import Key, Store


@dataclass
class Planner:
    """Collects the jobs of several requests, and of the film that they are cut into.

    side_by_side  how many jobs of one request work side by side
    cores         how many of all requests do
    share         what each of them has for itself on a farm's nodes; None where they share this machine
    timings       what frames took, by which those of a farm are divided among its nodes; by default under the
                  root of the store
    force         stages that are made again, each with the time (nanoseconds since the epoch) from which on
                  the store's files count
    comparable    requests differ by settings, as the cells of a wedge do, and may have pictures in common
    """

    store: Store
    side_by_side: int
    cores: int
    notes: Sequence[str] = ()
    share: Share | None = None
    force: Mapping[str, int] = field(default_factory=dict)
    comparable: bool = False
    timings: MeanTimings | None = None
    _entries: dict[RenderRequest, PlanEntry] = field(default_factory=dict)
    _planned: PlannedJobs = field(default_factory=PlannedJobs)
    _waiting: list[Callable[[], None]] = field(default_factory=list)
    _shared_out: defaultdict[str, SharedFrames] = field(default_factory=lambda: defaultdict(SharedFrames))
    _links: dict[str, Link] = field(default_factory=dict)
    _targets: list[str] = field(default_factory=list)
    _goals: list[tuple[int, str]] = field(default_factory=list)
    _cut: Edit | None = None
    _begun: set[str] = field(default_factory=set)
    """Stages with frames that are planned."""

    # What can be asked for

    def simulate(self, request: RenderRequest) -> None:
        """Ask for the mesh frames of a request's shot."""
        entry = self._enter(request, "simulate")
        self._targets += request.places("mesh", request.requested)
        self._meshes(entry, request.requested)

    def surfaces(self, request: RenderRequest) -> None:
        """Ask for what pictures of a request are made from: meshes with normals, and its cameras."""
        entry = self._enter(request, "smooth_normals", "frame_camera")
        self._surfaces(entry, request.requested)
        self._targets += [request.folders.cameras().as_posix(), *request.places("normals", request.requested)]

    def geometry(self, request: RenderRequest) -> None:
        """Ask for what other programs get of a request: its mesh frames, and its cameras."""
        entry = self._enter(request, "simulate", "frame_camera")
        self._meshes(entry, request.requested)
        self._surfaces(entry, ())
        self._targets += [request.folders.cameras().as_posix(), *request.places("mesh", request.requested)]

    def pictures(self, request: RenderRequest) -> None:
        """Ask for the finished frames of a request."""
        entry = self._enter(request, "finish")
        names, frames = entry.names, request.requested
        self._targets += request.places("frame", frames)
        self._show_inputs(entry)
        unfinished = self._absent(entry, "finish", frames)
        read = list(dict.fromkeys([*unfinished, *_union(names[n].window for n in unfinished)]))
        between: list[tuple[str, list[int]]] = []
        for stage in reversed(list(request.manifest.stages)):
            read = self._absent(entry, stage, read)
            between.insert(0, (stage, read))
        unrendered = self._absent(entry, "render", read)
        if unrendered:
            self._surfaces(entry, unrendered)
        for stage, todo in (("render", unrendered), *between, ("finish", unfinished)):
            self._batches(entry, stage, todo)
        if isinstance(names, PictureKeys):
            names.remember()

    def rendered(self, request: RenderRequest) -> None:
        """Ask for the rendered frames of a request with all AOVs, and for what plug-ins make of them."""
        stages = ("render", *request.manifest.stages)
        entry, frames = self._enter(request, *stages), request.requested
        for stage in stages:
            self._targets += request.places(STAGES[stage].shown_as, frames)
            undone = self._absent(entry, stage, frames)
            if undone and stage == "render":
                self._surfaces(entry, undone)
            self._batches(entry, stage, undone)

    def stills(self, request: RenderRequest, form: str) -> None:
        """Ask for the frames of a request as a display shows them."""
        self.pictures(request)
        entry = self._enter(request, form)
        self._targets += request.places(form, request.requested)
        self._batches(entry, form, self._absent(entry, form, request.requested))

    def movie(self, request: RenderRequest) -> None:
        """Ask for the movie of a request, whose frames are there or have been asked for."""
        entry = self._enter(request, "assemble")
        frames = sorted(request.requested)
        key = request.keys.movie([entry.names[n].frame for n in frames])
        self._movie("assemble", [entry], frames, key, request.movie_path)

    def film(self, edit: Edit, requests: Sequence[RenderRequest]) -> None:
        """Ask for the film of requests, whose frames are there or have been asked for."""
        entries = [self._enter(request) for request in requests]
        self._goals.append((entries[0].place, "film"))
        self._cut = edit
        key = edit.key(requests, [entry.names for entry in entries])
        path = edit.path(requests[0].quality_name)
        self._movie("film", entries, range(1, edit.length + 1), key, path)

    def plan(self, with_rest: bool = False) -> Plan:
        """Return what has been collected, with the cores dealt out among the jobs.

        with_rest  plan also jobs whose files are there, or that nothing needs: a user of Snakemake may
                   force them to run again
        """
        self._add_jobs()
        self._planned.add_simulations(self._entries.values())
        if with_rest:
            for entry in list(self._entries.values()):
                self._add_rest(entry)
            self._add_jobs()
        planned = [job for job in self._planned.jobs if with_rest or not job.present]
        jobs = sorted(planned, key=lambda job: job.stage != "simulate")
        rendered = {job.requests[0] for job in jobs if job.stage == "render"}
        return Plan(
            requests=tuple(self._entries),
            film=self._cut,
            jobs=tuple(with_threads(jobs, self.cores, self.share)),
            links=tuple(self._links.values()),
            targets=tuple(dict.fromkeys(self._targets)),
            goals=tuple(dict.fromkeys(self._goals)),
            notes=tuple(dict.fromkeys(self.notes)),
            spared=+self._planned.spared,
            manifests=self._planned.manifests,
            measured=measure_renders(self.store.root, tuple(self._entries), rendered),
            force=tuple(sorted(self.force)),
            farm=self.share is not None,
        )

    # What is missing

    def _enter(self, request: RenderRequest, *goals: str) -> PlanEntry:
        """Return the request's entry in the plan. Raises UsageError where another shot has its name."""
        if request not in self._entries:
            for other in self._entries:
                if other.name == request.name and other.source.path != request.source.path:
                    raise UsageError(
                        f"{other.source.path} and {request.source.path} are both called {request.name}, so "
                        "their frames would overwrite each other; rename one of them"
                    )
            keys = request.keys.pictures(self.store)
            self._entries[request] = PlanEntry(len(self._entries), request, keys, self.store, self.comparable)
        entry = self._entries[request]
        self._goals += [(entry.place, goal) for goal in goals]
        return entry

    def _parts(self, entry: PlanEntry) -> list[PlanEntry]:
        """Return an entry for each of several subjects, whose meshes are made on their own; or the entry."""
        if not entry.request.manifest.subjects:
            return [entry]
        parts = [self._enter(part) for part in entry.request.parts]
        for part in parts:
            part.wholes += [entry.place] if entry.place not in part.wholes else []
        return parts

    def _has(self, stage: str, kind: str, key: Key, place: str, fetch: bool = True) -> bool:
        """Tell whether the store holds a file, which then gets its link. Forced stages need new ones.

        fetch  link a file too that only the remote store has, and that is fetched for it
        """
        is_here = self.store.is_here(kind, key)
        if not (is_here or self.store.is_remote(kind, key)) or self._is_forced(stage, kind, key):
            return False
        if fetch or is_here:
            self._links[place] = Link(kind, key, place)
        return True

    def _is_forced(self, stage: str, kind: str, key: Key) -> bool:
        """Tell whether a file is made again, for it was stored before its stage was forced."""
        return stage in self.force and self.store.stored_at(kind, key) < self.force[stage]

    def _absent(self, entry: PlanEntry, stage: str, numbers: Sequence[int], fetch: bool = True) -> list[int]:
        """Return the frames that the store does not hold. `fetch` as `_has` takes it."""
        if entry.keys is None and STAGES[stage].per_quality:
            return list(numbers)
        kind, places = STAGES[stage].makes, entry.request.places(STAGES[stage].shown_as, numbers)
        placed = zip(numbers, places, strict=True)
        return [n for n, place in placed if not self._has(stage, kind, entry.key(stage, n), place, fetch)]

    def _show_inputs(self, entry: PlanEntry) -> None:
        """Link the meshes, normals and cameras that are here, also where no job needs them.

        Another request, such as a cell of a wedge, may have made them and shown them elsewhere.
        """
        request = entry.request
        shown = request.meshes(request.requested)
        for part in self._parts(entry):
            for stage in ("simulate", "smooth_normals"):
                kind = STAGES[stage].makes
                for n, place in zip(shown, part.request.places(kind, shown), strict=True):
                    key = part.key(stage, n)
                    if self.store.is_here(kind, key) and not self._is_forced(stage, kind, key):
                        self._links[place] = Link(kind, key, place)
        if entry.keys is not None:
            self._has("frame_camera", "cameras", request.keys.cameras, request.folders.cameras().as_posix())

    def _surfaces(self, entry: PlanEntry, unrendered: Sequence[int]) -> None:
        """Plan what rendering needs: the normals of the meshes shown, and cameras, which see all meshes."""
        request = entry.request
        shown = request.meshes(unrendered)
        key, path = request.keys.cameras, request.folders.cameras().as_posix()
        framed = entry.keys is not None and self._has("frame_camera", "cameras", key, path)
        if any(map(request.pictures.follows_flow, unrendered)):
            entry.require_permission()
        needed = {request.angles[n].mesh for n in unrendered if request.pictures.needs_mesh(n)}
        for part in self._parts(entry):
            rough = self._absent(part, "smooth_normals", shown)
            self._meshes_of(part, sorted({*rough, *needed}) if framed else entry.shown)
            self._batches(part, "smooth_normals", rough)
        frames = sorted(request.angles)
        self._ask(entry, "frame_camera", frames, key, entry.shown, framed)

    def _meshes(self, entry: PlanEntry, wanted: Sequence[int]) -> None:
        """Note the mesh frames of all subjects that are not there."""
        for part in self._parts(entry):
            self._meshes_of(part, wanted)

    def _meshes_of(self, entry: PlanEntry, wanted: Sequence[int]) -> None:
        """Note the mesh frames that are not there; which jobs simulate them is known last."""
        missing = self._absent(entry, "simulate", wanted)
        if missing:
            entry.require_permission()
        entry.wanted.update(missing)

    # Jobs, which are added once all frames are known: a farm's nodes share them

    def _ask(
        self,
        entry: PlanEntry,
        stage: str,
        frames: Sequence[int],
        key: Key,
        reads: Sequence[int],
        present: bool,
        **fields: Any,
    ) -> None:
        """Ask for a job that makes one file of all frames; arguments as of `PlannedJobs.add`."""
        counted = 0 if stage in ("assemble", "film") else len(frames)

        def add() -> None:
            if self._planned.is_new(entry, stage, key, present, counted):
                self._planned.add(entry, stage, frames, [key], reads, present, **fields)

        self._waiting.append(add)

    def _batches(self, entry: PlanEntry, stage: str, frames: Sequence[int], present: bool = False) -> None:
        """Ask for the jobs of frames that are made one by one."""
        keys = {n: entry.key(stage, n) for n in frames}
        if self._is_shared_out(stage):
            self._shared_out[stage].count(entry.place, keys.values())
        self._waiting.append(partial(self._add_batches, entry, stage, keys, present))

    def _is_shared_out(self, stage: str) -> bool:
        return self.share is not None and STAGES[stage].on_farm

    def _add_jobs(self) -> None:
        """Add the jobs that were asked for since the last call."""
        waiting, self._waiting = self._waiting, []
        for add in waiting:
            add()
        self._shared_out.clear()

    def _add_batches(self, entry: PlanEntry, stage: str, keys: Mapping[int, Key], present: bool) -> None:
        request = entry.request
        fresh = [n for n, key in keys.items() if self._planned.is_new(entry, stage, key, present)]
        first = 0 if present else self._first(entry, stage, fresh)
        for batch in filter(None, [tuple(fresh[:first]), *self._split(entry, stage, fresh[first:])]):
            reads: Sequence[int] = batch
            meshes: tuple[int, ...] = ()
            if stage == "render":
                reads = list(dict.fromkeys(request.angles[n].mesh for n in batch))
                needed = filter(request.pictures.needs_mesh, batch)
                meshes = tuple(dict.fromkeys(request.angles[n].mesh for n in needed))
            elif stage == "finish":
                reads = _union(entry.names[n].window for n in batch)
            made, seconds = [keys[n] for n in batch], len(batch) * self._node_seconds(request, stage)
            self._planned.add(
                entry, stage, batch, made, reads, present, meshes=meshes, seconds=round(seconds, 1)
            )

    def _first(self, entry: PlanEntry, stage: str, frames: Sequence[int]) -> int:
        """Return how many frames are a batch of their own, so that the first picture of a run is soon there.

        On a farm none are: nobody looks on. The start of two more processes takes two CPU seconds.
        """
        request = entry.request
        is_whole = len(frames) >= max(FEWEST_SPLIT, len(request.requested))
        if stage in self._begun or stage not in ("render", *request.manifest.stages, "finish"):
            return 0
        self._begun.add(stage)
        if not is_whole or self.share is not None:
            return 0
        return 1 if stage == "finish" else len(entry.names[frames[0]].window)

    def _split(self, entry: PlanEntry, stage: str, frames: Sequence[int]) -> list[tuple[int, ...]]:
        """Return the batches of frames of a stage."""
        if stage == "smooth_normals" or not frames:
            return [tuple(frames)]
        if not self._is_shared_out(stage):
            return batches(frames, self.side_by_side)
        return even_batches(frames, self._batch_sizes(stage)[entry.place])

    def _batch_sizes(self, stage: str) -> Mapping[int, int]:
        """Return the frames of a batch of a stage by request: the time that they take decides.

        A batch takes as long as its start, at least. One that averages over time has as many frames as it
        reads on both sides, so that no frame is needed by three batches.
        """
        shared, share = self._shared_out[stage], self.share
        if not shared.sizes and share is not None:
            works, requests = [], tuple(self._entries)
            for place, frames in shared.frames.items():
                seconds = self._node_seconds(requests[place], stage)
                least = share.frames or math.ceil(share.start / seconds)
                reach = requests[place].pictures.reach if stage == "finish" else 0
                works.append(FrameWork(frames, seconds, max(least, 2 * reach)))
            shared.sizes = dict(zip(shared.frames, batch_sizes(works, self.cores, share.start), strict=True))
        return shared.sizes

    def _node_seconds(self, request: RenderRequest, stage: str) -> float:
        """Return what a node of a farm takes for a frame of a stage; 0 where none makes it."""
        if self.share is None or not STAGES[stage].on_farm:
            return 0.0
        if self.timings is None:
            self.timings = MeanTimings(self.store.root)
        return max(self.timings.expected(stage, request) / self.share.threads, 1e-3)

    def _add_rest(self, entry: PlanEntry) -> None:
        """Plan the jobs of an entry whose files are there, and those that nothing needs."""
        request = entry.request
        goals = {stage for place, stage in self._goals if place == entry.place}
        if "finish" in goals:
            self._surfaces(entry, ())
            for stage in ("render", *request.manifest.stages):
                self._rest(entry, stage, _union(entry.names[n].window for n in request.requested))
            self._rest(entry, "finish", request.requested)
        if goals & {"finish", "smooth_normals"}:
            shown = request.meshes(request.requested)
            for part in self._parts(entry):
                self._rest(part, "smooth_normals", shown)
                self._rest(part, "simulate", [n for n in part.shown if n not in part.wanted])

    def _rest(self, entry: PlanEntry, stage: str, numbers: Sequence[int]) -> None:
        """Plan the jobs of files that are there, and of those that nothing needs."""
        absent = set(self._absent(entry, stage, numbers, fetch=False))
        for present in (True, False):
            frames = [n for n in numbers if (n not in absent) == present]
            if stage != "simulate":
                self._batches(entry, stage, frames, present)
            elif frames:
                self._planned.add(entry, stage, frames, entry.mesh_keys(frames), (), present)

    def _movie(
        self, stage: str, entries: Sequence[PlanEntry], frames: Sequence[int], key: Key, path: Path
    ) -> None:
        """Plan the job of a movie of all frames of some requests."""
        place = path.as_posix()
        self._targets.append(place)
        present = all(entry.keys is not None for entry in entries) and self._has(stage, "movie", key, place)
        places = tuple(entry.place for entry in entries)
        self._ask(entries[0], stage, frames, key, frames, present, output=place, requests=places)


def _union(windows: Iterable[Sequence[int]]) -> list[int]:
    return sorted({number for window in windows for number in window})
