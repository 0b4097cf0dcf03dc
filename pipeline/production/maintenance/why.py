"""Explain why a frame would be made again: what of its key differs from today's shot file.

A picture records in its header what it was made from, and a mesh its key. The event log tells which run made
a file, and the plan of that run holds the shot file as it was then.
"""

from __future__ import annotations

import contextlib
import json
import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.errors import FlowsculptError
from pipeline.production.request.keys import PictureKeys, raw_header
from pipeline.production.request.render_request import RenderRequest
from pipeline.production.request.shot_source import ShotSource
from pipeline.production.stages import STAGES
from pipeline.production.store.event_log import EventReader, logs_of
from pipeline.production.store.paths import PLANS
from pipeline.production.store.store import Key, Store
from pipeline.shot.yaml.inheritance import inherited
from render.base.errors import RenderError
from render.base.serialise import from_plain
from render.post.image import read_header

_NOT_COMPARED = ("key", "mesh_key", "normals_key", "stages", "temporal_neighbours")
"""Entries of a header that the reasons cover."""

MISSING = object()
"""Stands for a value that one of two data does not have."""


@dataclass(frozen=True)
class Difference:
    """The value at a path of names and indices before and now; MISSING where there is none."""

    path: tuple[str | int, ...]
    before: Any
    now: Any

    def __str__(self) -> str:
        return f"{'.'.join(map(str, self.path))}: {_shown(self.before)} → {_shown(self.now)}"


def differences(before: Any, now: Any, path: tuple[str | int, ...] = ()) -> Iterator[Difference]:
    """Yield the smallest parts of plain data that differ, in the order of `now`."""
    if isinstance(before, dict) and isinstance(now, dict):
        for name in dict.fromkeys([*now, *before]):
            yield from differences(before.get(name, MISSING), now.get(name, MISSING), (*path, name))
    elif isinstance(before, list | tuple) and isinstance(now, list | tuple) and len(before) == len(now):
        for index, (one, other) in enumerate(zip(before, now, strict=True)):
            yield from differences(one, other, (*path, index))
    elif before is MISSING or now is MISSING or before != now:
        yield Difference(path, before, now)


def _shown(value: Any) -> str:
    if value is MISSING:
        return "nothing"
    text = str(list(value) if isinstance(value, tuple) else value)
    return text if len(text) <= 60 else f"{text[:57]}…"


@dataclass(frozen=True)
class Explanation:
    """The state of a finished frame, and why it is not up to date.

    state    done, stale, missing or corrupt
    file     where it is shown
    reasons  in words, from the mesh to the picture
    parts    differences between its header and today's shot
    edits    differences between the shot file that made it and today's, if that run is known
    """

    state: str
    file: Path
    reasons: tuple[str, ...] = ()
    parts: tuple[Difference, ...] = ()
    edits: tuple[Difference, ...] = ()

    def as_data(self) -> dict[str, Any]:
        lists = {name: [str(part) for part in getattr(self, name)] for name in ("reasons", "parts", "edits")}
        return {"state": self.state, "file": str(self.file), **lists}


def explain(request: RenderRequest, number: int, store: Store) -> Explanation:
    """Explain why a finished frame of a request would be made again, or that it would not."""
    return _Frame(request, number, store).explained()


