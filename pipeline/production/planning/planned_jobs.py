"""The requests of a plan, and the jobs that they need, while a planner collects them."""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import groupby
from typing import Any

from flowsculpt.pipeline.frames import FrameRange
from flowsculpt.pipeline.production.planning.plan import Job, done_file
from flowsculpt.pipeline.production.request.cameras import CameraFile
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
