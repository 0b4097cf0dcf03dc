"""Wedges: a shot rendered over and over with other values, all of it planned as one run.

renders/wedge/<shot>/<cell>/<quality>/frames/…     a cell's files, as those of a shot
renders/wedge/<shot>/<wedge>.<quality>.0024.png    the contact sheet; of several frames also an MP4
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from pipeline.errors import FlowsculptError, ShotError, UsageError
from pipeline.frames import FrameRange
from pipeline.plugins.sheets.wedge_grid import OPTION, Cell, Grid, Variation
from pipeline.production.execution.project import Project
from pipeline.production.picture_sequences import SequenceGrid, SequenceQuery, shown_picture
from pipeline.production.planning.plan import Plan
from pipeline.production.request.render_request import RenderRequest
from pipeline.production.store import paths
from pipeline.shot.yaml.named_files import shown
from render.graphics.contact_sheet import columns_for, fitted_sheet
from render.movie.codecs import H264_8_BITS
from render.movie.encode import write_movie
from render.post.image import read_header, write_png


@dataclass(frozen=True, eq=False)
class Wedge:
    """A grid of a shot.

    frames   a range for every cell; by default the one frame of the sheet
    at       the sheet's frame; by default the middle one
    columns  of the sheet; by default as the grid has it
    """

    project: Project
    shot: Path
    grid: Grid
    quality: str
    frames: str | None = None
    at: int | None = None
    columns: int | None = None

    @property
    def requests(self) -> list[tuple[Cell, RenderRequest]]:
        """Each cell and its request, with the variant that works now: a run changes it after a crash.

        Raises ShotError or UsageError, with the variation, where a cell's shot is not good.
        """
        variant = self.project.variant_of(self.shot.stem)
        return [
            (cell, request if request.variant == variant else replace(request, variant=variant))
            for cell, request in self._read
        ]

    @cached_property
    def _read(self) -> list[tuple[Cell, RenderRequest]]:
        still = str(self.number)  # what is wrong with the frames themselves is told before any cell is
        return [(cell, self._take(cell, self.frames or still)) for cell in self.grid]

    @cached_property
    def number(self) -> int:
        """The frame of the sheet. Raises UsageError where it is none of those rendered."""
        known = FrameRange.of(self.project.request(self.shot, self.quality, self.frames).requested)
        if self.at is None:
            return sorted(known)[len(known) // 2]
        if self.at not in known:
            raise UsageError(f"--at {self.at}: this frame is not rendered; choose one of {known}")
        return self.at

    def plan(self) -> Plan:
        """Return the plan of what is left to be done for all cells together, each file made once."""
        requests = [request for _, request in self.requests]
        planner = self.project.planner(len(requests))
        for request in requests:
            planner.pictures(request)
            if len(request.requested) > 1:
                planner.movie(request)
        return planner.plan()

    # Sheets

    @property
    def still_path(self) -> Path:
        return self._home / f"{self.grid.name}.{self.quality}.{self.number:04d}.png"

    @property
    def movie_path(self) -> Path | None:
        """The movie of the sheet; None where one frame was asked for."""
        numbers = self._read[0][1].requested
        if len(numbers) == 1:
            return None
        return self._home / f"{self.grid.name}.{self.quality}.{FrameRange.of(numbers)}.mp4"

    def draw(self) -> list[Path]:
        """Draw the contact sheet, and of several frames its movie; return their paths, relative to the root.

        Cells that were not rendered are shown as such. Raises MachineError where the disk refuses.
        """
        store, shot = self.project.store, self.shot.stem
        header = {"shot": shot, "frame": self.number, "wedge": [v.said for v in self.grid.variations]}
        (page,) = self._pages([self.number], 8, "srgb")
        store.write(store.root / self.still_path, lambda path: write_png(path, page, header))
        if self.movie_path is None:
            return [self.still_path]
        first = self._read[0][1]
        pages = self._pages(sorted(first.requested), 16, "rec709")
        rate = first.shot.rate.fps
        store.write(store.root / self.movie_path, lambda path: write_movie(path, pages, rate, H264_8_BITS))
        return [self.still_path, self.movie_path]

    def _pages(self, numbers: Sequence[int], bits: int, display: str) -> Iterator[NDArray[Any]]:
        """Yield the contact sheet of frames."""
        first, store = self._read[0][1], self.project.store
        sizes = [(cell.quality.width, cell.quality.height) for _, cell in self._read]
        size = max(width for width, _ in sizes), max(height for _, height in sizes)
        columns = self.columns or self.grid.columns or columns_for(len(self.grid), size)
        captions = [cell.caption for cell, _ in self._read]
        sheet, factor = fitted_sheet(first.shot.heading, captions, size, columns, bits)
        cells = [(request, request.picture_keys(store)) for _, request in self.requests]
        for number in numbers:
            pictures = [shown_picture(*cell, store, number, factor, bits, display) for cell in cells]
            yield sheet.picture(pictures, f"frame {number} · {self.quality}")

    @property
    def _home(self) -> Path:
        return paths.wedge(self.shot.stem)

    def _take(self, cell: Cell, frames: str) -> RenderRequest:
        project = replace(self.project, settings=(*self.project.settings, *cell.settings))
        try:
            request = project.request(self.shot, self.quality, frames)
        except ShotError as error:
            raise ShotError(_at_the_variation(error.messages[0], self.grid.variations, cell)) from None
        except FlowsculptError as error:
            error.args = (f"{OPTION} with {', '.join(cell.settings)}: {error}",)
            raise
        return replace(request, home=(self._home / cell.folder).as_posix())


def _at_the_variation(message: str, variations: tuple[Variation, ...], cell: Cell) -> str:
    """Return the error of a cell, placed at the variation whose value is wrong."""
    for variation, setting in zip(variations, cell.settings, strict=True):
        if message.startswith(f"--set {setting}: "):
            value = shown(setting.partition("=")[2])
            return (
                f"{OPTION} {shown(variation.said)}: at {value}, {message.removeprefix(f'--set {setting}: ')}"
            )
    return f"{OPTION} with {', '.join(cell.settings)}: {message}"


def wedge_sequences(query: SequenceQuery) -> Iterator[SequenceGrid]:
    """Yield the cells of the wedges of a shot that have a contact sheet: its header says what was varied."""
    home = query.project.root / paths.wedge(query.path.stem)
    seen: set[tuple[str, str]] = set()
    for sheet in sorted(home.glob("*.png")):
        try:
            variations = [str(variation) for variation in read_header(sheet).get("wedge", [])]
            grid = Grid.parse(variations, many=True)
            quality = sheet.stem.rpartition(".")[0].removeprefix(f"{grid.name}.")
            if (grid.name, quality) not in seen and query.includes(quality):
                seen.add((grid.name, quality))
                yield _cells(query, Wedge(query.project, query.path, grid, quality))
        except FlowsculptError:
            continue  # it is another picture, or the shot has no such value any more


def _cells(query: SequenceQuery, wedge: Wedge) -> SequenceGrid:
    rendered = []
    for cell, request in wedge.requests:
        label = ", ".join(f"{name} {value}" for name, value in cell.caption)
        sequence = query.rendered(request.whole(), "wedge", f"{label} · {wedge.quality}")
        if sequence.files:
            rendered.append((cell.caption, sequence))
    numbers = tuple(sorted({number for _, sequence in rendered for number in sequence.files}))
    return SequenceGrid(
        wedge.grid.name,
        wedge.grid.columns,
        tuple(caption for caption, _ in rendered),
        tuple(replace(sequence, numbers=numbers) for _, sequence in rendered),  # cells are seldom whole
    )
