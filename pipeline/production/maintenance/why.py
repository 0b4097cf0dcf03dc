"""Why a frame would be made again: what of its key differs between what is there and today's shot file.

A picture tells what it was made from in its header; a mesh tells its key; and the run that made a file is in
the event log, with the shot file as it was then in that run's plan.
"""

from __future__ import annotations

import contextlib
import json
import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.errors import FlowsculptError
from pipeline.production.keys.digest import Key
from pipeline.production.keys.stages import STAGES
from pipeline.production.maintenance.differences import Difference, differences
from pipeline.production.request.frame_keys import raw_header
from pipeline.production.request.render_request import RenderRequest
from pipeline.production.request.shot_source import ShotSource
from pipeline.production.store.event_log import EventReader, logs_of
from pipeline.production.store.paths import PLANS
from pipeline.production.store.store import Store
from pipeline.shot.yaml.inheritance import inherited
from render.base.errors import RenderError
from render.base.serialise import from_plain
from render.post.image import read_header

_SAID_OTHERWISE = ("key", "mesh_key", "normals_key", "stages", "steadied_with")


@dataclass(frozen=True)
class Answer:
    """What is known of a frame.

    state    done, stale, missing or corrupt
    reasons  in words, the first thing on the way to the picture first
    parts    of what the picture shows: what differs between its header and today's shot
    edits    between the shot file that made it and today's, as far as the run that made it is known
    """

    state: str
    place: Path
    reasons: tuple[str, ...] = ()
    parts: tuple[Difference, ...] = ()
    edits: tuple[Difference, ...] = ()

    def as_data(self) -> dict[str, Any]:
        return {
            "state": self.state,
            "file": str(self.place),
            "reasons": list(self.reasons),
            "parts": [str(part) for part in self.parts],
            "edits": [str(edit) for edit in self.edits],
        }


@dataclass(frozen=True)
class Question:
    """Why a finished frame of a take would be made again, or not."""

    request: RenderRequest
    number: int
    store: Store

    @property
    def _root(self) -> Path:
        return self.store.root

    def answer(self) -> Answer:
        place = self.request.folders.frame(self.request.quality_name, self.number)
        keys = self.request.picture_keys(self.store)
        if keys and self.store.shows("frame", keys[self.number].frame, place):
            return Answer("done", place)
        if not (self._root / place).exists():
            return Answer("missing", place, tuple(self._unmade()))
        try:
            header = read_header(self._root / place)
        except RenderError as error:
            return Answer("corrupt", place, (str(error),))
        reasons, parts = list(self._of_mesh(header)), self._parts(header)
        if not reasons and not parts:
            reasons = list(self._of_finishing(header))
        return Answer("stale", place, tuple(reasons), parts, self._edits())

    def _unmade(self) -> Iterator[str]:
        """What there is of a picture that is not there."""
        request, mesh = self.request, self.request.angles[self.number].mesh
        keys = request.picture_keys(self.store)
        if not self.store.holds("mesh", request.mesh_key(mesh)):
            yield f"its mesh, of frame {mesh}, is not simulated yet"
        if keys is None:
            yield "the cameras of the shot are not found yet, which looks at all of its meshes"
        elif self.store.holds("frame", keys[self.number].frame):
            yield "the store has it; the next run shows it again without rendering"
        elif self.store.holds("raw", keys[self.number].raw):
            yield "it is rendered, and not finished"
        else:
            yield "it was not rendered as the shot file now asks for it"

    def _of_mesh(self, header: Mapping[str, Any]) -> Iterator[str]:
        request, mesh = self.request, self.request.angles[self.number].mesh
        for name, recipe in header.get("stages", {}).items():
            now = STAGES[name].recipe if name in STAGES else {}
            for difference in differences(recipe, now):
                yield f"stage {name} is another now: {difference}"
        if header.get("mesh_key") != request.mesh_key(mesh):
            first = self._first_changed()
            yield "its mesh differs" + (f", as all meshes do from frame {first} on" if first else "")
        elif header.get("normals_key") != request.normals_key(mesh):
            yield "its normals differ: the hard angle, the tessellation, or the version of smooth_normals"

    def _first_changed(self) -> int | None:
        """The first frame whose mesh is there and is not today's."""
        for number in sorted(self.request.source.summary.meshes):
            key = _key_in(self._root / self.request.motion_folders.mesh(number))
            if key is not None and key != self.request.mesh_key(number):
                return number
        return None

    def _parts(self, header: Mapping[str, Any]) -> tuple[Difference, ...]:
        framings, keys = self.request.framings(self.store), self.request.picture_keys(self.store)
        if framings is None or keys is None:
            return ()
        now = raw_header(self.request, self.number, framings[self.number], keys[self.number])
        now = json.loads(json.dumps(now))
        asked = {name: part for name, part in now.items() if name not in _SAID_OTHERWISE}
        return tuple(differences({name: header[name] for name in asked if name in header}, asked))

    def _of_finishing(self, header: Mapping[str, Any]) -> Iterator[str]:
        keys = self.request.picture_keys(self.store)
        window = () if keys is None else keys[self.number].window
        others = [n for n in window if n != self.number]
        before = header.get("steadied_with", [])
        if before != others:
            yield f"light is taken in from frames {others} now, and was from {before}"
        else:
            yield "what finishes it differs: its denoiser, or the version of finish"

    def _edits(self) -> tuple[Difference, ...]:
        """Between today's shot file and the one of the run that made the picture."""
        made_by = self._script_of_run()
        if made_by is None:
            return ()
        try:
            return tuple(differences(_data_of(made_by), _data_of(self.request.source)))
        except FlowsculptError:
            return ()

    def _script_of_run(self) -> ShotSource | None:
        request = self.request
        for log in reversed(logs_of(self._root)):
            for event in EventReader(log).new():
                about = event.get("shot"), event.get("quality"), event.get("frame")
                if (
                    event["event"] == "frame"
                    and event["stage"] == "finish"
                    and not event["found"]
                    and about == (request.folders.name, request.quality_name, self.number)
                ):
                    return _script_in(self._root / PLANS / f"{log.stem}.json", event["job"])
        return None


def _data_of(source: ShotSource) -> Any:
    return inherited(source.path, source.text, source.settings, dict(source.beside)).data


def _script_in(plan: Path, job: str) -> ShotSource | None:
    """The shot file as a job of a frozen plan had it."""
    with contextlib.suppress(OSError, ValueError, KeyError, StopIteration):
        data = json.loads(plan.read_text())
        requests = next(each["requests"] for each in data["jobs"] if each["name"] == job)
        return from_plain(ShotSource, data["requests"][requests[0]]["source"])
    return None


def _key_in(mesh: Path) -> Key | None:
    """The key that a mesh tells, without reading the rest of it; None where it cannot be read."""
    with (
        contextlib.suppress(OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile),
        mesh.open("rb") as file,
        np.load(file, allow_pickle=False) as arrays,
    ):
        return str(arrays["key"])
    return None
