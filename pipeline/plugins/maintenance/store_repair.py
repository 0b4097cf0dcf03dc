"""Repair a root: evict what is damaged, show whole files again, and plan what makes the others again.

What a root holds output of is known by its shots of today, and by the plans of its last runs.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from fnmatch import fnmatch
from functools import cache, partial
from pathlib import Path
from typing import Any

from flowsculpt import FlowsculptError
from flowsculpt.api.commands import Project
from flowsculpt.api.files import remove_file
from flowsculpt.api.frames import (
    Edit,
    Folders,
    FrameKeys,
    FrameRange,
    PipelineStage,
    Plan,
    QualityName,
    RenderRequest,
    Runs,
    Show,
    Store,
)
from flowsculpt.api.options import DEFAULT_QUALITY
from flowsculpt.pipeline.plugins.maintenance.verify import ShownFile, StoredFile, inode, shown_files

FORMS = tuple(name for name, stage in PipelineStage.all().items() if stage.makes == name)
"""Forms of stills, whose stages are named like the kinds of files that they write."""

Film = tuple[Edit, list[RenderRequest]]
"""An edit at one quality, and the requests of its clips."""


def begun_requests(project: Project, warn: Callable[[str], object]) -> Iterator[RenderRequest]:
    """Yield today's shots at every quality begun so far, crops and scales too.

    warn  called with a line about each shot that cannot be read
    """
    for name in Show().shots():
        try:
            path = Show().find_shot(name)
            requests = list(project.rendered_requests(path)) or [project.request(path, DEFAULT_QUALITY)]
        except FlowsculptError as error:
            warn(str(error))
            continue
        yield from requests


def begun_films(project: Project) -> Iterator[Film]:
    """Yield today's edits at every quality begun so far."""
    for name in Show().edits():
        for quality in _qualities(Folders.of_root(project.root).renders / "film"):
            with suppress(FlowsculptError):
                yield project.edit(
                    quality, Show().film if name == Show().film.stem else Show().find_edit(name)
                )


def last_requests(root: Path, count: int) -> Iterator[RenderRequest]:
    """Yield the requests of the last `count` runs of each shot at each quality, from their plans."""
    seen: Counter[tuple[Any, ...]] = Counter()
    runs = Runs(root)
    for run in reversed(runs.planned()):
        for request in runs.requests(run):
            if request.source.subject:
                continue  # one of several subjects, whose shot is in the plan too
            about = request.source.path, request.quality_name, request.frame_source, request.home
            seen[about] += 1
            if seen[about] <= count:
                yield request


def _qualities(folder: Path) -> list[str]:
    """Return the qualities that a folder has folders of."""
    return sorted(
        path.name for path in folder.glob("*") if path.is_dir() and QualityName.of(path.name).is_known
    )


Names = Collection[tuple[str, str]]
"""Kinds and keys of stored files."""


@dataclass(frozen=True)
class Evicted:
    """Losses of a root by damage.

    names    the damaged files of the store
    lost     paths, relative to the root, that showed them
    altered  paths of damaged files outside of the store that no stored file replaces
    """

    names: Names
    lost: tuple[Path, ...]
    altered: tuple[Path, ...]


def evict(store: Store, damaged: Sequence[StoredFile], shown: Sequence[ShownFile]) -> Evicted:
    """Remove damaged files from the store, and what shows them; link whole ones again.

    shown  the damaged files outside of the store

    Only the holder of the root's lock may call this.
    """
    inodes = {inode(file.path) for file in damaged}
    digests = {digest for file in damaged for digest in store.digests.known(file.path)}
    faulty = {file.path for file in shown}
    in_folder = cache(store.digests.in_folder)
    links = by_digest(store, damaged) if faulty else {}
    lost: list[Path] = []
    altered: list[Path] = []
    for path in sorted({*shown_files(store.root), *faulty}):
        known = in_folder(path.parent).get(path.name, ())
        is_link = inode(path) in inodes
        if is_link or digests & set(known):
            if is_link or path in faulty:
                remove_file(path)
            lost.append(path.relative_to(store.root))
        elif path in faulty:
            place = path.relative_to(store.root)
            folder = output_folder(place)
            if name := next((links[digest] for digest in reversed(known) if digest in links), None):
                store.link(*name, place, replace=True)
            elif folder is not None and folder[0].command is None:
                remove_file(path)
            else:
                altered.append(place)
    for file in damaged:
        store.discard(file.kind, file.key)
    return Evicted({(file.kind, file.key) for file in damaged}, tuple(lost), tuple(altered))


def by_digest(store: Store, damaged: Iterable[StoredFile] = ()) -> dict[str, tuple[str, str]]:
    """Return kind and key of the whole files of the store, by their digests."""
    bad = {file.path for file in damaged}
    in_folder = cache(store.digests.in_folder)
    return {
        digest: (kind, key)
        for kind, key, path in store.entries()
        if path not in bad
        for digest in in_folder(path.parent).get(path.name, ())
    }


