"""The sequences of a shot on a page: rendered and relit frames, published versions, and cells of wedges."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from pipeline.dailies.relighting.relit_frames import relit_files, relit_names
from pipeline.errors import FlowsculptError, MissingInputError
from pipeline.production.execution.project import Project
from pipeline.production.planning.frame_states import PICTURE_STAGES, picture_states
from pipeline.production.planning.timings import render_seconds
from pipeline.production.request.crop_and_scale import is_quality
from pipeline.production.request.lookup import find_shot
from pipeline.production.request.render_request import RenderRequest
from pipeline.production.request.shot_source import ShotSource
from pipeline.production.stages import STAGES
from pipeline.production.store.history import History
from pipeline.production.store.paths import Folders, published
from pipeline.production.store.paths import wedge as wedge_folder
from pipeline.production.store.store import Key, key_of
from pipeline.production.versions.grid import Grid
from pipeline.production.versions.provenance import Provenance, records, restored
from pipeline.production.versions.wedge import Wedge
from render.base.errors import RenderError
from render.post.image import read_header
from render.post.view import ACES, ColourView
from render.scene.quality import DEFAULT_QUALITY


@dataclass(frozen=True)
class PictureDisplay:
    """The exposure (stops) and view transform of a page's pictures.

    shown_as   both as plain data, for the keys of stills
    """

    exposure: float
    view: ColourView
    shown_as: Mapping[str, Any]


PLAIN = PictureDisplay(0.0, ACES, {"exposure": 0.0, "view": ACES.recipe})
"""The display of pictures whose shot cannot be read."""

STALE = "the shot has changed since it was rendered; flowsculpt why says how"


OUTDATED = "its finished frame has changed since; flowsculpt relight mixes it again"


@dataclass(frozen=True)
class PictureFile:
    """A readable picture: its file, its key, and its header."""

    path: Path
    key: Key
    header: Mapping[str, Any]


@dataclass(frozen=True)
class PictureSequence:
    """A sequence of pictures of one shot, by frame.

    kind      render, relit, version or wedge
    label     distinguishes it from other sequences of the shot
    subject   its name in event logs
    numbers   all frames of the sequence
    files     frames that are rendered
    faults    frames that failed or are stale: the state and the reason
    seconds   seconds of rendering by frame and part, where they are known
    note      the note of a published version
    raws      rendered frames, whose AOVs the finished ones do not have, where they are there
    source    the shot file that it is rendered from, and what it rests on
    """

    shot: str
    kind: str
    label: str
    quality: str
    subject: str
    numbers: tuple[int, ...]
    files: Mapping[int, Path]
    display: PictureDisplay
    faults: Mapping[int, tuple[str, str]]
    seconds: Mapping[int, Mapping[str, float]]
    note: str = ""
    raws: Mapping[int, Path] = field(default_factory=dict)
    source: ShotSource | None = None

    @cached_property
    def pictures(self) -> Mapping[int, PictureFile]:
        """The pictures that can be read, by frame."""
        pictures = {}
        for number, path in self.files.items():
            with suppress(RenderError, KeyError):
                header = read_header(path)
                pictures[number] = PictureFile(path, str(header["key"]), header)
        return pictures

    @property
    def shot_text(self) -> str | None:
        """The quality, the settings and the shot files in one text, by which sequences are compared."""
        if self.source is None:
            return None
        head = [f"# quality {self.quality}", *(f"# --set {setting}" for setting in self.source.settings)]
        files = [(self.source.path.name, self.source.text), *sorted(self.source.beside)]
        return "\n".join([*head, *(f"# {Path(name).name}\n{text.rstrip()}" for name, text in files)])

    def states(self) -> dict[int, tuple[str, str]]:
        """Return by frame the state and the reason of frames that are missing, failed or stale."""
        states: dict[int, tuple[str, str]] = {}
        for number in self.numbers:
            state, why = self.faults.get(number, ("", ""))
            if number in self.pictures:
                if state == "stale":
                    states[number] = state, why
            elif number in self.files:
                states[number] = "failed", "it cannot be read; flowsculpt verify repairs it"
            else:
                states[number] = ("failed", why) if state == "failed" else ("missing", "it is not rendered")
        return states

    def still_key(self, form: str, number: int) -> Key:
        """The key of a still, the same as `RenderRequest.still_key`, so that both share their files."""
        return key_of(STAGES[form].recipe, self.pictures[number].key, self.display.shown_as)


@dataclass(frozen=True)
class Cells:
    """The rendered cells of a wedge: their values, their sequences, and the columns of its sheet."""

    name: str
    columns: int | None
    captions: tuple[tuple[tuple[str, str], ...], ...]
    sequences: tuple[PictureSequence, ...]


@dataclass(frozen=True)
class ShotMaterial:
    """All material of a shot that a page shows."""

    request: RenderRequest
    sequences: tuple[PictureSequence, ...]
    wedges: tuple[Cells, ...]


@dataclass(frozen=True)
class Search:
    """Finds material in a project, at these qualities; at all qualities if there are none."""

    project: Project
    qualities: tuple[str, ...]
    history: History

    def shot(self, name: str) -> ShotMaterial:
        """Return the material of a shot. Raises MissingInputError if nothing is rendered, or ShotError."""
        path = find_shot(name)
        renders = list(self._renders(path))
        versions = list(self._versions(path.stem))
        wedges = tuple(self._wedges(path))
        cells = [sequence for wedge in wedges for sequence in wedge.sequences]
        sequences = tuple(sequence for sequence in (*renders, *versions, *cells) if sequence.files)
        if not sequences:
            quality = self.qualities[0] if self.qualities else DEFAULT_QUALITY
            at = f" at {', '.join(self.qualities)}" if self.qualities else ""
            raise MissingInputError(
                f"{path.stem} has no rendered frames{at}, and a review page shows such; flowsculpt render "
                f"{path.stem} -q {quality} makes them"
            )
        return ShotMaterial(self.project.request(path, DEFAULT_QUALITY, variant="none"), sequences, wedges)

    def _includes(self, quality: str) -> bool:
        return not self.qualities or quality in self.qualities

    def _renders(self, path: Path) -> Iterator[PictureSequence]:
        home = self.project.root / Folders.of_shot(path.stem).home
        for quality in sorted(place.parent.name for place in home.glob("*/frames")):
            if is_quality(quality) and self._includes(quality):
                request = self.project.as_finished(self.project.request(path, quality))
                yield self._sequence(request, "render", quality)
                for name in relit_names(request, self.project.root):
                    yield self._relit(request, name)

    def _relit(self, request: RenderRequest, name: str) -> PictureSequence:
        """Return the frames of a relit version. Those whose finished frame was rendered anew are stale."""
        files = relit_files(request, self.project.root, name)
        keys, stale = request.picture_keys(self.project.store, rendered=()), {}
        for number, path in files.items():
            with suppress(RenderError):
                if keys is None or read_header(path).get("finished_key") != keys[number].frame:
                    stale[number] = "stale", OUTDATED
        return PictureSequence(
            shot=request.name,
            kind="relit",
            label=f"{request.quality_name} relit {name}",
            quality=request.quality_name,
            subject=request.subject,
            numbers=tuple(files),
            files=files,
            display=_display(request),
            faults=stale,
            seconds={},
            source=request.source,
        )

    def _sequence(self, request: RenderRequest, kind: str, label: str) -> PictureSequence:
        """Return the frames of a request that are rendered, and the faults of the others."""
        failed = self.history.failed(request.subject, PICTURE_STAGES, request.quality_name)
        stale = picture_states(request, self.project.store, self.history).stale
        faults = {number: ("failed", message) for number, message in failed.items()}
        faults |= dict.fromkeys(stale, ("stale", STALE))
        places = {n: self.project.root / request.place("frame", n) for n in request.angles}
        return PictureSequence(
            shot=request.name,
            kind=kind,
            label=label,
            quality=request.quality_name,
            subject=request.subject,
            numbers=tuple(sorted(request.requested)),
            files={number: path for number, path in places.items() if path.is_file()},
            display=_display(request),
            faults=faults,
            seconds=render_seconds(request, self.project.root),
            raws={n: self.project.root / request.place("raw", n) for n in request.angles},
            source=request.source,
        )

    def _versions(self, name: str) -> Iterator[PictureSequence]:
        for place, record in records(self.project.root / published(name)):
            if isinstance(record, Provenance) and self._includes(record.quality):
                files = {number: place / frame.file for number, frame in record.frames.items()}
                yield PictureSequence(
                    shot=name,
                    kind="version",
                    label=f"{record.version} {record.quality}",
                    quality=record.quality,
                    subject=name,
                    numbers=tuple(sorted(record.frames)),
                    files={number: path for number, path in files.items() if path.is_file()},
                    display=self._display_of(record),
                    faults={},
                    seconds={number: frame.seconds for number, frame in record.frames.items()},
                    note=_note_of(record),
                    source=record.source,
                )

    def _display_of(self, record: Provenance) -> PictureDisplay:
        try:
            return _display(
                RenderRequest(restored(record, self.project.allow_code), record.quality, record.variant, ())
            )
        except FlowsculptError:
            return PLAIN

    def _wedges(self, path: Path) -> Iterator[Cells]:
        """Yield the wedges of a shot that have a contact sheet, whose header says what was varied."""
        home = self.project.root / wedge_folder(path.stem)
        seen: set[tuple[str, str]] = set()
        for sheet in sorted(home.glob("*.png")):
            try:
                variations = [str(variation) for variation in read_header(sheet).get("wedge", [])]
                grid = Grid.parse(variations, many=True)
                quality = sheet.stem.rpartition(".")[0].removeprefix(f"{grid.name}.")
                if (grid.name, quality) not in seen and self._includes(quality):
                    seen.add((grid.name, quality))
                    yield self._cells(Wedge(self.project, path, grid, quality))
            except FlowsculptError:
                continue  # it is another picture, or the shot has no such value any more

    def _cells(self, wedge: Wedge) -> Cells:
        rendered = []
        for cell, request in wedge.requests:
            label = ", ".join(f"{name} {value}" for name, value in cell.caption)
            sequence = self._sequence(request.whole(), "wedge", f"{label} · {wedge.quality}")
            if sequence.files:
                rendered.append((cell.caption, sequence))
        numbers = tuple(sorted({number for _, sequence in rendered for number in sequence.files}))
        return Cells(
            wedge.grid.name,
            wedge.grid.columns,
            tuple(caption for caption, _ in rendered),
            tuple(replace(sequence, numbers=numbers) for _, sequence in rendered),  # cells are seldom whole
        )


def _note_of(record: Provenance) -> str:
    """Return the note of a version, and of a patch which frames it replaced."""
    notes = [record.note] if record.note else []
    if record.patch:
        notes.append("patch of {version}: frames {frames} are new".format(**record.patch))
    return "; ".join(notes)


def _display(request: RenderRequest) -> PictureDisplay:
    picture = request.shot.picture
    return PictureDisplay(picture.lights.exposure, picture.view, request.shown_as)
