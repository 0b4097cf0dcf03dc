"""Make a plan: compare keys with the store, backwards from the pictures.

A link that shows the right store entry needs nothing; an entry in the store needs its link; anything else
needs a job, and so does what that job reads, unless it is there.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from pipeline.errors import UsageError
from pipeline.production.planning.entry import PlanEntry
from pipeline.production.planning.plan import Link, Plan, with_threads
from pipeline.production.planning.planned_jobs import MIN_BATCH, PlannedJobs, batches
from pipeline.production.planning.profile import Share
from pipeline.production.planning.timings import measured
from pipeline.production.request.edit import Edit
from pipeline.production.request.keys import PictureKeys
from pipeline.production.request.render_request import RenderRequest
from pipeline.production.stages import STAGES
from pipeline.production.store.store import Key, Store


@dataclass
class Planner:
    """Collects the jobs of several requests, and of the film that they are cut into.

    side_by_side  how many jobs of one request work side by side
    cores         how many of all requests do
    share         what each of them has for itself on a farm's nodes; None where they share this machine
    whole         plan also jobs whose files are there or not needed, which Snakemake may be told to run again
    force         stages that are made again, each with the time (nanoseconds since the epoch) from which on
                  the store's files count
    comparable    requests differ by settings, as the cells of a wedge do, and may have pictures in common
    """

    store: Store
    side_by_side: int
    cores: int
    notes: Sequence[str] = ()
    share: Share | None = None
    whole: bool = False
    force: Mapping[str, int] = field(default_factory=dict)
    comparable: bool = False
    _entries: dict[RenderRequest, PlanEntry] = field(default_factory=dict)
    _planned: PlannedJobs = field(default_factory=PlannedJobs)
    _links: dict[str, Link] = field(default_factory=dict)
    _targets: list[str] = field(default_factory=list)
    _goals: list[tuple[int, str]] = field(default_factory=list)
    _cut: Edit | None = None

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
        read = dict.fromkeys([*unfinished, *_union(names[n].window for n in unfinished)])
        unrendered = self._absent(entry, "render", list(read))
        if unrendered or self.whole:
            self._surfaces(entry, unrendered)
        self._batches(entry, "render", unrendered)
        self._batches(entry, "finish", unfinished)
        if isinstance(names, PictureKeys):
            names.remember()
        if self.whole:
            self._rest(entry, "render", _union(names[n].window for n in frames))
            self._rest(entry, "finish", frames)

    def rendered(self, request: RenderRequest) -> None:
        """Ask for the rendered frames of a request, with all AOVs."""
        entry, frames = self._enter(request, "render"), request.requested
        self._targets += request.places("raw", frames)
        unrendered = self._absent(entry, "render", frames)
        if unrendered:
            self._surfaces(entry, unrendered)
        self._batches(entry, "render", unrendered)

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
        key = request.movie_key([entry.names[n].frame for n in frames])
        self._movie("assemble", [entry], frames, key, request.movie_path)

    def film(self, edit: Edit, requests: Sequence[RenderRequest]) -> None:
        """Ask for the film of requests, whose frames are there or have been asked for."""
        entries = [self._enter(request) for request in requests]
        self._goals.append((entries[0].place, "film"))
        self._cut = edit
        key = edit.key(requests, [entry.names for entry in entries])
        path = edit.path(requests[0].quality_name)
        self._movie("film", entries, range(1, edit.length + 1), key, path)

    def plan(self) -> Plan:
        """Return what has been collected, with the cores dealt out among the jobs."""
        self._planned.add_simulations(self._entries.values())
        jobs = sorted(self._planned.jobs, key=lambda job: job.stage != "simulate")
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
            measured=measured(self.store.root, tuple(self._entries), rendered),
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
                        f"{other.source.path} and {request.source.path} are both called {request.name}, "
                        "and so would their frames be; rename one of them"
                    )
            keys = request.picture_keys(self.store)
            self._entries[request] = PlanEntry(len(self._entries), request, keys, self.store, self.comparable)
        entry = self._entries[request]
        self._goals += [(entry.place, goal) for goal in goals]
        return entry

    def _parts(self, entry: PlanEntry) -> list[PlanEntry]:
        """Return an entry for each of several subjects, whose meshes are made on their own; or the entry."""
        if not entry.request.source.summary.subjects:
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
        kind = STAGES[stage].makes
        placed = zip(numbers, entry.request.places(kind, numbers), strict=True)
        return [n for n, place in placed if not self._has(stage, kind, entry.key(stage, n), place, fetch)]

    def _show_inputs(self, entry: PlanEntry) -> None:
        """Link the meshes, normals and cameras that are here, also where no job needs them.

        Another request, such as a cell of a wedge, may have made them and shown them elsewhere.
        """
        request = entry.request
        shown = sorted({request.angles[n].mesh for n in request.requested})
        for part in self._parts(entry):
            for stage in ("simulate", "smooth_normals"):
                kind = STAGES[stage].makes
                for n, place in zip(shown, part.request.places(kind, shown), strict=True):
                    key = part.key(stage, n)
                    if self.store.is_here(kind, key) and not self._is_forced(stage, kind, key):
                        self._links[place] = Link(kind, key, place)
        if entry.keys is not None:
            self._has("frame_camera", "cameras", request.cameras_key, request.folders.cameras().as_posix())

    def _surfaces(self, entry: PlanEntry, unrendered: Sequence[int]) -> None:
        """Plan what rendering needs: the normals of the meshes shown, and cameras, which see all meshes."""
        request = entry.request
        shown = sorted({request.angles[n].mesh for n in unrendered})
        key, path = request.cameras_key, request.folders.cameras().as_posix()
        framed = entry.keys is not None and self._has("frame_camera", "cameras", key, path)
        if any(map(request.summary.follows_flow, unrendered)):
            entry.require_permission()
        needed = {request.angles[n].mesh for n in unrendered if request.summary.needs_mesh(n)}
        for part in self._parts(entry):
            rough = self._absent(part, "smooth_normals", shown)
            self._meshes_of(part, sorted({*rough, *needed}) if framed else entry.shown)
            self._batches(part, "smooth_normals", rough)
            if self.whole:
                self._rest(
                    part, "smooth_normals", sorted({request.angles[n].mesh for n in request.requested})
                )
        frames = sorted(request.angles)
        if (self.whole or not framed) and self._planned.is_new(
            entry, "frame_camera", key, framed, len(frames)
        ):
            self._planned.add(entry, "frame_camera", frames, [key], entry.shown, framed)

    def _meshes(self, entry: PlanEntry, wanted: Sequence[int]) -> None:
        """Note the mesh frames of all subjects that are not there."""
        for part in self._parts(entry):
            self._meshes_of(part, wanted)

    def _meshes_of(self, entry: PlanEntry, wanted: Sequence[int]) -> None:
        """Note the mesh frames that are not there; which jobs simulate them is known last."""
        missing = self._absent(entry, "simulate", wanted)
        if missing:
            entry.require_permission()
        entry.meshes |= dict.fromkeys(missing, "wanted")
        if self.whole:
            absent = set(self._absent(entry, "simulate", entry.shown, fetch=False))
            states = {n: "idle" if n in absent else "present" for n in entry.shown}
            entry.meshes = {**states, **entry.meshes}

    # Jobs

    def _batches(self, entry: PlanEntry, stage: str, frames: Sequence[int], present: bool = False) -> None:
        """Plan the jobs of frames that are made one by one."""
        request = entry.request
        least = self.share.frames if self.share else MIN_BATCH
        keys = {n: entry.key(stage, n) for n in frames}
        fresh = [n for n in frames if self._planned.is_new(entry, stage, keys[n], present)]
        split = [fresh] if stage == "smooth_normals" else batches(fresh, self.side_by_side, least)
        for batch in filter(None, split):
            reads: Sequence[int] = batch
            meshes: tuple[int, ...] = ()
            if stage == "render":
                reads = list(dict.fromkeys(request.angles[n].mesh for n in batch))
                needed = filter(request.summary.needs_mesh, batch)
                meshes = tuple(dict.fromkeys(request.angles[n].mesh for n in needed))
            elif stage == "finish":
                reads = _union(entry.names[n].window for n in batch)
            self._planned.add(entry, stage, batch, [keys[n] for n in batch], reads, present, meshes=meshes)

    def _rest(self, entry: PlanEntry, stage: str, numbers: Sequence[int]) -> None:
        """Plan the jobs of files that are there, and of those that nothing needs."""
        absent = set(self._absent(entry, stage, numbers, fetch=False))
        for present in (True, False):
            self._batches(entry, stage, [n for n in numbers if (n not in absent) == present], present)

    def _movie(
        self, stage: str, entries: Sequence[PlanEntry], frames: Sequence[int], key: Key, path: Path
    ) -> None:
        """Plan the job of a movie of all frames of some requests."""
        place = path.as_posix()
        self._targets.append(place)
        present = all(entry.keys is not None for entry in entries) and self._has(stage, "movie", key, place)
        if (self.whole or not present) and self._planned.is_new(entries[0], stage, key, present, 0):
            places = tuple(entry.place for entry in entries)
            self._planned.add(
                entries[0], stage, frames, [key], frames, present, output=place, requests=places
            )


def _union(windows: Iterable[Sequence[int]]) -> list[int]:
    return sorted({number for window in windows for number in window})