def repairs(
    project: Project, requests: Iterable[RenderRequest], films: Iterable[Film], evicted: Evicted
) -> Plan:
    """Return the plan that makes evicted files again where they were shown.

    requests, films  those that the root holds output of; the first that asks for a file makes it
    """
    repairs = _Repairs(project, evicted.names, set(evicted.lost))
    for request in requests:
        with suppress(FlowsculptError):  # a shot that is elsewhere now, or may not run its Python files
            if repairs.left:
                repairs.add(request)
    for film in films:
        with suppress(FlowsculptError):
            if repairs.left:
                repairs.add_film(film)
    return repairs.planner.plan()


class _Repairs:
    """Repairs that are planned; `left` are the paths that nothing makes again yet."""

    def __init__(self, project: Project, names: Names, left: set[Path]) -> None:
        self.planner, self.names, self.left, self._film = project.planner(), names, left, False

    def add(self, request: RenderRequest) -> None:
        """Plan what a request makes again."""
        planner, store, every = self.planner, self.planner.store, tuple(request.angles)
        meshes = tuple(dict.fromkeys(angle.mesh for angle in request.angles.values()))
        if lost := self._claim_of_each(request, "mesh", meshes):
            planner.simulate(replace(request, requested=FrameRange(lost)))
        if lost := self._claim_of_each(request, "normals", meshes):
            shown = tuple(n for n, angle in request.angles.items() if angle.mesh in lost)
            planner.surfaces(replace(request, requested=FrameRange(shown)))
        keys = request.keys.pictures(store)
        if keys is None:  # its cameras are lost, by which its pictures are known
            places = zip(every, map(Path, request.places("frame", every)), strict=True)
            shown = tuple(n for n, place in places if place in self.left or (store.root / place).exists())
            if self._claim_one(request.folders.cameras(), "cameras", request.keys.cameras) and shown:
                planner.pictures(replace(request, requested=FrameRange(shown)))
            return
        if lost := self._claim(request, "raw", every, lambda n: keys[n].raw):
            planner.rendered(replace(request, requested=FrameRange(lost)))
        for stage in request.manifest.stages:
            if lost := self._claim(request, "raw", every, partial(_staged_key, keys, stage), stage):
                planner.rendered(replace(request, requested=FrameRange(lost)))
        if lost := self._claim(request, "frame", every, lambda n: keys[n].frame):
            planner.pictures(replace(request, requested=FrameRange(lost)))
        for form in FORMS:
            if lost := self._claim(request, form, every, partial(_still_key, request, keys, form)):
                planner.stills(replace(request, requested=FrameRange(lost)), form)
        for part in (request, request.whole()):
            key = part.keys.movie([keys[n].frame for n in sorted(part.requested)])
            if self._claim_one(part.movie_path, "movie", key):
                planner.pictures(part)
                planner.movie(part)

    def add_film(self, film: Film) -> None:
        """Plan what makes a film again; a plan has room for one."""
        edit, requests = film
        keys = [request.keys.pictures(self.planner.store) for request in requests]
        path = edit.path(requests[0].quality_name)
        if self._film or path not in self.left or None in keys:
            return
        if self._claim_one(path, "movie", edit.key(requests, [each for each in keys if each is not None])):
            for request in requests:
                self.planner.pictures(request)
            self.planner.film(edit, requests)
            self._film = True

    def _claim_of_each(self, request: RenderRequest, kind: str, numbers: Sequence[int]) -> tuple[int, ...]:
        """Return the numbers of lost meshes or normals of any subject, as `_claim` does."""
        lost: set[int] = set()
        for part in request.parts:
            lost.update(
                self._claim(part, kind, numbers, part.keys.mesh if kind == "mesh" else part.keys.normals)
            )
        return tuple(n for n in numbers if n in lost)

    def _claim(
        self,
        request: RenderRequest,
        kind: str,
        numbers: Sequence[int],
        key_of: Callable[[int], str],
        stage: str = "",
    ) -> tuple[int, ...]:
        """Return the numbers whose lost files the request makes, and take these from those left.

        stage  the stage of a plug-in that makes them
        """
        places = zip(numbers, map(Path, request.places(stage or kind, numbers)), strict=True)
        return tuple(
            n for n, place in places if place in self.left and self._claim_one(place, kind, key_of(n))
        )

    def _claim_one(self, place: Path, kind: str, key: str) -> bool:
        if place not in self.left or (kind, key) not in self.names:
            return False
        self.left.discard(place)
        return True


def _staged_key(keys: Mapping[int, FrameKeys], stage: str, number: int) -> str:
    return keys[number].staged[stage]


def _still_key(request: RenderRequest, keys: Mapping[int, FrameKeys], form: str, number: int) -> str:
    return request.keys.still(form, keys[number].frame)


