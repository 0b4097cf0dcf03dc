"""From what was asked for to a plan: walk back from the pictures to the first thing that is missing."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from pipeline.production.edit import Cut
from pipeline.production.keys import Key
from pipeline.production.plan import Job, Link, Plan, batches, paths
from pipeline.production.store import Store
from pipeline.production.take import PictureKeys, Take


@dataclass
class Planner:
    """Collects the jobs of several takes, and of the film that they are cut into."""

    store: Store
    cores: int
    takes: list[Take] = field(default_factory=list)
    _jobs: list[Job] = field(default_factory=list)
    _links: dict[str, Link] = field(default_factory=dict)
    _targets: list[Path] = field(default_factory=list)
    _cut: Cut | None = None

    def simulate(self, take: Take) -> None:
        """Ask for the mesh frames of a take's shot."""
        self.takes.append(take)
        self._targets += [take.motion_folders.mesh(n) for n in take.requested]
        self._meshes(take, set(take.requested))

    def pictures(self, take: Take, movie: bool = True) -> None:
        """Ask for the finished frames of a take, and for the movie of them."""
        self.takes.append(take)
        keys = take.all_picture_keys(self.store)
        frames = take.requested
        self._targets += [take.folders.frame(take.quality_name, n) for n in frames]
        unfinished = self._absent("frame", take, frames, lambda n: keys[n].frame if keys else None)
        unrendered = self._absent("raw", take, unfinished, lambda n: keys[n].raw if keys else None)
        shown = {take.poses[n].mesh for n in unrendered}
        needs_cameras = bool(unrendered) and keys is None
        if unrendered and keys is not None:
            self._link("cameras", take.cameras_key, take.folders.cameras())
        all_shown = {pose.mesh for pose in take.poses.values()}
        rough = self._absent("normals", take, sorted(shown), take.normals_key)
        self._meshes(take, all_shown if needs_cameras else set(rough))
        self._smooth_normals(take, rough)
        if needs_cameras:
            self._frame_camera(take, sorted(all_shown))
        self._render(take, unrendered)
        self._finish(take, unfinished)
        if movie:
            self._assemble(take, keys)

    def film(self, cut: Cut, quality_name: str) -> None:
        """Ask for the film that the takes asked for before are cut into."""
        path = cut.path(quality_name)
        self._targets.append(path)
        self._cut = cut
        key = film_key(cut, self.takes, self.store)
        if key is not None and self.store.holds("movie", key):
            self._link("movie", key, path)
            return
        inputs = [t.folders.frame(t.quality_name, n) for t in self.takes for n in t.requested]
        frames = tuple(range(1, cut.length(len(inputs)) + 1))
        self._jobs.append(Job(f"film_{quality_name}", "film", -1, frames, paths(inputs), paths([path])))

    def plan(self) -> Plan:
        """What has been collected, every core given to as many renders as there are."""
        renders = sum(job.task == "render" for job in self._jobs)
        threads = max(1, self.cores // renders) if renders else 1
        jobs = [replace(j, threads=threads) if j.task == "render" else j for j in self._jobs]
        return Plan(
            takes=tuple(take.as_data() for take in self.takes),
            film=self._cut.as_data() if self._cut else None,
            jobs=tuple(jobs),
            links=tuple(self._links.values()),
            targets=tuple(dict.fromkeys(paths(self._targets))),
        )

    # One method a kind of job, in the order of the workflow

    def _meshes(self, take: Take, wanted: set[int]) -> None:
        missing = self._absent("mesh", take, sorted(wanted), take.mesh_key)
        folders = take.motion_folders
        planned = {path for job in self._jobs for path in job.outputs}
        missing = [n for n in missing if folders.mesh(n).as_posix() not in planned]
        self._add(take, "simulate", missing, [], [folders.mesh(n) for n in missing])

    def _smooth_normals(self, take: Take, frames: list[int]) -> None:
        folders = take.motion_folders
        planned = {path for job in self._jobs for path in job.outputs}
        frames = [n for n in frames if folders.normals(n).as_posix() not in planned]
        inputs, outputs = [folders.mesh(n) for n in frames], [folders.normals(n) for n in frames]
        self._add(take, "smooth_normals", frames, inputs, outputs)

    def _frame_camera(self, take: Take, shown: list[int]) -> None:
        inputs = [take.motion_folders.mesh(n) for n in shown]
        self._add(take, "frame_camera", sorted(take.poses), inputs, [take.folders.cameras()])

    def _render(self, take: Take, frames: list[int]) -> None:
        for batch in batches(frames, self.cores):
            meshes = dict.fromkeys(take.poses[n].mesh for n in batch)
            inputs = [take.folders.cameras(), *(take.motion_folders.normals(m) for m in meshes)]
            outputs = [take.folders.raw(take.quality_name, n) for n in batch]
            self._add(take, "render", list(batch), inputs, outputs)

    def _finish(self, take: Take, frames: list[int]) -> None:
        for batch in batches(frames, self.cores):
            inputs = [take.folders.raw(take.quality_name, n) for n in batch]
            outputs = [take.folders.frame(take.quality_name, n) for n in batch]
            self._add(take, "finish", list(batch), inputs, outputs)

    def _assemble(self, take: Take, keys: dict[int, PictureKeys] | None) -> None:
        path = take.movie_path
        self._targets.append(path)
        key = take.movie_key([keys[n].frame for n in sorted(take.requested)]) if keys else None
        if key is not None and self.store.holds("movie", key):
            self._link("movie", key, path)
            return
        frames = sorted(take.requested)
        inputs = [take.folders.frame(take.quality_name, n) for n in frames]
        self._add(take, "assemble", frames, inputs, [path])

    # What all of them share

    def _absent(
        self, kind: str, take: Take, frames: Iterable[int], key_of: Callable[[int], Key | None]
    ) -> list[int]:
        """Those frames that the store has no file for; the others get their links."""
        absent = []
        for number in frames:
            key = key_of(number)
            if key is not None and self.store.holds(kind, key):
                self._link(kind, key, _place(kind, take, number))
            else:
                absent.append(number)
        return absent

    def _link(self, kind: str, key: Key, path: Path) -> None:
        self._links[path.as_posix()] = Link(kind, key, path.as_posix())

    def _add(self, take: Take, task: str, frames: list[int], inputs: list[Path], outputs: list[Path]) -> None:
        if frames:
            name = f"{task}_{take.label}_{min(frames):04d}_{max(frames):04d}".replace(".", "_").replace(
                "-", "_"
            )
            index = self.takes.index(take)
            self._jobs.append(Job(name, task, index, tuple(frames), paths(inputs), paths(outputs)))


def film_key(cut: Cut, takes: Sequence[Take], store: Store) -> Key | None:
    """The key of a film, once all of its cameras are known."""
    known = [take.all_picture_keys(store) for take in takes]
    frames: list[Key] = []
    for take, keys in zip(takes, known, strict=True):
        if keys is None:
            return None
        frames += [keys[n].frame for n in take.requested]
    exposures = [take.shot.picture.lights.exposure for take in takes]
    return cut.key(takes[0].quality_name, frames, exposures)


def _place(kind: str, take: Take, number: int) -> Path:
    """Where a frame of a take is shown."""
    if kind == "mesh":
        return take.motion_folders.mesh(number)
    if kind == "normals":
        return take.motion_folders.normals(number)
    if kind == "raw":
        return take.folders.raw(take.quality_name, number)
    return take.folders.frame(take.quality_name, number)