@dataclass(frozen=True)
class _Frame:
    request: RenderRequest
    number: int
    store: Store

    @cached_property
    def _keys(self) -> PictureKeys | None:
        return self.request.picture_keys(self.store)

    @property
    def _mesh(self) -> int:
        """The mesh frame that it shows."""
        return self.request.angles[self.number].mesh

    def explained(self) -> Explanation:
        file, keys = self.request.place("frame", self.number), self._keys
        if keys and self.store.shows("frame", keys[self.number].frame, file):
            return Explanation("done", file)
        if not (self.store.root / file).exists():
            return Explanation("missing", file, (self._first_missing(),))
        try:
            header = read_header(self.store.root / file)
        except RenderError as error:
            return Explanation("corrupt", file, (str(error),))
        reasons, parts = list(self._mesh_reasons(header)), self._parts(header)
        if not reasons and not parts:
            reasons = [self._finish_reason(header)]
        return Explanation("stale", file, tuple(reasons), parts, self._edits())

    def _first_missing(self) -> str:
        """Name the first thing on the way to the frame that is not there."""
        keys = self._keys
        if not self.store.holds("mesh", self.request.mesh_key(self._mesh)):
            return f"its mesh, of frame {self._mesh}, is not simulated yet"
        if keys is None:
            return "the cameras of the shot are not found yet, which looks at all of its meshes"
        if self.store.holds("frame", keys[self.number].frame):
            return "the store has it; the next run shows it again without rendering"
        if self.store.holds("raw", keys[self.number].raw):
            return "it is rendered, and not finished"
        return "it was not rendered as the shot file now asks for it"

    def _mesh_reasons(self, header: Mapping[str, Any]) -> Iterator[str]:
        request = self.request
        for name, recipe in header.get("stages", {}).items():
            now = STAGES[name].recipe if name in STAGES else {}
            for difference in differences(recipe, now):
                yield f"stage {name} is another now: {difference}"
        if header.get("mesh_key") != request.mesh_key(self._mesh):
            first = self._first_changed()
            yield "its mesh differs" + (f", as all meshes do from frame {first} on" if first else "")
        elif header.get("normals_key") != request.normals_key(self._mesh):
            yield "its normals differ: the hard angle, the tessellation, or the version of smooth_normals"

    def _first_changed(self) -> int | None:
        """Return the first frame whose mesh is there and is not today's."""
        for number in sorted(self.request.source.summary.meshes):
            key = _key_in(self.store.root / self.request.place("mesh", number))
            if key is not None and key != self.request.mesh_key(number):
                return number
        return None

    def _parts(self, header: Mapping[str, Any]) -> tuple[Difference, ...]:
        framings = self.request.framings(self.store)
        if framings is None or self._keys is None:
            return ()
        now = raw_header(self.request, self.number, framings[self.number], self._keys[self.number])
        now = json.loads(json.dumps(now))
        compared = {name: part for name, part in now.items() if name not in _NOT_COMPARED}
        before = {name: header[name] for name in compared if name in header}
        return tuple(differences(before, compared))

    def _finish_reason(self, header: Mapping[str, Any]) -> str:
        window = () if self._keys is None else self._keys[self.number].window
        others, before = [n for n in window if n != self.number], header.get("temporal_neighbours", [])
        if before != others:
            return f"it was averaged with frames {before}, and would be with frames {others} now"
        return "what finishes it differs: its denoiser, or the version of finish"

    def _edits(self) -> tuple[Difference, ...]:
        """Return the differences between the shot file of the run that made the picture and today's."""
        made_from = self._source_of_run()
        if made_from is None:
            return ()
        try:
            return tuple(differences(_shot_data(made_from), _shot_data(self.request.source)))
        except FlowsculptError:
            return ()

    def _source_of_run(self) -> ShotSource | None:
        request = self.request
        subject = request.folders.name, request.quality_name, self.number
        for log in reversed(logs_of(self.store.root)):
            for event in EventReader(log).new():
                if (
                    (event.get("shot"), event.get("quality"), event.get("frame")) == subject
                    and event["event"] == "frame"
                    and event["stage"] == "finish"
                    and not event["found"]
                ):
                    return _source_in(self.store.root / PLANS / f"{log.stem}.json", event["job"])
        return None


def _shot_data(source: ShotSource) -> Any:
    return inherited(source.path, source.text, source.settings, dict(source.beside)).data


def _source_in(plan: Path, job: str) -> ShotSource | None:
    """Return the source that a job of a frozen plan read."""
    with contextlib.suppress(OSError, ValueError, KeyError, StopIteration, RenderError):
        data = json.loads(plan.read_text())
        requests = next(each["requests"] for each in data["jobs"] if each["name"] == job)
        return from_plain(ShotSource, data["requests"][requests[0]]["source"])
    return None


def _key_in(mesh: Path) -> Key | None:
    """Return the key in a mesh file, without reading the rest of it; None where it cannot be read."""
    with (
        contextlib.suppress(OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile),
        mesh.open("rb") as file,
        np.load(file, allow_pickle=False) as arrays,
    ):
        return str(arrays["key"])
    return None
