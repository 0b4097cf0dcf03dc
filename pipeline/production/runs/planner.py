"""From what was asked for to a plan: walk back from the pictures to the first thing that is missing."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path

from pipeline.errors import UsageError
from pipeline.production.farm.needs import HERE, UNMEASURED, Experience, Needs
from pipeline.production.farm.profile import Share
from pipeline.production.files.store import Store
from pipeline.production.runs.plan import FEWEST, Job, Link, Plan, batches, dealt_out, paths
from pipeline.production.takes.edit import Cut
from pipeline.production.takes.keyring import Keyring
from pipeline.production.takes.keys import Key
from pipeline.production.takes.take import Take


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
    _takes: list[Take] = field(default_factory=list)
    _made: set[str] = field(default_factory=set)
    _jobs: list[Job] = field(default_factory=list)
    _links: dict[str, Link] = field(default_factory=dict)
    _targets: list[Path] = field(default_factory=list)
    _keyrings: dict[Take, Keyring | None] = field(default_factory=dict)
    _cut: Cut | None = None

    def simulate(self, take: Take) -> None:
        """Ask for the mesh frames of a take's shot."""
        self._enter(take)
        self._targets += [take.motion_folders.mesh(n) for n in take.requested]
        self._meshes(take, take.requested)

    def surfaces(self, take: Take) -> None:
        """Ask for what pictures of a take are made from: meshes with normals, and its cameras."""
        self._enter(take)
        self._surfaces(take, take.requested, cameras_known=self._keys(take) is not None)
        self._targets += [take.folders.cameras(), *(take.motion_folders.normals(n) for n in take.requested)]

    def pictures(self, take: Take) -> None:
        """Ask for the finished frames of a take."""
        self._enter(take)
        keys = self._keys(take)
        frames = take.requested
        self._targets += [take.folders.frame(take.quality_name, n) for n in frames]
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
            inputs = [take.folders.raw(take.quality_name, n) for n in seen]
            outputs = [take.folders.frame(take.quality_name, n) for n in batch]
            self._add(take, "finish", batch, inputs, outputs)

    def stills(self, take: Take, form: str) -> None:
        """Ask for the frames of a take as a display shows them."""
        self.pictures(take)
        keys = self._keys(take)
        self._targets += [take.still_path(form, n) for n in take.requested]
        absent = []
        for number in take.requested:
            key = take.still_key(form, keys[number].frame) if keys else None
            if key is not None and self.store.holds(form, key):
                self._link(form, key, take.still_path(form, number))
            else:
                absent.append(number)
        for batch in self._batches(absent):
            inputs = [take.folders.frame(take.quality_name, n) for n in batch]
            self._add(take, form, batch, inputs, [take.still_path(form, n) for n in batch])

    def movie(self, take: Take) -> None:
        """Ask for the movie of a take, whose frames are there or have been asked for."""
        self._enter(take)
        keys = self._keys(take)
        path, frames = take.movie_path, sorted(take.requested)
        self._targets.append(path)
        key = take.movie_key([keys[n].frame for n in frames]) if keys else None
        if key is not None and self.store.holds("movie", key):
            self._link("movie", key, path)
        elif path.as_posix() not in self._made:
            inputs = [take.folders.frame(take.quality_name, n) for n in frames]
            self._add(take, "assemble", frames, inputs, [path])

    def film(self, cut: Cut, takes: Sequence[Take]) -> None:
        """Ask for the film of takes, whose frames are there or have been asked for."""
        path = cut.path(takes[0].quality_name)
        self._targets.append(path)
        self._cut = cut
        key = film_key(cut, takes, [self._keys(take) for take in takes])
        if key is not None and self.store.holds("movie", key):
            self._link("movie", key, path)
            return
        inputs = [t.folders.frame(t.quality_name, n) for t in takes for n in t.requested]
        frames = tuple(range(1, cut.length + 1))
        job = Job("film", "film", tuple(self._enter(t) for t in takes), frames, paths(inputs), paths([path]))
        self._jobs.append(job)

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
            targets=tuple(dict.fromkeys(paths(self._targets))),
            notes=tuple(dict.fromkeys(self.notes)),
        )

    def _keys(self, take: Take) -> Keyring | None:
        """Those of its pictures, which nothing changes while a plan is made."""
        if take not in self._keyrings:
            self._keyrings[take] = take.picture_keys(self.store)
        return self._keyrings[take]

    def _measured(self, jobs: Sequence[Job]) -> list[Job]:
        """Jobs, those that render asking for what earlier pictures took."""
        unknown = UNMEASURED if self.share else HERE

        @cache
        def known(place: int) -> Experience | None:
            take = self._takes[place]
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
        cameras = take.folders.cameras()
        all_shown = sorted({pose.mesh for pose in take.poses.values()})
        if cameras_known:
            self._link("cameras", take.cameras_key, cameras)
        if any(map(take.follows_flow, unrendered)):
            _require_permission(take)
        needed = {take.poses[n].mesh for n in unrendered if take.needs_mesh(n)}
        self._meshes(take, sorted({*rough, *needed}) if cameras_known else all_shown)
        folders = take.motion_folders
        inputs, outputs = [folders.mesh(n) for n in rough], [folders.normals(n) for n in rough]
        self._add(take, "smooth_normals", rough, inputs, outputs)
        if not cameras_known and cameras.as_posix() not in self._made:
            inputs = [folders.mesh(n) for n in all_shown]
            self._add(take, "frame_camera", sorted(take.poses), inputs, [cameras])

    def _meshes(self, take: Take, wanted: Sequence[int]) -> None:
        missing = self._absent("mesh", take, wanted, take.mesh_key)
        if missing:
            _require_permission(take)
        self._add(take, "simulate", missing, [], [take.motion_folders.mesh(n) for n in missing])

    def _render(self, take: Take, batch: Sequence[int]) -> None:
        meshes = dict.fromkeys(take.poses[n].mesh for n in batch)
        inputs = [take.folders.cameras(), *(take.motion_folders.normals(m) for m in meshes)]
        inputs += [take.motion_folders.mesh(take.poses[n].mesh) for n in batch if take.needs_mesh(n)]
        outputs = [take.folders.raw(take.quality_name, n) for n in batch]
        self._add(take, "render", batch, inputs, outputs)

    def _enter(self, take: Take) -> int:
        """The take's place in the plan. Raises UsageError where another shot has its name."""
        for other in self._takes:
            if other.name == take.name and other.script.path != take.script.path:
                raise UsageError(
                    f"{other.script.path} and {take.script.path} are both called {take.name}, and so would "
                    "their frames be; rename one of them"
                )
        if take not in self._takes:
            self._takes.append(take)
        return self._takes.index(take)

    def _absent(
        self, kind: str, take: Take, frames: Iterable[int], key_of: Callable[[int], Key | None]
    ) -> list[int]:
        """Those frames that neither the store holds nor a job makes; what is stored gets its link."""
        absent = []
        for number in frames:
            key, place = key_of(number), take.place(kind, number)
            if key is not None and self.store.holds(kind, key):
                self._link(kind, key, place)
            elif place.as_posix() not in self._made:
                absent.append(number)
        return absent

    def _link(self, kind: str, key: Key, path: Path) -> None:
        self._links[path.as_posix()] = Link(kind, key, path.as_posix())

    def _add(
        self,
        take: Take,
        task: str,
        frames: Sequence[int],
        inputs: list[Path],
        outputs: list[Path],
    ) -> None:
        if frames:
            label = re.sub(r"\W", "_", take.label)
            name = f"{task}_{len(self._jobs):04d}_{label}_{min(frames):04d}_{max(frames):04d}"
            takes = (self._enter(take),)
            job = Job(name, task, takes, tuple(frames), paths(inputs), paths(outputs))
            self._jobs.append(job)
            self._made.update(paths(outputs))


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
