"""Write the page: a folder of plain files that a browser opens without network and server.

renders/review/<name>/index.html     open this
renders/review/<name>/page/…         its scripts and style
renders/review/<name>/data.js        the sequences and the measures
renders/review/<name>/pictures/…     frames and sheets of thumbnails, by keys
renders/review/<name>/models/…       meshes, by keys
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Any

from pipeline.dailies.review import three
from pipeline.dailies.review.discover import ShotMaterial
from pipeline.dailies.review.geometry import PageMeshes
from pipeline.dailies.review.proxies import Proxies, ProxyWriter
from pipeline.dailies.review.sequence import PictureSequence
from pipeline.dailies.sheets.measures import TIMED_STAGES, limits_of, measured
from pipeline.production.planning.timings import LatestTimings
from pipeline.production.store.store import Store
from render.base.atomic_write import atomic_write, disk_errors

SOURCES = files("pipeline.dailies.review") / "page"

Tell = Callable[[], None]


@dataclass(frozen=True)
class ReviewPage:
    """A page of shots in a folder under the root.

    models  most mesh frames of each shot
    form    file format of pictures: jpeg, or png, which is lossless
    """

    name: str
    store: Store
    shots: Sequence[ShotMaterial]
    form: str
    models: int
    threads: int
    _latest: list[LatestTimings] = field(default_factory=list, repr=False)

    @property
    def folder(self) -> Path:
        return self.store.root / "renders" / "review" / self.name

    @property
    def index(self) -> Path:
        return self.folder / "index.html"

    @property
    def sequences(self) -> list[PictureSequence]:
        return [pictures for material in self.shots for pictures in material.sequences]

    @property
    def steps(self) -> int:
        """The number of times that `write` calls `tell`."""
        return sum(len(each.found) for each in self.sequences) + sum(
            len(s.request.angles) for s in self.shots
        )

    def write(self, tell: Tell = lambda: None) -> dict[str, int]:
        """Write missing files, remove those that the page does not show, and return counts by kind.

        Raises MachineError if the disk refuses.
        """
        with disk_errors(self.folder):
            for name in ("pictures", "models", "page"):
                (self.folder / name).mkdir(parents=True, exist_ok=True)
        shots = {material.request.name: self._shot(material, tell) for material in self.shots}
        sequences = [self._sequence(pictures, tell) for pictures in self.sequences]
        text = three.bundle()
        data = {
            "title": self.name,
            "shots": shots,
            "sequences": sequences,
            "wedges": self._wedges(),
            "three": "three.js" if text else None,
            "hint": "" if text else three.HINT,
        }
        self._write_sources()
        if text:
            _write(self.folder / "three.js", f"window.reviewThree = {_json(text)};\n".encode())
        _write(self.folder / "data.js", f"window.reviewData = {_json(data)};\n".encode())
        pictures = {name for each in sequences for name in each["files"] if name}
        models = {file for shot in shots.values() for _, file in shot["models"]}
        sheets = {each["sheet"]["file"] for each in sequences if each["sheet"]}
        _keep(self.folder / "pictures", pictures | sheets)
        _keep(self.folder / "models", models)
        return {"sequences": len(sequences), "pictures": len(pictures), "models": len(models)}

    def _shot(self, material: ShotMaterial, tell: Tell) -> dict[str, Any]:
        """Return data of a shot that all its sequences share."""
        request = material.request
        numbers = sorted(request.angles)
        found = measured(request, self.store, numbers, self.threads, tell)
        meshes = PageMeshes(request, self.store, self.folder / "models")
        written = [(number, meshes.write(number)) for number in meshes.chosen(self.models)]
        return {
            "title": request.shot.title,
            "fps": float(request.shot.rate.fps),
            "numbers": numbers,
            "limits": list(limits_of(request)),
            "measures": found,
            "models": [[number, name] for number, name in written if name],
        }

    def _sequence(self, pictures: PictureSequence, tell: Tell) -> dict[str, Any]:
        writer = ProxyWriter(self.store, self.folder / "pictures", self.form, self.threads)
        proxies = writer.proxies(pictures, tell)
        states = {**pictures.states(), **{n: ("failed", why) for n, why in proxies.faults.items()}}
        shown = [number for number in pictures.numbers if number in pictures.found]
        return {
            "shot": pictures.shot,
            "kind": pictures.kind,
            "label": pictures.label,
            "quality": pictures.quality,
            "note": pictures.note,
            "size": list(proxies.size),
            "numbers": list(pictures.numbers),
            "files": [proxies.files.get(number) for number in pictures.numbers],
            "states": {number: list(told) for number, told in states.items()},
            "sheet": writer.sheet(proxies),
            "facts": {"numbers": shown, **tabled([pictures.found[n].header for n in shown])},
            "seconds": self._seconds(pictures, proxies),
        }

    def _seconds(self, pictures: PictureSequence, proxies: Proxies) -> dict[str, dict[int, float]]:
        """Return seconds by stage and frame."""
        if not self._latest:
            self._latest.append(LatestTimings(self.store.root))
        told = self._latest[0].by_stage(pictures.subject, pictures.shot, pictures.quality, TIMED_STAGES)
        if pictures.kind == "version":
            told.pop("finish", None)  # the logs tell of today's
        render = {n: round(sum(parts.values()), 3) for n, parts in pictures.seconds.items() if parts}
        by_stage = {**told, "render": {n: s for n, s in render.items() if n in proxies.files}}
        return {stage: frames for stage, frames in by_stage.items() if frames}

    def _wedges(self) -> list[dict[str, Any]]:
        places = {id(pictures): index for index, pictures in enumerate(self.sequences)}
        return [
            {
                "shot": material.request.name,
                "name": cells.name,
                "columns": cells.columns,
                "captions": [[list(line) for line in caption] for caption in cells.captions],
                "cells": [places[id(pictures)] for pictures in cells.sequences],
            }
            for material in self.shots
            for cells in material.wedges
            if cells.sequences
        ]

    def _write_sources(self) -> None:
        for source in sorted(SOURCES.iterdir(), key=lambda each: each.name):
            place = self.index if source.name == self.index.name else self.folder / "page" / source.name
            _write(place, source.read_bytes())


def _write(place: Path, content: bytes) -> None:
    """Write a file unless it has this content."""
    if not place.exists() or place.read_bytes() != content:
        with atomic_write(place) as draft:
            draft.write_bytes(content)


def _json(data: object) -> str:
    """Return JSON for a script: it contains no end of a line or of a script."""
    return json.dumps(data, separators=(",", ":")).replace("</", "<\\/")


def _keep(folder: Path, names: Iterable[str]) -> None:
    """Remove all other files from a folder of the page."""
    wanted = set(names)
    for path in folder.iterdir():
        if path.name not in wanted and path.is_file():
            path.unlink(missing_ok=True)


_OMITTED = frozenset({"frame"})
"""Entries that differ between frames by definition."""


def tabled(headers: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return `same`: entries equal in all headers, and `differ`: of the others, a value for each header."""
    flat = [dict(_flat("", header)) for header in headers]
    names = sorted({name for each in flat for name in each} - _OMITTED)
    columns = {name: [each.get(name) for each in flat] for name in names}
    return {
        "same": {name: values[0] for name, values in columns.items() if _are_equal(values)},
        "differ": {name: values for name, values in columns.items() if not _are_equal(values)},
    }


def _are_equal(values: Sequence[Any]) -> bool:
    return all(value == values[0] for value in values)


def _flat(place: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Yield entries with dotted names; lists of numbers stay together, and numbers are rounded."""
    if isinstance(value, Mapping):
        for name, inner in value.items():
            yield from _flat(f"{place}.{name}" if place else str(name), inner)
    elif isinstance(value, list) and any(isinstance(inner, Mapping | list) for inner in value):
        for index, inner in enumerate(value):
            name = inner.get("name") if isinstance(inner, Mapping) else None
            yield from _flat(f"{place}.{name or index}", inner)
    else:
        yield place, _rounded(value)


def _rounded(value: Any) -> Any:
    if isinstance(value, float):
        return float(f"{value:.6g}")
    return [_rounded(inner) for inner in value] if isinstance(value, list) else value
