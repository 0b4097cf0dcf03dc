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
from pipeline.production.request.edit import Cut
from pipeline.production.request.picture_keys import Keyring
from pipeline.production.request.render_request import Take
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
    _takes: dict[Take, int] = field(default_factory=dict)
    _paths: dict[str, Path] = field(default_factory=dict)
    _made: set[str] = field(default_factory=set)
    _jobs: list[Job] = field(default_factory=list)
    _links: dict[str, Link] = field(default_factory=dict)
    _targets: list[str] = field(default_factory=list)
    _keyrings: dict[Take, Keyring | None] = field(default_factory=dict)
    _cut: Cut | None = None

    def simulate(self, take: Take) -> None:
        """Ask for the mesh frames of a take's shot."""
        self._enter(take)
        self._targets += take.places("mesh", take.requested)
        self._meshes(take, take.requested)

    def surfaces(self, take: Take) -> None:
        """Ask for what pictures of a take are made from: meshes with normals, and its cameras."""
        self._enter(take)
        self._surfaces(take, take.requested, cameras_known=self._keys(take) is not None)
        self._targets += [take.folders.cameras().as_posix(), *take.places("normals", take.requested)]

    def pictures(self, take: Take) -> None:
        """Ask for the finished frames of a take."""
        self._enter(take)
        keys = self._keys(take)
        frames = take.requested
        self._targets += take.places("frame", frames)
        unfinished = self._absent("frame", take, frames, lambda n: keys[n].frame if keys else None)
        asked = set(frames).__contains__
        around = {n: keys[n].window if keys else take.window(n, asked) for n in unfinished}
        needed = list(dict.fromkeys([*unfinished, *(n for window in around.values() for n in window)]))
        unrendered = self._absent("raw", take, needed, lambda n: keys[n].raw if keys else None)
        if unrendered:
            self._surfaces(take, unrendered, cameras_known=keys is not None)
        for batch in self._batches(unrendered):
            self._render(take, batch)
        for batch in self._batches(unfinished):
            seen = sorted({n for number in batch for n in around[number]})
            self._add(take, "finish", batch, take.places("raw", seen), take.places("frame", batch))

    def stills(self, take: Take, form: str) -> None:
        """Ask for the frames of a take as a display shows them."""
        self.pictures(take)
        keys = self._keys(take)
        self._targets += take.places(form, take.requested)
        absent = self._absent(
            form, take, take.requested, lambda n: take.still_key(form, keys[n].frame) if keys else None
        )
        for batch in self._batches(absent):
            self._add(take, form, batch, take.places("frame", batch), take.places(form, batch))

    def movie(self, take: Take) -> None:
        """Ask for the movie of a take, whose frames are there or have been asked for."""
        self._enter(take)
        keys = self._keys(take)
        path, frames = take.movie_path.as_posix(), sorted(take.requested)
        self._targets.append(path)
        key = take.movie_key([keys[n].frame for n in frames]) if keys else None
        if key is not None and self.store.holds("movie", key):
            self._link("movie", key, path)
        elif path not in self._made:
            self._add(take, "assemble", frames, take.places("frame", frames), [path])

    def film(self, cut: Cut, takes: Sequence[Take]) -> None:
        """Ask for the film of takes, whose frames are there or have been asked for."""
        path = cut.path(takes[0].quality_name).as_posix()
        self._targets.append(path)
        self._cut = cut
        key = film_key(cut, takes, [self._keys(take) for take in takes])
        if key is not None and self.store.holds("movie", key):
            self._link("movie", key, path)
            return
        inputs = tuple(place for take in takes for place in take.places("frame", take.requested))
        frames = tuple(range(1, cut.length + 1))
        self._jobs.append(Job("film", "film", tuple(map(self._enter, takes)), frames, inputs, (path,)))

    def plan(self) -> Plan:
        """What has been collected, the cores dealt out among the simulations and then among the renders."""
        for keys in self._keyrings.values():
            if keys is not None:
                keys.note()
        jobs = dealt_out(self._jobs, self.cores, self.share)
        return Plan(
            takes=tuple(take.as_data() for take in self._takes),
            film=self._cut.as_data() if self._cut else None,
            jobs=tuple(self._measured(jobs)),
            links=tuple(self._links.values()),
            targets=tuple(dict.fromkeys(self._targets)),
            notes=tuple(dict.fromkeys(self.notes)),
        )

    def _keys(self, take: Take) -> Keyring | None:
        """Those of its pictures, which nothing changes while a plan is made."""
        if take not in self._keyrings:
            self._keyrings[take] = take.picture_keys(self.store)
        return self._keyrings[take]

    def _measured(self, jobs: Sequence[Job]) -> list[Job]:
        """Jobs, those that render asking for what earlier pictures took."""
        unknown, takes = UNMEASURED if self.share else HERE, list(self._takes)

        @cache
        def known(place: int) -> Experience | None:
            take = takes[place]
            return Experience.of(self.store.root / take.folders.statistics(take.quality_name, 0).parent)

        def needs(job: Job) -> Needs:
            experience = known(job.takes[0]) if job.task == "render" else None
            return experience.needs(len(job.frames), job.threads) if experience else unknown

        return [replace(job, needs=needs(job)) for job in jobs]

    def _batches(self, frames: Sequence[int]) -> list[tuple[int, ...]]:
        return batches(frames, self.cores, self.share.frames if self.share else FEWEST)

    def _surfaces(self, take: Take, unrendered: Sequence[int], cameras_known: bool) -> None:
        """What rendering needs: the normals of the meshes shown, and cameras, which look at all of them."""
        shown = sorted({take.poses[n].mesh for n in unrendered})
        rough = self._absent("normals", take, shown, take.normals_key)
        cameras = take.folders.cameras().as_posix()
        all_shown = sorted({pose.mesh for pose in take.poses.values()})
        if cameras_known:
            self._link("cameras", take.cameras_key, cameras)
        if any(map(take.follows_flow, unrendered)):
            _require_permission(take)
        needed = {take.poses[n].mesh for n in unrendered if take.needs_mesh(n)}
        self._meshes(take, sorted({*rough, *needed}) if cameras_known else all_shown)
        self._add(take, "smooth_normals", rough, take.places("mesh", rough), take.places("normals", rough))
        if not cameras_known and cameras not in self._made:
            self._add(take, "frame_camera", sorted(take.poses), take.places("mesh", all_shown), [cameras])

    def _meshes(self, take: Take, wanted: Sequence[int]) -> None:
        missing = self._absent("mesh", take, wanted, take.mesh_key)
        if missing:
            _require_permission(take)
        self._add(take, "simulate", missing, [], take.places("mesh", missing))

    def _render(self, take: Take, batch: Sequence[int]) -> None:
        meshes = dict.fromkeys(take.poses[n].mesh for n in batch)
        inputs = [take.folders.cameras().as_posix(), *take.places("normals", meshes)]
        inputs += take.places("mesh", (take.poses[n].mesh for n in batch if take.needs_mesh(n)))
        self._add(take, "render", batch, inputs, take.places("raw", batch))

    def _enter(self, take: Take) -> int:
        """The take's place in the plan. Raises UsageError where another shot has its name."""
        known, path = self._paths.setdefault(take.name, take.script.path), take.script.path
        if known != path:
            raise UsageError(
                f"{known} and {path} are both called {take.name}, and so would their frames be; rename one "
                "of them"
            )
        return self._takes.setdefault(take, len(self._takes))

    def _absent(
        self, kind: str, take: Take, frames: Sequence[int], key_of: Callable[[int], Key | None]
    ) -> list[int]:
        """Those frames that neither the store holds nor a job makes; what is stored gets its link."""
        absent = []
        for number, place in zip(frames, take.places(kind, frames), strict=True):
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
        take: Take,
        task: str,
        frames: Sequence[int],
        inputs: Sequence[str],
        outputs: Sequence[str],
    ) -> None:
        if frames:
            label = re.sub(r"\W", "_", take.label)
            name = f"{task}_{len(self._jobs):04d}_{label}_{min(frames):04d}_{max(frames):04d}"
            job = Job(name, task, (self._enter(take),), tuple(frames), tuple(inputs), tuple(outputs))
            self._jobs.append(job)
            self._made.update(outputs)


def _require_permission(take: Take) -> None:
    """Raises UsageError where the shot runs Python files, and may not."""
    if take.script.outline.runs_python:
        from pipeline.flow.python_file import require_permission

        require_permission(take.shot.motion.flow)


def film_key(cut: Cut, takes: Sequence[Take], known: Sequence[Keyring | None]) -> Key | None:
    """The key of a film from those of the pictures of its takes, once all of its cameras are known."""
    frames: list[Key] = []
    for take, keys in zip(takes, known, strict=True):
        if keys is None:
            return None
        frames += [keys[n].frame for n in take.requested]
    shown = [take.shown_as for take in takes]
    return cut.key(takes[0].quality_name, frames, shown)
