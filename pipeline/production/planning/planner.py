"""Make a plan: compare keys with the store, backwards from the pictures.

A file whose link shows the right store entry needs nothing; one whose entry is in the store needs the link.
Any other needs a job, and so does each file that this job reads and that is missing.

A request enters as its keys, with stand-ins for those that cameras decide. Jobs are known by the keys of what
they make, so what several requests need is made once.
"""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import groupby
from pathlib import Path
from typing import Any

from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.frames import FrameRange
from flowsculpt.pipeline.production.planning.plan import Job, Link, Plan, done_file, with_threads
from flowsculpt.pipeline.production.planning.profile import Share
from flowsculpt.pipeline.production.planning.timings import measure_renders
from flowsculpt.pipeline.production.request.cameras import CameraFile
from flowsculpt.pipeline.production.request.edit import Edit
from flowsculpt.pipeline.production.request.keys import FrameKeys, PictureKeys, staged_keys
from flowsculpt.pipeline.production.request.render_request import RenderRequest
from flowsculpt.pipeline.production.stages import STAGES
from flowsculpt.pipeline.production.store.store import Key, Store, key_of


class _PlaceholderFramings(CameraFile):
    """Stand-ins for framings that are not known yet: where these are equal, so will the framings be."""

    def __getitem__(self, number: int) -> Any:
        return {"cameras": self.key, "number": number}


class _PlaceholderKeys(dict[int, FrameKeys]):
    """Stand-ins for the keys of a request's pictures, which tell them apart within one shot file."""

    def __init__(self, request: RenderRequest) -> None:
        super().__init__()
        self._request, self._asked = request, frozenset(request.requested)

    def __missing__(self, number: int) -> FrameKeys:
        window = self._request.pictures.window(number, self._asked.__contains__)
        raw = f"{self._request.keys.identity}.{number}"
        staged = staged_keys(self._request.manifest.stages, raw)
        self[number] = FrameKeys(raw, f"{raw}.{window[0]}.{window[-1]}", window, staged)
        return self[number]


@dataclass(eq=False)
class PlanEntry:
    """A request in the plan, and what is known of its pictures.

    keys        those of its pictures; None where its cameras are not known
    comparable  keys are needed even before cameras are known, to find equal pictures of other requests
    wanted      mesh frames that jobs need and the store lacks
    wholes      places of the requests that show the subject with others, for an entry of one of several
    """

    place: int
    request: RenderRequest
    keys: PictureKeys | None
    store: Store
    comparable: bool
    wanted: set[int] = field(default_factory=set)
    wholes: list[int] = field(default_factory=list)

    @property
    def places(self) -> tuple[int, ...]:
        """The places of the requests that need what the entry needs."""
        return self.place, *self.wholes

    @cached_property
    def names(self) -> Mapping[int, FrameKeys]:
        """The keys of the pictures, or what stands for them until the cameras are known."""
        request = self.request
        if self.keys is not None:
            return self.keys
        if not self.comparable:
            return _PlaceholderKeys(request)
        key = f"promised {request.keys.cameras}"
        framings = _PlaceholderFramings(self.store, key, request.angles, dict)
        return PictureKeys(request, self.store, framings)

    @cached_property
    def shown(self) -> list[int]:
        """The mesh frames that pictures of the whole request show."""
        return self.request.meshes(self.request.angles)

    def require_permission(self) -> None:
        """Raises UsageError where the shot runs Python files, and may not."""
        if self.request.manifest.runs_python:
            self.request.shot.require_permission()

    def mesh_keys(self, numbers: Sequence[int]) -> tuple[Key, ...]:
        """Return the keys of mesh frames, in order."""
        return tuple(map(self.request.keys.mesh, numbers))

    def key(self, stage: str, number: int) -> Key:
        """The key by which a frame of a stage is known in the plan."""
        if stage == "simulate":
            return self.request.keys.mesh(number)
        if stage == "smooth_normals":
            return self.request.keys.normals(number)
        keys = self.names[number]
        if stage == "render":
            return keys.raw
        if stage in keys.staged:
            return keys.staged[stage]
        return keys.frame if stage == "finish" else self.request.keys.still(stage, keys.frame)


