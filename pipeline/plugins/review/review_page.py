"""The review page: its material, and a folder of plain files that a browser opens without network and server.

renders/review/<name>/index.html     open this
renders/review/<name>/page/…         its scripts and style
renders/review/<name>/data.js        the sequences and the measures
renders/review/<name>/pictures/…     frames and sheets of thumbnails, by keys
renders/review/<name>/scopes/…       waveforms and histograms of frames, by keys
renders/review/<name>/models/…       meshes, by keys
renders/review/<name>/layers/…       linear layers of some frames, by keys
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib.resources import files
from pathlib import Path
from typing import Any

from flowsculpt import MissingInputError
from flowsculpt.api import ShotExtras
from flowsculpt.api.commands import Project
from flowsculpt.api.files import PageFolder, disk_errors, make_folder, remove_file
from flowsculpt.api.frames import (
    PictureSequence,
    RenderRequest,
    Runs,
    SequenceGrid,
    SequenceQuery,
    Show,
    Store,
    key_of,
)
from flowsculpt.api.options import DEFAULT_QUALITY
from flowsculpt.pipeline.plugins.review import view_3d
from flowsculpt.pipeline.plugins.review.figure_panels import FigurePanel, panel_data
from flowsculpt.pipeline.plugins.review.figures import panels
from flowsculpt.pipeline.plugins.review.measures import TIMED_STAGES, limits_of, measured
from flowsculpt.pipeline.plugins.review.page_pictures import LayerWriter, Proxies, ProxyWriter
from flowsculpt.pipeline.plugins.review.review_notes import NotesDocument, ReviewNote, as_data

KINDS = ("render", "relit", "version", "wedge")
"""Kinds of sequences in their order on the page; others follow."""


@dataclass(frozen=True)
class ShotMaterial:
    """All material of a shot that a page shows."""

    request: RenderRequest
    sequences: tuple[PictureSequence, ...]
    wedges: tuple[SequenceGrid, ...]


@dataclass(frozen=True)
class Search:
    """Finds material in a project, at these qualities; at all qualities if there are none."""

    project: Project
    qualities: tuple[str, ...]

    def shot(self, name: str) -> ShotMaterial:
        """Return the material of a shot. Raises MissingInputError if nothing is rendered, or ShotError."""
        path = Show().find_shot(name)
        query = SequenceQuery(self.project, path, self.qualities)
        found = [each for extras in ShotExtras.of_plugins().values() for each in extras.sequences(query)]
        grids = tuple(each for each in found if isinstance(each, SequenceGrid))
        single = [query.rendered(request, "render", request.quality_name) for request in query.requests()]
        single += [each for each in found if isinstance(each, PictureSequence)]
        cells = [sequence for grid in grids for sequence in grid.sequences]
        sequences = tuple(sorted((each for each in (*single, *cells) if each.files), key=_order))
        if not sequences:
            quality = self.qualities[0] if self.qualities else DEFAULT_QUALITY
            at = f" at {', '.join(self.qualities)}" if self.qualities else ""
            raise MissingInputError(
                f"{path.stem} has no rendered frames{at} for a review page; flowsculpt render "
                f"{path.stem} -q {quality} makes them"
            )
        return ShotMaterial(self.project.request(path, DEFAULT_QUALITY, variant="none"), sequences, grids)


def _order(sequence: PictureSequence) -> int:
    return KINDS.index(sequence.kind) if sequence.kind in KINDS else len(KINDS)


PAGE = PageFolder(files("flowsculpt.pipeline.plugins.review") / "page")

Tell = Callable[[], None]


@dataclass(frozen=True)
class ReviewPage:
    """A page of shots in a folder under the root.

    models     most mesh frames of each shot
    form       file format of pictures: jpeg, or png, which is lossless
    crossings  count those of every frame
    notes      what reviewers wrote, to be shown from the start
    layers     most frames of each sequence whose layers the page has
    """

    name: str
    store: Store
    shots: Sequence[ShotMaterial]
    form: str
    models: int
    threads: int
    crossings: bool = False
    notes: Sequence[ReviewNote] = ()
    layers: int = 0

    @cached_property
    def three_js(self) -> tuple[str, str]:
        """The text of three.js, which draws the 3-D view, and why the page has none; one of them is empty."""
        try:
            return PAGE.three_js("the page has no 3-D view"), ""
        except MissingInputError as error:
            return "", str(error)

    @property
    def folder(self) -> Path:
        return self.store.root / "renders" / "review" / self.name

    @property
    def index(self) -> Path:
        return self.folder / "index.html"

    @property
    def sequences(self) -> list[PictureSequence]:
        return [sequence for material in self.shots for sequence in material.sequences]

    @property
    def steps(self) -> int:
        """The number of times that `write` calls `tell`."""
        pictures = sum(len(each.pictures) + min(self.layers, len(each.pictures)) for each in self.sequences)
        return pictures + sum(len(material.request.angles) for material in self.shots)

    def write(
        self, tell: Tell = lambda: None, began: Callable[[str, int], Tell] = lambda name, total: lambda: None
    ) -> dict[str, int]:
        """Write missing files, remove those that the page does not show, and return counts by kind.

        tell   called after each step
        began  as `PageMeshes.write_motion` takes it

        Raises MachineError if the disk refuses.
        """
        with disk_errors(self.folder):
            for name in ("pictures", "scopes", "models", "layers", "page"):
                make_folder(self.folder / name)
        shots = {material.request.name: self._shot(material, tell, began) for material in self.shots}
        sequences = [self._sequence(sequence, tell) for sequence in self.sequences]
        script, hint = self.three_js
        data = {
            "title": self.name,
            "page": key_of("review page", str(self.folder.absolute())),
            "notes": as_data(self.notes)["notes"],
            "schema": NotesDocument.model_json_schema(),
            "shots": shots,
            "sequences": sequences,
            "sources": self._sources,
            "wedges": self._wedges(),
            "three": "three.js" if script else None,
            "hint": hint,
        }
        self._write(self.index, PAGE.linked("Review", "page/page.css", ("data.js", "page/page.js")).encode())
        self._write(self.folder / "page" / "page.css", PAGE.style.encode())
        self._write(self.folder / "page" / "page.js", PAGE.script.encode())
        if script:
            self._write(self.folder / "three.js", f"window.reviewThree = {_json(script)};\n".encode())
        self._write(self.folder / "data.js", f"window.reviewData = {_json(data)};\n".encode())
        scopes = {name for sequence in sequences for name in sequence["scopes"] if name}
        pictures = {name for sequence in sequences for name in sequence["files"] if name}
        models = {file for shot in shots.values() for _, file in shot["models"]}
        moving = {shot["motion"]["file"] for shot in shots.values() if "file" in shot["motion"]}
        sheets = {sequence["sheet"]["file"] for sequence in sequences if sequence["sheet"]}
        layers = {file for each in sequences for files in each["layers"].values() for file in files.values()}
        for folder, names in (
            ("pictures", pictures | sheets),
            ("scopes", scopes),
            ("models", models | moving),
            ("layers", layers),
            ("page", {"page.css", "page.js"}),
        ):
            _keep(self.folder / folder, names)
        return {
            "sequences": len(sequences),
            "pictures": len(pictures),
            "models": len(models),
            "moving": len(moving),
            "frames_with_layers": sum(len(each["layers"]) for each in sequences),
            "layer_bytes": sum((self.folder / "layers" / file).stat().st_size for file in layers),
        }

    def _write(self, path: Path, content: bytes) -> None:
        """Write a file unless it has this content."""
        if not path.exists() or path.read_bytes() != content:
            self.store.write(path, lambda draft: draft.write_bytes(content))

    def _shot(self, material: ShotMaterial, tell: Tell, began: Callable[[str, int], Tell]) -> dict[str, Any]:
        """Return data of a shot that all its sequences share."""
        request = material.request
        numbers = sorted(request.angles)
        measures = measured(request, self.store, numbers, self.threads, tell, self.crossings)
        meshes = view_3d.PageMeshes(request, self.store, self.folder / "models")
        models = [(number, meshes.write(number)) for number in meshes.chosen(self.models)]
        return {
            "title": request.shot.title,
            "fps": float(request.shot.rate.fps),
            "dissolve": 0 if request.loop is None else request.loop[1],
            "numbers": numbers,
            "panels": [panel_data(each) for each in panels(numbers, measures, limits_of(request), {})],
            "mean_edges": {number: row["mean_edge"] for number, row in measures.items()},
            "models": [[number, name] for number, name in models if name],
            "motion": meshes.write_motion(began) if self.models else {"without": ""},
        }

    def _sequence(self, sequence: PictureSequence, tell: Tell) -> dict[str, Any]:
        writer = ProxyWriter(self.store, self.folder / "pictures", self.form, self.threads)
        layers = LayerWriter(self.store, self.folder / "layers", self.layers, self.threads)
        proxies = writer.proxies(sequence, tell)
        states = {**sequence.states(), **{n: ("failed", why) for n, why in proxies.faults.items()}}
        readable = [number for number in sequence.numbers if number in sequence.pictures]
        names = ("shot", "kind", "label", "quality", "note")
        return {
            **{name: getattr(sequence, name) for name in names},
            "source": None if sequence.source is None else self._sources.index(_shot_text(sequence)),
            "size": list(proxies.size),
            "numbers": list(sequence.numbers),
            "files": [proxies.files.get(number) for number in sequence.numbers],
            "scopes": [proxies.scopes.get(number) for number in sequence.numbers],
            "states": {number: list(state) for number, state in states.items()},
            "sheet": writer.sheet(proxies),
            "layers": layers.write(sequence, tell),
            "facts": {"numbers": readable, **tabled([sequence.pictures[n].header for n in readable])},
            "timed": [panel_data(each) for each in self._times(sequence, proxies)],
        }

    def _times(self, sequence: PictureSequence, proxies: Proxies) -> list[FigurePanel]:
        """Return the panel of seconds by frame; none for relit frames, which take none of the stages."""
        if sequence.kind == "relit":
            return []
        seconds = self._runs.stage_seconds(sequence.subject, sequence.shot, sequence.quality, TIMED_STAGES)
        if sequence.kind == "version":
            seconds.pop("finish", None)  # the logs hold those of the shot's present frames
        seconds["render"] = {
            n: round(sum(parts.values()), 3)
            for n, parts in sequence.seconds.items()
            if parts and n in proxies.files
        }
        return panels(sequence.numbers, {}, (None, None), {s: times for s, times in seconds.items() if times})

    @cached_property
    def _sources(self) -> list[str]:
        """The texts of shot files, each once."""
        return list(dict.fromkeys(_shot_text(each) for each in self.sequences if each.source is not None))

    @cached_property
    def _runs(self) -> Runs:
        return Runs(self.store.root)

    def _wedges(self) -> list[dict[str, Any]]:
        indices = {id(sequence): index for index, sequence in enumerate(self.sequences)}
        return [
            {
                "shot": material.request.name,
                "name": cells.name,
                "columns": cells.columns,
                "captions": [", ".join(map(" ".join, caption)) for caption in cells.captions],
                "cells": [indices[id(sequence)] for sequence in cells.sequences],
            }
            for material in self.shots
            for cells in material.wedges
            if cells.sequences
        ]


def _json(data: object) -> str:
    """Return JSON for a script: it contains no end of a line, and no tag wherever it is pasted."""
    return json.dumps(data, separators=(",", ":")).replace("<", "\\u003c")


def _keep(folder: Path, names: set[str]) -> None:
    """Remove all other files from a folder of the page."""
    for path in folder.iterdir():
        if path.name not in names and path.is_file():
            remove_file(path)


_OMITTED = frozenset({"frame"})  # entries that differ between frames by definition


def tabled(headers: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return `same`: entries equal in all headers, and `differ`: of the others, a value for each header."""
    rows = [dict(_flat("", header)) for header in headers]
    names = sorted({name for row in rows for name in row} - _OMITTED)
    table: dict[str, Any] = {"same": {}, "differ": {}}
    for name in names:
        values = [row.get(name) for row in rows]
        is_same = all(value == values[0] for value in values)
        table["same" if is_same else "differ"][name] = values[0] if is_same else values
    return table


def _flat(path: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Yield entries with dotted names; lists of numbers stay together, and numbers are rounded."""
    if isinstance(value, Mapping):
        for name, inner in value.items():
            yield from _flat(f"{path}.{name}" if path else str(name), inner)
    elif isinstance(value, list) and any(isinstance(inner, Mapping | list) for inner in value):
        for index, inner in enumerate(value):
            name = inner.get("name") if isinstance(inner, Mapping) else None
            yield from _flat(f"{path}.{name or index}", inner)
    else:
        yield path, _rounded(value)


def _rounded(value: Any) -> Any:
    if isinstance(value, float):
        return float(f"{value:.6g}")
    return [_rounded(inner) for inner in value] if isinstance(value, list) else value


def _shot_text(sequence: PictureSequence) -> str:
    """Return the quality, the settings and the shot files in one text, by which sequences are compared."""
    source = sequence.source
    assert source is not None, "only such sequences have a text"
    head = [f"# quality {sequence.quality}", *(f"# --set {setting}" for setting in source.settings)]
    files = [(source.path.name, source.text), *sorted(source.beside)]
    return "\n".join([*head, *(f"# {Path(name).name}\n{text.rstrip()}" for name, text in files)])