@dataclass(frozen=True)
class OutputFolder:
    """A folder that holds output.

    pattern  its path, relative to the root: {NAME} stands for any name, ** for any folders
    holds    what lies there
    command  writes it again; {quality} stands for -q, --scale and --crop, and … for options that nobody
             keeps. None for what a run makes again when it needs it.
    files    a pattern of the names of its files, where another row has the others
    """

    pattern: str
    holds: str
    command: str | None
    files: str = "*"

    def match(self, path: Path) -> Mapping[str, str] | None:
        """Return the names in braces where a file lies in the folder, else None."""
        if not fnmatch(path.name, self.files):
            return None
        expression = re.escape(self.pattern).replace(r"\*\*", ".+")
        expression = re.sub(r"\\{(\w+)\\}", r"(?P<\1>[^/]+)", expression)
        match = re.fullmatch(expression, path.parent.as_posix())
        return match and match.groupdict()


OUTPUTS = (
    OutputFolder("renders/published/**", "published versions", "reproduce …"),
    OutputFolder("renders/repeated/**", "published versions, made again", "reproduce …"),
    OutputFolder("renders/review/**", "review pages", "review …"),
    OutputFolder("renders/**/meshes", "mesh frames", None),
    OutputFolder("renders/**/normals", "meshes ready to be rendered", None),
    OutputFolder("renders/**/meshes/{subject}", "mesh frames of a subject", None),
    OutputFolder("renders/**/normals/{subject}", "meshes of a subject ready to be rendered", None),
    OutputFolder("renders/**", "cameras", None, files="*.cameras.json"),
    OutputFolder("renders/**/raw", "rendered frames", None),
    OutputFolder("renders/**/statistics", "seconds of rendering", None),
    OutputFolder("renders/wedge/{shot}", "sheets of wedges", "wedge {shot} …"),
    OutputFolder("renders/wedge/{shot}/**", "cells of wedges, each as a shot's folder", "wedge {shot} …"),
    OutputFolder("renders/turntable/**", "turntables, each as a shot's folder", "turntable …"),
    OutputFolder(
        "renders/edit/{shot}/{name}/**", "a shot in an edit with a picture of its own", "film {name} …"
    ),
    OutputFolder("renders/film/preview", "animatics of films", "preview {name} …"),
    OutputFolder("renders/film/{quality}", "films", "film {name} {quality}"),
    OutputFolder("renders/film/{quality}/deliver", "deliverables of films", "deliver {quality} …"),
    OutputFolder("renders/{shot}", "figures", "figures {shot}", files="*.figures.*"),
    OutputFolder("renders/{shot}", "curves", "curves {shot}", files="*.curves.*"),
    OutputFolder("renders/{shot}/preview", "previews", "preview {shot} …"),
    OutputFolder("renders/{shot}/models", "meshes for other programs", "export … {shot} …"),
    OutputFolder("renders/{shot}/usd", "stages for other programs", "export usd {shot}"),
    OutputFolder("renders/{shot}/web", "pages that play a sculpture", "export web {shot} …"),
    OutputFolder("renders/{shot}/vat", "vertex animation textures", "export vat {shot} …"),
    OutputFolder("renders/{shot}/{quality}", "contact sheets", "sheet {shot} {quality} …", files="*.sheet.*"),
    OutputFolder("renders/{shot}/{quality}", "movies", "render {shot} {quality} …"),
    OutputFolder("renders/{shot}/{quality}/frames", "finished frames", "render {shot} {quality}"),
    OutputFolder("renders/{shot}/{quality}/relight/**", "relit frames", "relight {shot} {quality} …"),
    OutputFolder("renders/{shot}/{quality}/deliver", "deliverables", "deliver {shot} {quality} …"),
    OutputFolder(
        "renders/{shot}/{quality}/{plugin}.{stage}", "what a plug-in makes of rendered frames", None
    ),
    OutputFolder("renders/{shot}/{quality}/{form}", "stills", "stills {shot} {quality} --as {form}"),
)
"""Every folder that holds output; the first row that matches a file counts."""


def output_folder(path: Path) -> tuple[OutputFolder, Mapping[str, str]] | None:
    """Return the folder of an output, and the names in its pattern; None for a file elsewhere."""
    rows = ((row, row.match(path)) for row in OUTPUTS)
    return next(((row, names) for row, names in rows if names is not None), None)


def remedy(path: Path) -> str:
    """Return the line that says how a damaged file, given relative to its root, is made again."""
    known = output_folder(path)
    if known is None:
        return f"{path}: the command that wrote it makes it again"
    folder, names = known
    words = {"name": path.stem, **names}
    if QualityName.of(words.get("quality", "")).is_known:
        words["quality"] = QualityName.of(words["quality"]).options
    if folder.command is None:
        return f"{path}: the next run that needs it makes it again"
    command, more, _ = folder.command.format(**words).partition(" …")
    options = ", with the options that it was made with," if more else ""
    return f"{path}: flowsculpt {command}{options} makes it again"