MAX_BATCH = 256
"""Frames a process renders at most before it gives its memory back."""

MIN_BATCH = 4
"""Frames that are not worth the start of a second process: one renders them on all cores."""

MIN_LAST_BATCH = 64
"""The smallest last batches, in frames, while there are more batches than cores."""

FEWEST_SPLIT = 24
"""A run of at least so many pictures makes its first one before all others: somebody waits to see it."""

MIN_SHARED = 8
"""A simulation waits for another that makes at least this many of the same frames: waiting costs the start of
one more process."""


@dataclass
class PlannedJobs:
    """Collects jobs, and notes which requests need them.

    jobs       in the order in which they were added
    spared     frames by stage that a request needs and the job of another makes
    manifests  what the jobs whose files are there have made: the kind and the keys, by output
    """

    jobs: list[Job] = field(default_factory=list)
    spared: Counter[str] = field(default_factory=Counter)
    manifests: dict[str, tuple[str, list[Key]]] = field(default_factory=dict)
    _makers: defaultdict[str, dict[Key, int]] = field(default_factory=lambda: defaultdict(dict))

    def is_new(self, entry: PlanEntry, stage: str, key: Key, present: bool, frames: int = 1) -> bool:
        """Tell whether no job makes a file yet; a job that does then serves this request too."""
        maker = self._makers[stage].get(key)
        if maker is None:
            return True
        self._serve(maker, entry)
        if self.jobs[maker].requests[0] != entry.place and not present:
            self.spared[stage] += frames
        return False

    def _serve(self, maker: int, entry: PlanEntry) -> None:
        """Note that a request needs what a job makes."""
        job = self.jobs[maker]
        self.jobs[maker] = replace(job, requests=tuple(dict.fromkeys((*job.requests, *entry.places))))

    def add(
        self,
        entry: PlanEntry,
        stage: str,
        frames: Sequence[int],
        keys: Sequence[Key],
        reads: Sequence[int],
        present: bool,
        **fields: Any,
    ) -> None:
        """Add a job that makes files of `keys`; those that are there stand in its manifest.

        fields  fields of the job that differ from the usual ones
        """
        request, key = entry.request, key_of(stage, list(keys))[:16]
        label = re.sub(r"\W", "_", request.label)
        name = f"{stage}_{label}_{min(frames):04d}_{max(frames):04d}_{key[:8]}"
        output = done_file(stage, request.name, request.quality_name, frames, key)
        if present:
            self.manifests[output] = STAGES[stage].makes, list(keys)
        for made in keys:
            self._makers[stage].setdefault(made, len(self.jobs))
        others = None if list(reads) == list(frames) else tuple(reads)
        job = Job(
            name, stage, entry.places, FrameRange(frames), others, key=key, output=output, present=present
        )
        self.jobs.append(replace(job, **fields))

    def add_simulations(self, entries: Collection[PlanEntry]) -> None:
        """Add the jobs that simulate meshes; a long beginning that requests share is made once."""
        makers = self._makers["simulate"]
        wanted = [(entry, sorted(entry.wanted)) for entry in entries]
        users = Counter(key for chain in {e.mesh_keys(numbers) for e, numbers in wanted} for key in chain)
        for entry, numbers in wanted:
            before: list[int] = []
            for is_shared, piece in _pieces(entry, numbers, users):
                keys = entry.mesh_keys(piece)
                if all(key in makers for key in keys) or (is_shared and keys[0] in makers):
                    for maker in {makers[key] for key in keys if key in makers}:
                        self._serve(maker, entry)
                    self.spared["simulate"] += len(piece)
                else:
                    self.add(entry, "simulate", piece, keys, before, present=False)
                before = piece[-1:]


def _pieces(
    entry: PlanEntry, numbers: Sequence[int], users: Mapping[Key, int]
) -> list[tuple[bool, list[int]]]:
    """Return frames that the same number of simulations go through, and whether one makes them for all.

    Short pieces are not worth waiting for: each simulation makes those itself, to the same bits.
    """
    pieces: list[tuple[bool, list[int]]] = []
    for many, group in groupby(numbers, key=lambda n: users[entry.request.keys.mesh(n)]):
        piece = list(group)
        is_shared = many > 1 and len(piece) >= MIN_SHARED
        if pieces and not is_shared and not pieces[-1][0]:
            pieces[-1][1].extend(piece)
        else:
            pieces.append((is_shared, piece))
    return pieces


