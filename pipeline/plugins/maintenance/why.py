"""Explain why a frame would be made again: what of its key differs from today's shot file.

A picture records in its header what it was made from, and a mesh its key. The history tells which run made
a file, and the plan of that run holds the shot file as it was then.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import Any

from flowsculpt import FlowsculptError
from flowsculpt.api.commands import Project
from flowsculpt.api.frames import (
    FrameKeys,
    FrameRange,
    PipelineStage,
    RenderRequest,
    Runs,
    ShotSource,
    StoredFiles,
)
from flowsculpt.api.pictures import RenderError, read_header
from flowsculpt.api.shots import WrittenShot, YamlSource, to_yaml

MISSING = object()
"""Stands for a value that one of two data does not have."""

DIGITS = 6
"""Significant digits of numbers; all are shown of two that differ only beyond them."""


@dataclass(frozen=True)
class Difference:
    """The value at a path before and now; MISSING where there is none."""

    path: tuple[Any, ...]
    before: Any
    now: Any

    def __str__(self) -> str:
        before, now = _shown(self.before, DIGITS), _shown(self.now, DIGITS)
        if before == now:
            before, now = _shown(self.before), _shown(self.now)
        return f"{'.'.join(map(str, self.path))}: {before} → {now}"


def differences(before: Any, now: Any, path: tuple[Any, ...] = ()) -> Iterator[Difference]:
    """Yield the smallest parts of plain data that differ, in the order of `now`.

    Lists are compared from both ends, so that an item added or removed is one difference.
    """
    if isinstance(before, dict) and isinstance(now, dict):
        for name in dict.fromkeys([*now, *before]):
            yield from differences(before.get(name, MISSING), now.get(name, MISSING), (*path, name))
    elif isinstance(before, list | tuple) and isinstance(now, list | tuple):
        yield from _items(list(before), list(now), path)
    elif before is MISSING or now is MISSING or before != now:
        yield Difference(path, before, now)


@dataclass(frozen=True)
class FileEdit:
    """A value that differs between the shot file that made a picture and today's.

    place  file and line where it stands now, or stood before if it is gone
    """

    place: str
    difference: Difference

    def __str__(self) -> str:
        return f"{self.place}: {self.difference}"


def file_edits(before: ShotSource, now: ShotSource, root: Path) -> Iterator[FileEdit]:
    """Yield the differences between the shot files of two sources, except the options `--set`.

    root  the folder to which their paths are relative

    Yields none where one of them cannot be read.
    """
    try:
        old, new = _read(before), _read(now)
    except FlowsculptError:
        return
    for difference in differences(old.data, new.data):
        file, line, *_ = (old if difference.now is MISSING else new).spot_of(difference.path)
        shown = Path(file).relative_to(root) if Path(file).is_relative_to(root) else Path(file)
        yield FileEdit(f"{shown}:{line}", difference)


def option_differences(before: ShotSource, now: ShotSource) -> Iterator[str]:
    """Yield the differences between the options `--set` of two sources, in words."""
    for setting in before.settings:
        if setting not in now.settings:
            yield f"it was made with --set {setting}, which is not given now"
    for setting in now.settings:
        if setting not in before.settings:
            yield f"--set {setting} is given now, and was not when it was made"


def _items(before: list[Any], now: list[Any], path: tuple[Any, ...]) -> Iterator[Difference]:
    """Yield the differences between two lists: equal items at both ends are left out."""
    shorter = min(len(before), len(now))
    first = next((i for i in range(shorter) if before[i] != now[i]), shorter)
    last = next((i for i in range(shorter - first) if before[-1 - i] != now[-1 - i]), shorter - first)
    middle = before[first : len(before) - last], now[first : len(now) - last]
    for index, (one, other) in enumerate(zip_longest(*middle, fillvalue=MISSING), first):
        yield from differences(one, other, (*path, index))


def _shown(value: Any, digits: int | None = None) -> str:
    """Return a value in YAML, its numbers rounded to so many significant digits."""
    if value is MISSING:
        return "nothing"
    text = "nothing" if value is None else to_yaml(_rounded(value, digits))
    return text if len(text) <= 60 else f"{text[:57]}…"


def _rounded(value: Any, digits: int | None) -> Any:
    if isinstance(value, dict):
        return {name: _rounded(item, digits) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [_rounded(item, digits) for item in value]
    return float(f"{value:.{digits}g}") if isinstance(value, float) and digits else value


def _read(source: ShotSource) -> YamlSource:
    """Return the shot files of a source, without the settings of the command line."""
    return WrittenShot.read(source.path, source.text, beside=dict(source.beside)).source


_NOT_COMPARED = ("key", "mesh_key", "normals_key", "inputs", "stages", "temporal_neighbours")
"""Entries of a header that the reasons cover."""

_SENTENCES = {
    "variant": "it was rendered by another variant of Mitsuba",
    "look": "its look differs",
    "lights": "its lights differ",
    "stage": "its stage differs",
    "settings": "the settings of its quality differ",
    "dicing": "its dicing differs",
    "aovs": "its AOVs differ",
    "shutter": "its shutter differs",
    "working_space": "its working space differs",
    "angle": "its turntable differs",
    "seed": "its noise has another seed: the shot has another name",
}
"""The reason for a difference, by entries of a header."""


@dataclass(frozen=True)
class Explanation:
    """The state of a finished frame, and why it is not up to date.

    state    done, stale, unframed (stale if its camera moves), missing or corrupt
    file     where it is shown
    reasons  in words, from the mesh to the picture
    parts    differences between its header and today's shot
    edits    differences between the shot files that made it and today's, if that run is known
    options  differences between the options `--set` of that run and those of now, in words
    """

    state: str
    file: Path
    reasons: tuple[str, ...] = ()
    parts: tuple[Difference, ...] = ()
    edits: tuple[FileEdit, ...] = ()
    options: tuple[str, ...] = ()

    def as_data(self) -> dict[str, Any]:
        names = ("reasons", "parts", "edits", "options")
        lists = {name: [str(part) for part in getattr(self, name)] for name in names}
        return {"state": self.state, "file": str(self.file), **lists}


def explain(project: Project, request: RenderRequest, number: int) -> Explanation:
    """Explain why a finished frame of a request would be made again, or that it would not."""
    return _Frame(project, request, number).explained()


def first_undone(project: Project, request: RenderRequest) -> int | None:
    """Return the first frame of a request that is not up to date; None if all are."""
    known = project.known_pictures(request)
    return next((number for number in sorted(request.requested) if known.state(number) != "done"), None)


class _Frame:
    def __init__(self, project: Project, request: RenderRequest, number: int) -> None:
        self.request, self.number, self.store = request, number, project.store
        self._known = project.known_pictures(request)

    @property
    def _keys(self) -> Mapping[int, FrameKeys] | None:
        """The keys of its pictures; None where its cameras are not framed yet."""
        return self._known.keys if self._known.is_framed else None

    @property
    def _mesh(self) -> int:
        """The mesh frame that it shows."""
        return self.request.angles[self.number].mesh

    def explained(self) -> Explanation:
        file, state = self.request.place("frame", self.number), self._known.state(self.number)
        if state == "done":
            return Explanation(state, file, tuple(self._neighbours_to_come()))
        if state in ("missing", "rendered"):
            return Explanation(state, file, (self._first_missing(),))
        try:
            header = read_header(self.store.root / file)
        except RenderError as error:
            return Explanation("corrupt", file, (str(error),))
        parts = self._parts(header)
        reasons = list(dict.fromkeys(self._reasons(header, parts)))
        edits: tuple[FileEdit, ...] = ()
        options: tuple[str, ...] = ()
        if (made_from := self._source_of_run()) is not None:
            edits = tuple(file_edits(made_from, self.request.source, self.store.root))
            options = tuple(option_differences(made_from, self.request.source))
        is_camera_edited = any(edit.difference.path[0] == "camera" for edit in edits)
        if is_camera_edited and not any(reason.startswith("its camera") for reason in reasons):
            reasons.append("its camera differs")  # hidden by a mesh that differs
        return Explanation(state, file, tuple(reasons), parts, edits, options)

    def _neighbours_to_come(self) -> Iterator[str]:
        """Yield that frames around it are not rendered yet, if it is to be averaged with them."""
        keys = self._known.keys
        assert keys is not None, "the caller checks"
        whole = self.request.pictures.window(self.number, self.request.angles.__contains__)
        if others := FrameRange.of(sorted(set(whole) - set(keys[self.number].window))):
            yield f"it is averaged with frames {others} too once they are rendered"

    def _first_missing(self) -> str:
        """Name the first thing on the way to the frame that is not there."""
        keys = self._keys
        if not all(self.store.holds("mesh", part.keys.mesh(self._mesh)) for part in self.request.parts):
            return f"its mesh, of frame {self._mesh}, is not simulated yet"
        if keys is None:
            return "its camera is not framed yet, which takes all meshes of the shot"
        if self.store.holds("frame", keys[self.number].frame):
            return "the store has it; the next run links it again without rendering"
        if self.store.holds("raw", keys[self.number].raw):
            return "it is rendered and not denoised yet"
        is_other = (self.store.root / self.request.place("raw", self.number)).exists()
        return "it was rendered with other settings" if is_other else "it is not rendered yet"

    def _reasons(self, header: Mapping[str, Any], parts: tuple[Difference, ...]) -> Iterator[str]:
        """Yield what differs, from the mesh to the picture; what follows from another reason is left out."""
        request = self.request
        yield from self._stage_reasons(header)
        inputs = request.keys.header(self.number)["inputs"]
        for name, digest in header.get("inputs", {}).items():
            if inputs.get(name, digest) != digest:
                yield f"file {name} changed since it was made"
        mesh_differs = header.get("mesh_key") != request.keys.mesh(self._mesh)
        if mesh_differs:
            first = self._first_changed()
            yield "its mesh differs" + (f", as all meshes do from frame {first} on" if first else "")
        normals_differ = header.get("normals_key") != request.keys.normals(self._mesh)
        if normals_differ and not mesh_differs:
            yield "its normals differ: by the hard angle or the tessellation"
        named = {str(part.path[0]) for part in parts}
        yield from (sentence for name, sentence in _SENTENCES.items() if name in named)
        if not mesh_differs:
            yield from self._camera_reasons(named)
        if not (mesh_differs or normals_differ or named or self._keys is None):
            yield from self._last_reasons(header)

    def _stage_reasons(self, header: Mapping[str, Any]) -> Iterator[str]:
        for name, recipe in header.get("stages", {}).items():
            now = PipelineStage.all()[name].recipe if name in PipelineStage.all() else {}
            for difference in differences(recipe, now):
                what, before, value = difference.path[-1], difference.before, difference.now
                if what == "version":
                    yield f"stage {name} has version {value} now, and version {before} made it"
                else:
                    yield f"{what} is {_version(value)} now, and stage {name} used {_version(before)}"

    def _camera_reasons(self, named: set[str]) -> Iterator[str]:
        """Yield why the camera differs. Without cameras in the store, it must be framed again."""
        if self._keys is not None and not named & {"camera", "placement", "stage_placement"}:
            return
        first = self._first_changed()
        if self._known.holds("frame", self.number) is None:
            cause = self._first_unmade() if first is None else f", for meshes differ from frame {first} on"
            yield f"its camera is framed again{cause}; if that turns out the same, the frame is reused"
        elif first:
            yield f"its camera differs: it frames meshes that differ from frame {first} on"
        else:
            yield "its camera differs"

    def _last_reasons(self, header: Mapping[str, Any]) -> Iterator[str]:
        """Yield why the same camera, look and mesh do not make the same frame."""
        assert self._keys is not None
        keys, before = self._keys[self.number], header.get("temporal_neighbours", [])
        others = [n for n in keys.window if n != self.number]
        settings, entries = dict(self.request.manifest.stages), header.get("entries", {})
        if header.get("raw_key", keys.raw) != keys.raw:
            yield "its rendering differs: by the flow or the cameras during its exposure"
        elif entries != settings:
            changed = [name for name in {**settings, **entries} if entries.get(name) != settings.get(name)]
            yield f"settings of {', '.join(changed)} differ"
        elif header.get("layers") != self.request.manifest.layers:
            now, then = self.request.manifest.layers or "none", header.get("layers") or "none"
            yield f"its layers for compositing differ: {then} before, {now} now"
        elif before != others:
            yield f"it was averaged with frames {before}, and would be with frames {others} now"
        elif "raw_key" not in header:
            yield "its finishing differs: the denoiser, or the version of the stage"
        else:
            yield "the pictures around it, with which it is averaged, differ"

    def _first_changed(self) -> int | None:
        """Return the first frame whose mesh is there and is not today's."""
        for number in sorted(self.request.source.surface_keys.meshes):
            for part in self.request.parts:
                with contextlib.suppress(*StoredFiles.DAMAGED, OSError):
                    if StoredFiles.key_in(self.store.root / part.place("mesh", number)) != part.keys.mesh(
                        number
                    ):
                        return number
        return None

    def _first_unmade(self) -> str:
        meshes = [part.source.surface_keys.meshes for part in self.request.parts]
        unmade = (
            n for n in sorted(meshes[0]) if not all(self.store.holds("mesh", each[n]) for each in meshes)
        )
        first = next(unmade, None)
        return "" if first is None else f", for the mesh of frame {first} is not simulated yet"

    def _parts(self, header: Mapping[str, Any]) -> tuple[Difference, ...]:
        """Return the differences between a header and that of now, as far as the shot is framed."""
        now = self.request.keys.header(self.number)
        framings = self.request.pictures.framings(self.store)
        if framings is not None and self._keys is not None:
            now = self.request.keys.header(self.number, framings[self.number], self._keys[self.number])
        now = json.loads(json.dumps(now))
        compared = {name: part for name, part in now.items() if name not in _NOT_COMPARED}
        before = {name: header[name] for name in compared if name in header}
        return tuple(differences(before, {name: compared[name] for name in before}))

    def _source_of_run(self) -> ShotSource | None:
        """Return the source from which the run that finished the frame read the shot, if its plan exists."""
        request = self.request
        runs = Runs(self.store.root)
        made = (
            runs.history().stage("finish", request.folders.name, request.quality_name).made.get(self.number)
        )
        return None if made is None else _source_in(runs.requests(made.run), request)


def _version(value: Any) -> str:
    return "none" if value is MISSING else str(value)


def _source_in(planned: Iterable[RenderRequest], request: RenderRequest) -> ShotSource | None:
    """Return the source of a request's shot at its quality among the requests of a plan."""
    same = (each for each in planned if (each.label, each.home) == (request.label, request.home))
    return next((each.source for each in same), None)
