"""From what was asked for to a plan: walk back from the pictures to the first thing that is missing."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path

from pipeline.errors import UsageError
from pipeline.production.keys.digest import Key
from pipeline.production.planning.needs import HERE, UNMEASURED, Experience, Needs
from pipeline.production.planning.plan import FEWEST, Job, Link, Plan, batches, dealt_out
from pipeline.production.planning.profile import Share
from pipeline.production.request.edit import Edit
from pipeline.production.request.picture_keys import PictureKeys
from pipeline.production.request.render_request import RenderRequest
from pipeline.production.store.store import Store


@dataclass
class Planner:
    """Collects the jobs of several takes, and of the film that they are cut into.

    cores    how many jobs work side by side
    share    what each of them has for itself on a farm's nodes; None where they share `cores`
    """

    store: Store
    cores: int
    notes: Sequence[str] = ()
    share: Share | None = None
    _takes: dict[RenderRequest, int] = field(default_factory=dict)
    _paths: dict[str, Path] = field(default_factory=dict)
    _made: set[str] = field(default_factory=set)
    _jobs: list[Job] = field(default_factory=list)
    _links: dict[str, Link] = field(default_factory=dict)
    _targets: list[str] = field(default_factory=list)
    _keyrings: dict[RenderRequest, PictureKeys | None] = field(default_factory=dict)
    _cut: Edit | None = None

    def simulate(self, request: RenderRequest) -> None:
        """Ask for the mesh frames of a take's shot."""
        self._enter(request)
        self._targets += request.places("mesh", request.requested)
        self._meshes(request, request.requested)

    def surfaces(self, request: RenderRequest) -> None:
        """Ask for what pictures of a take are made from: meshes with normals, and its cameras."""
        self._enter(request)
        self._surfaces(request, request.requested, cameras_known=self._keys(request) is not None)
        self._targets += [request.folders.cameras().as_posix(), *request.places("normals", request.requested)]

    def pictures(self, request: RenderRequest) -> None:
        """Ask for the finished frames of a take."""
        self._enter(request)
        keys = self._keys(request)
        frames = request.requested
        self._targets += request.places("frame", frames)
        unfinished = self._absent("frame", request, frames, lambda n: keys[n].frame if keys else None)
        asked = set(frames).__contains__
        around = {n: keys[n].window if keys else request.window(n, asked) for n in unfinished}
        needed = list(dict.fromkeys([*unfinished, *(n for window in around.values() for n in window)]))
        unrendered = self._absent("raw", request, needed, lambda n: keys[n].raw if keys else None)
        if unrendered:
            self._surfaces(request, unrendered, cameras_known=keys is not None)
        for batch in self._batches(unrendered):
            self._render(request, batch)
        for batch in self._batches(unfinished):
            seen = sorted({n for number in batch for n in around[number]})
            self._add(request, "finish", batch, request.places("raw", seen), request.places("frame", batch))

    def stills(self, request: RenderRequest, form: str) -> None:
        """Ask for the frames of a take as a display shows them."""
        self.pictures(request)
        keys = self._keys(request)
        self._targets += request.places(form, request.requested)
        absent = self._absent(
            form,
            request,
            request.requested,
            lambda n: request.still_key(form, keys[n].frame) if keys else None,
        )
        for batch in self._batches(absent):
            self._add(request, form, batch, request.places("frame", batch), request.places(form, batch))

    def movie(self, request: RenderRequest) -> None:
        """Ask for the movie of a take, whose frames are there or have been asked for."""
        self._enter(request)
        keys = self._keys(request)
        path, frames = request.movie_path.as_posix(), sorted(request.requested)
        self._targets.append(path)
        key = request.movie_key([keys[n].frame for n in frames]) if keys else None
        if key is not None and self.store.holds("movie", key):
            self._link("movie", key, path)
        elif path not in self._made:
            self._add(request, "assemble", frames, request.places("frame", frames), [path])

    def film(self, edit: Edit, requests: Sequence[RenderRequest]) -> None:
        """Ask for the film of takes, whose frames are there or have been asked for."""
        path = edit.path(requests[0].quality_name).as_posix()
        self._targets.append(path)
        self._cut = edit
        key = film_key(edit, requests, [self._keys(request) for request in requests])
        if key is not None and self.store.holds("movie", key):
            self._link("movie", key, path)
            return
        inputs = tuple(place for request in requests for place in request.places("frame", request.requested))
        frames = tuple(range(1, edit.length + 1))
        self._jobs.append(Job("film", "film", tuple(map(self._enter, requests)), frames, inputs, (path,)))

    def plan(self) -> Plan:
        """What has been collected, the cores dealt out among the simulations and then among the renders."""
        for keys in self._keyrings.values():
            if keys is not None:
                keys.note()
        jobs = dealt_out(self._jobs, self.cores, self.share)
        return Plan(
            requests=tuple(request.as_data() for request in self._takes),
            film=self._cut.as_data() if self._cut else None,
            jobs=tuple(self._measured(jobs)),
            links=tuple(self._links.values()),
            targets=tuple(dict.fromkeys(self._targets)),
            notes=tuple(dict.fromkeys(self.notes)),
        )

    def _keys(self, request: RenderRequest) -> PictureKeys | None:
        """Those of its pictures, which nothing changes while a plan is made."""
        if request not in self._keyrings:
            self._keyrings[request] = request.picture_keys(self.store)
        return self._keyrings[request]

    def _measured(self, jobs: Sequence[Job]) -> list[Job]:
        """Jobs, those that render asking for what earlier pictures took."""
        unknown, requests = UNMEASURED if self.share else HERE, list(self._takes)

        @cache
        def known(place: int) -> Experience | None:
            request = requests[place]
            return Experience.of(self.store.root / request.folders.statistics(request.quality_name, 0).parent)

        def needs(job: Job) -> Needs:
            experience = known(job.requests[0]) if job.task == "render" else None
            return experience.needs(len(job.frames), job.threads) if experience else unknown

        return [replace(job, needs=needs(job)) for job in jobs]

    def _batches(self, frames: Sequence[int]) -> list[tuple[int, ...]]:
        return batches(frames, self.cores, self.share.frames if self.share else FEWEST)

    def _surfaces(self, request: RenderRequest, unrendered: Sequence[int], cameras_known: bool) -> None:
        """What rendering needs: the normals of the meshes shown, and cameras, which look at all of them."""
        shown = sorted({request.angles[n].mesh for n in unrendered})
        rough = self._absent("normals", request, shown, request.normals_key)
        cameras = request.folders.cameras().as_posix()
        all_shown = sorted({angle.mesh for angle in request.angles.values()})
        if cameras_known:
            self._link("cameras", request.cameras_key, cameras)
        if any(map(request.follows_flow, unrendered)):
            _require_permission(request)
        needed = {request.angles[n].mesh for n in unrendered if request.needs_mesh(n)}
        self._meshes(request, sorted({*rough, *needed}) if cameras_known else all_shown)
        self._add(
            request, "smooth_normals", rough, request.places("mesh", rough), request.places("normals", rough)
        )
        if not cameras_known and cameras not in self._made:
            self._add(
                request, "frame_camera", sorted(request.angles), request.places("mesh", all_shown), [cameras]
            )

    def _meshes(self, request: RenderRequest, wanted: Sequence[int]) -> None:
        missing = self._absent("mesh", request, wanted, request.mesh_key)
        if missing:
            _require_permission(request)
        self._add(request, "simulate", missing, [], request.places("mesh", missing))

    def _render(self, request: RenderRequest, batch: Sequence[int]) -> None:
        meshes = dict.fromkeys(request.angles[n].mesh for n in batch)
        inputs = [request.folders.cameras().as_posix(), *request.places("normals", meshes)]
        inputs += request.places("mesh", (request.angles[n].mesh for n in batch if request.needs_mesh(n)))
        self._add(request, "render", batch, inputs, request.places("raw", batch))

    def _enter(self, request: RenderRequest) -> int:
        """The take's place in the plan. Raises UsageError where another shot has its name."""
        known, path = self._paths.setdefault(request.name, request.source.path), request.source.path
        if known != path:
            raise UsageError(
                f"{known} and {path} are both called {request.name}, and so would their frames be; "
                "rename one of them"
            )
        return self._takes.setdefault(request, len(self._takes))

    def _absent(
        self, kind: str, request: RenderRequest, frames: Sequence[int], key_of: Callable[[int], Key | None]
    ) -> list[int]:
        """Those frames that neither the store holds nor a job makes; what is stored gets its link."""
        absent = []
        for number, place in zip(frames, request.places(kind, frames), strict=True):
            key = key_of(number)
            if key is not None and self.store.holds(kind, key):
                self._link(kind, key, place)
            elif place not in self._made:
                absent.append(number)
        return absent

    def _link(self, kind: str, key: Key, place: str) -> None:
        self._links[place] = Link(kind, key, place)

    def _add(
        self,
        request: RenderRequest,
        task: str,
        frames: Sequence[int],
        inputs: Sequence[str],
        outputs: Sequence[str],
    ) -> None:
        if frames:
            label = re.sub(r"\W", "_", request.label)
            name = f"{task}_{len(self._jobs):04d}_{label}_{min(frames):04d}_{max(frames):04d}"
            job = Job(name, task, (self._enter(request),), tuple(frames), tuple(inputs), tuple(outputs))
            self._jobs.append(job)
            self._made.update(outputs)


def _require_permission(request: RenderRequest) -> None:
    """Raises UsageError where the shot runs Python files, and may not."""
    if request.source.summary.runs_python:
        from pipeline.flow.python_file import require_permission

        require_permission(request.shot.motion.flow)


def film_key(
    edit: Edit, requests: Sequence[RenderRequest], known: Sequence[PictureKeys | None]
) -> Key | None:
    """The key of a film from those of the pictures of its takes, once all of its cameras are known."""
    frames: list[Key] = []
    for request, keys in zip(requests, known, strict=True):
        if keys is None:
            return None
        frames += [keys[n].frame for n in request.requested]
    shown = [request.shown_as for request in requests]
    return edit.key(requests[0].quality_name, frames, shown)
