"""What several takes of one plan would make alike is made once.

A plan is made take by take, each with a folder of its own, and goes by what the store holds already. Here it
goes by keys: of jobs that would make the same file one remains, and whoever needs it waits for that. Folders
of the others get their links when all is done, as from any store.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby
from typing import Any

from pipeline.production.keys.digest import Key
from pipeline.production.planning.plan import Job, Plan, dealt_out
from pipeline.production.planning.profile import Share
from pipeline.production.request.cameras import CameraFile
from pipeline.production.request.picture_keys import PictureKeys
from pipeline.production.request.render_request import RenderRequest
from pipeline.production.store.store import Store

LONG = 8
"""Frames that a simulation has in common with others from which on these wait for them: to wait costs the
start of one more process."""

Identity = tuple[str, Any]

File = tuple[int, str, Identity]
"""Its frame, its place and what it is known by."""

_WHOLE = ("frame_camera", "assemble")
"""Tasks that make one file of all their frames; others make one of each."""


def shared(
    plan: Plan, requests: Sequence[RenderRequest], store: Store, cores: int, share: Share | None = None
) -> Plan:
    """The plan with everything made once; `takes` are the plan's own, in its order.

    cores, share  what its jobs have together, and on a farm each for itself
    """
    known = [_Files.of(request, store) for request in requests]
    once = _Once(known, _users(plan, known))
    jobs = [kept for job in plan.jobs for kept in once.kept(job)]
    renamed = [replace(job, inputs=once.renamed(job.inputs)) for job in jobs]
    return replace(plan, jobs=tuple(dealt_out(renamed, cores, share)), targets=once.renamed(plan.targets))


@dataclass(frozen=True)
class _Promise:
    """The framing of a picture before it is found: where these are equal, so will the framings be."""

    cameras: Key
    number: int

    def as_data(self) -> Any:
        return [self.cameras, self.number]


class _Promises(CameraFile):
    """Those of all pictures of a take."""

    def __getitem__(self, number: int) -> Any:
        return _Promise(self.key, number)


@dataclass(frozen=True, eq=False)
class _Files:
    """What the files of a take are known by, whether its cameras were found already or not."""

    request: RenderRequest
    keys: PictureKeys

    @classmethod
    def of(cls, request: RenderRequest, store: Store) -> _Files:
        promised = _Promises(store, f"promised {request.cameras_key}", dict.fromkeys(request.angles))
        return cls(request, request.picture_keys(store) or PictureKeys(request, store, promised))

    def made_by(self, job: Job) -> Iterator[File]:
        """Each file that a job makes."""
        numbers = job.frames[:1] if job.task in _WHOLE else job.frames
        for number, place in zip(numbers, job.outputs, strict=True):
            yield number, place, (job.task, self._identity(job, number))

    def _identity(self, job: Job, number: int) -> Any:
        if job.task == "simulate":
            return self.request.mesh_key(number)
        if job.task == "smooth_normals":
            return self.request.normals_key(number)
        if job.task == "frame_camera":
            return self.request.cameras_key
        if job.task == "render":
            return self.keys[number].raw
        if job.task == "finish":
            return self.keys[number].frame
        return self.request.movie_key([self.keys[n].frame for n in job.frames])


def _users(plan: Plan, known: Sequence[_Files]) -> Counter[Identity]:
    """How many different simulations go through each mesh frame."""
    chains = {
        tuple(identity for _, _, identity in known[job.requests[0]].made_by(job))
        for job in plan.jobs
        if job.task == "simulate"
    }
    return Counter(identity for chain in chains for identity in chain)


@dataclass(eq=False)
class _Once:
    """Goes through jobs in their order and keeps of each what no job before it makes."""

    known: Sequence[_Files]
    users: Counter[Identity]
    _makers: dict[Identity, str] = field(default_factory=dict)
    _places: dict[str, str] = field(default_factory=dict)

    def renamed(self, places: Sequence[str]) -> tuple[str, ...]:
        """Where the same files are made."""
        return tuple(dict.fromkeys(self._places.get(place, place) for place in places))

    def kept(self, job: Job) -> list[Job]:
        made = list(self.known[job.requests[0]].made_by(job))
        if job.task == "simulate":
            return self._simulations(job, made)
        mine = [(number, place) for number, place, identity in made if self._is_first(place, identity)]
        if not mine:
            return []
        frames = job.frames if job.task in _WHOLE else tuple(number for number, _ in mine)
        return [replace(job, frames=frames, outputs=tuple(place for _, place in mine))]

    def _simulations(self, job: Job, made: Sequence[File]) -> list[Job]:
        """A simulation in pieces: what it has in common with others to begin with, and what goes on from it.

        Short pieces are not worth waiting for: each makes those itself, to the same bits.
        """
        if all(identity in self._makers for _, _, identity in made):
            for _, place, identity in made:
                self._is_first(place, identity)
            return []
        jobs: list[Job] = []
        before: tuple[str, ...] = ()
        for in_common, piece in self._pieces(made):
            fresh = [self._is_first(place, identity, renaming=in_common) for _, place, identity in piece]
            if fresh[0] or not in_common:
                frames, outputs = (
                    tuple(each) for each in zip(*((n, place) for n, place, _ in piece), strict=True)
                )
                name = f"{job.name.rsplit('_', 2)[0]}_{min(frames):04d}_{max(frames):04d}"
                jobs.append(replace(job, name=name, frames=frames, outputs=outputs, inputs=before))
            before = (piece[-1][1],)
        return jobs

    def _pieces(self, made: Sequence[File]) -> list[tuple[bool, list[File]]]:
        """Frames that the same number of simulations go through, and whether one makes them for all."""
        pieces: list[tuple[bool, list[File]]] = []
        for many, group in groupby(made, key=lambda file: self.users[file[2]]):
            piece = list(group)
            in_common = many > 1 and len(piece) >= LONG
            if pieces and not in_common and not pieces[-1][0]:
                pieces[-1][1].extend(piece)
            else:
                pieces.append((in_common, piece))
        return pieces

    def _is_first(self, place: str, identity: Identity, renaming: bool = True) -> bool:
        """Whether no job before makes the same; otherwise, if wanted, its place stands for this one."""
        maker = self._makers.setdefault(identity, place)
        if maker != place and renaming:
            self._places[place] = maker
        return maker == place