def batches(numbers: Sequence[int], cores: int, least: int = MIN_BATCH) -> list[tuple[int, ...]]:
    """Split frames into batches, none longer than MAX_BATCH, enough of them to keep the cores busy, but none
    needlessly shorter than `least`.

    Frames in ascending order are split into neighbours, long batches first, for each costs a process the time
    to start, and shorter ones towards the end, so that no core waits long for another (guided
    self-scheduling: Polychronopoulos & Kuck, 1987). Frames in another order, such as coarse first, are dealt
    out, so that all cores work on the first ones first.
    """
    cores = max(1, cores)
    share = -(-len(numbers) // cores)
    if list(numbers) == sorted(numbers):
        return list(_halving_batches(numbers, cores, max(least, min(MIN_LAST_BATCH, share))))
    size = min(MAX_BATCH, max(least, share))
    hands = [numbers[i : i + size * cores] for i in range(0, len(numbers), size * cores)]
    dealt = (tuple(hand[i::cores]) for hand in hands for i in range(cores))
    return [batch for batch in dealt if batch]


def _halving_batches(numbers: Sequence[int], cores: int, least: int) -> Iterator[tuple[int, ...]]:
    """Yield batches of half of each core's share of what is left."""
    begun = 0
    while begun < len(numbers):
        size = min(MAX_BATCH, max(least, (len(numbers) - begun) // (2 * cores)))
        yield tuple(numbers[begun : begun + size])
        begun += size


@dataclass
class Planner:
    """Collects the jobs of several requests, and of the film that they are cut into.

    side_by_side  how many jobs of one request work side by side
    cores         how many of all requests do
    share         what each of them has for itself on a farm's nodes; None where they share this machine
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
    _entries: dict[RenderRequest, PlanEntry] = field(default_factory=dict)
    _planned: PlannedJobs = field(default_factory=PlannedJobs)
    _links: dict[str, Link] = field(default_factory=dict)
    _targets: list[str] = field(default_factory=list)
    _goals: list[tuple[int, str]] = field(default_factory=list)
    _cut: Edit | None = None
    _begun: set[str] = field(default_factory=set)
    """Stages of which some frames are planned."""

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
        self._planned.add_simulations(self._entries.values())
        if with_rest:
            for entry in list(self._entries.values()):
                self._add_rest(entry)
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
        if self._planned.is_new(entry, "frame_camera", key, framed, len(frames)):
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
        entry.wanted.update(missing)

    # Jobs

    def _batches(self, entry: PlanEntry, stage: str, frames: Sequence[int], present: bool = False) -> None:
        """Plan the jobs of frames that are made one by one."""
        request = entry.request
        least = self.share.frames if self.share else MIN_BATCH
        keys = {n: entry.key(stage, n) for n in frames}
        fresh = [n for n in frames if self._planned.is_new(entry, stage, keys[n], present)]
        first = 0 if present else self._first(entry, stage, fresh)
        rest = fresh[first:]
        split = [rest] if stage == "smooth_normals" else batches(rest, self.side_by_side, least)
        for batch in filter(None, [fresh[:first], *split]):
            reads: Sequence[int] = batch
            meshes: tuple[int, ...] = ()
            if stage == "render":
                reads = list(dict.fromkeys(request.angles[n].mesh for n in batch))
                needed = filter(request.pictures.needs_mesh, batch)
                meshes = tuple(dict.fromkeys(request.angles[n].mesh for n in needed))
            elif stage == "finish":
                reads = _union(entry.names[n].window for n in batch)
            self._planned.add(entry, stage, batch, [keys[n] for n in batch], reads, present, meshes=meshes)

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
        if self._planned.is_new(entries[0], stage, key, present, 0):
            places = tuple(entry.place for entry in entries)
            self._planned.add(
                entries[0], stage, frames, [key], frames, present, output=place, requests=places
            )


def _union(windows: Iterable[Sequence[int]]) -> list[int]:
    return sorted({number for window in windows for number in window})
