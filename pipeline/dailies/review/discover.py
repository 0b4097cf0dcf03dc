"""Find the sequences of a shot: rendered frames, published versions, and cells of wedges."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from pipeline.dailies.review.sequence import PLAIN, PictureDisplay, PictureSequence
from pipeline.errors import FlowsculptError, MissingInputError
from pipeline.production.execution.project import Project
from pipeline.production.planning.frame_states import PICTURE_STAGES, picture_states
from pipeline.production.planning.timings import render_seconds
from pipeline.production.request.crop_and_scale import is_quality
from pipeline.production.request.lookup import find_shot
from pipeline.production.request.render_request import RenderRequest
from pipeline.production.store.event_log import History
from pipeline.production.store.paths import Folders, published
from pipeline.production.store.paths import wedge as wedge_folder
from pipeline.production.versions.grid import Grid
from pipeline.production.versions.provenance import Provenance, records, restored
from pipeline.production.versions.wedge import Wedge
from render.base.errors import RenderError
from render.post.image import read_header

STALE = "the shot has changed since it was rendered; flowsculpt why says how"


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
    """Finds material in a project, at these qualities, or at all if there are none."""

    project: Project
    qualities: tuple[str, ...]
    history: History

    def shot(self, name: str) -> ShotMaterial:
        """Return the material of a shot. Raises MissingInputError if nothing is rendered, or ShotError."""
        path = find_shot(name)
        renders = list(self._renders(path))
        versions = list(self._versions(path.stem))
        wedges = tuple(self._wedges(path))
        cells = [each for wedge in wedges for each in wedge.sequences]
        sequences = tuple(each for each in (*renders, *versions, *cells) if each.files)
        quality = self.qualities[0] if self.qualities else "preview"
        if not sequences:
            at = f" at {', '.join(self.qualities)}" if self.qualities else ""
            raise MissingInputError(
                f"{path.stem} has no rendered frames{at}, and a review page shows such; flowsculpt render "
                f"{path.stem} -q {quality} makes them"
            )
        return ShotMaterial(self.project.request(path, "draft", variant="none"), sequences, wedges)

    def _wanted(self, quality: str) -> bool:
        return not self.qualities or quality in self.qualities

    def _renders(self, path: Path) -> Iterator[PictureSequence]:
        home = self.project.root / Folders.of_shot(path.stem).home
        names = sorted(place.parent.name for place in home.glob("*/frames") if is_quality(place.parent.name))
        for quality in names if home.is_dir() else ():
            if self._wanted(quality):
                request = self.project.request(path, quality)
                yield self._of_take(request, "render", quality)

    def _of_take(self, request: RenderRequest, kind: str, label: str) -> PictureSequence:
        """Return the frames of a request that are rendered, and the faults of the others."""
        failed = self.history.failed(request.subject, PICTURE_STAGES, request.quality_name)
        stale = set(picture_states(request, self.project.store, self.history).stale)
        told = {number: ("failed", message) for number, message in failed.items()}
        told |= dict.fromkeys(stale, ("stale", STALE))
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
            told=told,
            seconds=render_seconds(request, self.project.root),
        )

    def _versions(self, name: str) -> Iterator[PictureSequence]:
        for place, record in records(self.project.root / published(name)):
            if isinstance(record, Provenance) and self._wanted(record.quality):
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
                    told={},
                    seconds={number: frame.seconds for number, frame in record.frames.items()},
                    note=record.note,
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
                grid = Grid.parse(_varied(sheet), many=True)
                quality = sheet.stem.rpartition(".")[0].removeprefix(f"{grid.name}.")
                if (grid.name, quality) not in seen and self._wanted(quality):
                    seen.add((grid.name, quality))
                    yield self._cells(Wedge(self.project, path, grid, quality))
            except FlowsculptError:
                continue  # it is another picture, or the shot has no such value any more

    def _cells(self, wedge: Wedge) -> Cells:
        found = []
        for cell, request in wedge.requests:
            label = ", ".join(f"{name} {value}" for name, value in cell.caption)
            found.append(
                (cell.caption, self._of_take(request.whole(), "wedge", f"{label} · {wedge.quality}"))
            )
        there = [(caption, each) for caption, each in found if each.files]
        together = tuple(sorted({number for _, each in there for number in each.files}))
        return Cells(
            wedge.grid.name,
            wedge.grid.columns,
            tuple(caption for caption, _ in there),
            tuple(replace(each, numbers=together) for _, each in there),  # cells are seldom rendered whole
        )


def _display(request: RenderRequest) -> PictureDisplay:
    picture = request.shot.picture
    return PictureDisplay(picture.lights.exposure, picture.view, request.shown_as)


def _varied(path: Path) -> list[str]:
    """Return what was varied on a contact sheet; nothing if the picture is none."""
    try:
        return [str(said) for said in read_header(path).get("wedge", [])]
    except RenderError:
        return []
