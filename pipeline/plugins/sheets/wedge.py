"""Wedges: a shot rendered over and over with other values, all of it planned as one run.

renders/wedge/<shot>/<cell>/<quality>/frames/…     a cell's files, as those of a shot
renders/wedge/<shot>/<wedge>.<quality>.0024.png    the contact sheet; of several frames also an MP4
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from flowsculpt import FlowsculptError, UsageError
from flowsculpt.api import ShotError, shorten
from flowsculpt.api.commands import Project
from flowsculpt.api.frames import (
    FinishedPictures,
    Folders,
    FrameRange,
    Plan,
    RenderRequest,
    SequenceGrid,
    SequenceQuery,
    key_of,
)
from flowsculpt.api.pictures import ENCODES, ContactSheet, read_header, write_movie, write_still

OPTION = "--vary"
MOST_CELLS = 100  # cells of a wedge at most, without --yes

MOST_AT_ALL = 10_000

_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_STEPS = re.compile(rf"\s*({_NUMBER}):({_NUMBER}):(\d+)\s*")
_LONGEST_NAME = 100  # letters of a cell's folder; the end of a longer name is replaced by a digest


@dataclass(frozen=True)
class Variation:
    """The name of a value in a shot, and the values that it takes, in YAML; `said` is what the user wrote."""

    name: str
    values: tuple[str, ...]
    said: str

    @classmethod
    def parse(cls, text: str) -> Variation:
        """Parse `flows.0.vortex.strength=1:3:5`, five values from 1 to 3, or `look=clay,glaze`.

        Raises UsageError, with the option, for what is neither, for fewer than two values and for equal ones.
        """
        name, equals, rest = (part.strip() for part in text.partition("="))
        place = f"{OPTION} {shorten(text)}"
        if not (name and equals and rest):
            raise UsageError(
                f"{place}: this varies nothing. Write name=first:last:count, such as "
                "flows.0.vortex.strength=1:3:5, or name=value,value."
            )
        steps = _STEPS.fullmatch(rest)
        values = _steps(place, *steps.groups()) if steps else _listed(rest)
        if len(values) < 2:
            raise UsageError(
                f"{place}: one value; a wedge needs at least two (--set sets one). Write "
                "name=first:last:count, or values with commas between them."
            )
        if len(set(values)) < len(values):
            twice = next(value for value in values if values.count(value) > 1)
            raise UsageError(f"{place}: {shorten(twice)} is listed twice. Remove one.")
        return cls(name, values, text)


@dataclass(frozen=True)
class Cell:
    """One combination of values, in the order of the variations, and the caption below its picture.

    folder  the name of its folder, from its values: the same cell of another wedge has the same
    """

    settings: tuple[str, ...]
    folder: str
    caption: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Grid:
    """Every combination of the values of variations; those of the last change fastest."""

    variations: tuple[Variation, ...]

    @classmethod
    def parse(cls, texts: Sequence[str], many: bool = False) -> Grid:
        """`many` allows more than MOST_CELLS. Raises UsageError, with the option that is wrong."""
        if not texts:
            raise UsageError(f"a wedge needs {OPTION} and what varies, such as flows.0.vortex.strength=1:3:5")
        variations = tuple(map(Variation.parse, texts))
        names = [variation.name for variation in variations]
        for i, name in enumerate(names):
            if name in names[:i]:
                raise UsageError(
                    f"{OPTION} {shorten(texts[i])}: {shorten(name)} is varied twice. List its values in one."
                )
        grid, most = cls(variations), MOST_AT_ALL if many else MOST_CELLS
        if len(grid) > most:
            counts = " × ".join(str(len(variation.values)) for variation in variations)
            remedy = "take fewer values" if many else "take fewer values, or add --yes if you mean it"
            raise UsageError(
                f"{OPTION} {shorten(texts[-1])}: that makes {counts} = {len(grid)} cells, and a wedge has "
                f"at most {most}; {remedy}"
            )
        return grid

    def __len__(self) -> int:
        return math.prod(len(variation.values) for variation in self.variations)

    def __iter__(self) -> Iterator[Cell]:
        short = _short_names([variation.name for variation in self.variations])
        taken: set[str] = set()
        for values in product(*(variation.values for variation in self.variations)):
            pairs = zip(self.variations, values, strict=True)
            settings = tuple(f"{variation.name}={value}" for variation, value in pairs)
            folder = _folder(settings, taken)
            taken.add(folder.lower())
            yield Cell(settings, folder, tuple(zip(short, values, strict=True)))

    @property
    def columns(self) -> int | None:
        """Columns of a sheet whose rows go through the last variation; None if there is only one."""
        return len(self.variations[-1].values) if len(self.variations) > 1 else None

    @property
    def name(self) -> str:
        """The name of its sheets, from the names of the values."""
        return _folder([variation.name for variation in self.variations], set())


def _steps(place: str, first: str, last: str, count: str) -> tuple[str, ...]:
    """Return `count` numbers at equal distances, each with at most six digits."""
    many = int(count[:9])
    if many > MOST_AT_ALL:
        raise UsageError(f"{place}: {count} values are too many; a wedge has at most {MOST_AT_ALL} cells")
    if many == 0:
        raise UsageError(f"{place}: no values; the last number is how many, 2 or more")
    begin, end = float(first), float(last)
    if not (math.isfinite(begin) and math.isfinite(end)):
        raise UsageError(f"{place}: one of the numbers is too large; use smaller ones")
    shares = (i / max(1, many - 1) for i in range(many))
    return tuple(f"{begin * (1.0 - share) + end * share:.6g}" for share in shares)


def _listed(text: str) -> tuple[str, ...]:
    """Return the parts between commas outside of brackets and quotes."""
    parts, depth, quote = [""], 0, ""
    for letter in text:
        if quote:
            quote = "" if letter == quote else quote
        elif letter in "'\"":
            quote = letter
        else:
            depth += (letter in "[{(") - (letter in "]})")
        if letter == "," and depth == 0 and not quote:
            parts.append("")
        else:
            parts[-1] += letter
    return tuple(part.strip() for part in parts if part.strip())


def _short_names(names: Sequence[str]) -> list[str]:
    """Return for each name the shortest end that differs from the others and begins with an identifier."""
    parts = [name.split(".") for name in names]

    def short(each: Sequence[str], length: int) -> tuple[str, ...]:
        while length < len(each) and (each[-length] == "keys" or not each[-length].isidentifier()):
            length += 1
        return tuple(each[-length:])

    length = 1
    while len({short(each, length) for each in parts}) < len(names):
        length += 1
    return [".".join(short(each, length)) for each in parts]


def _folder(settings: Sequence[str], taken: set[str]) -> str:
    """Return a folder name, valid on any system and different from those `taken`."""
    plain = ",".join(re.sub(r"[^\w.=+-]+", "_", setting) for setting in settings)
    if len(plain) > _LONGEST_NAME or plain.lower() in taken:
        return f"{plain[: _LONGEST_NAME - 9]}~{key_of(list(settings))[:8]}"
    return plain


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
    frames: FrameRange | None = None
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
        still = FrameRange([self.number])  # wrong frames are refused before wrong cells
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
        store.write(store.root / self.still_path, lambda path: write_still(path, page, header))
        if self.movie_path is None:
            return [self.still_path]
        first = self._read[0][1]
        pages = self._pages(sorted(first.requested), 16, "rec709")
        rate = first.shot.rate.fps
        store.write(
            store.root / self.movie_path, lambda path: write_movie(path, pages, rate, ENCODES["phone"])
        )
        return [self.still_path, self.movie_path]

    def _pages(self, numbers: Sequence[int], bits: int, display: str) -> Iterator[NDArray[Any]]:
        """Yield the contact sheet of frames."""
        first, store = self._read[0][1], self.project.store
        sizes = [(cell.pictures.quality.width, cell.pictures.quality.height) for _, cell in self._read]
        size = max(width for width, _ in sizes), max(height for _, height in sizes)
        columns = self.columns or self.grid.columns or ContactSheet.columns_for(len(self.grid), size)
        captions = [cell.caption for cell, _ in self._read]
        sheet, factor = ContactSheet.fitted(first.shot.heading, captions, size, columns, bits)
        cells = [FinishedPictures(request, store) for _, request in self.requests]
        for number in numbers:
            pictures = [cell.pixels(number, factor, bits, display) for cell in cells]
            yield sheet.picture(pictures, f"frame {number} · {self.quality}")

    @property
    def _home(self) -> Path:
        return wedge_folder(self.shot.stem)

    def _take(self, cell: Cell, frames: FrameRange) -> RenderRequest:
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
        if message.startswith(place := f"--set {shorten(setting)}: "):
            value, fault = shorten(setting.partition("=")[2]), message.removeprefix(place)
            return f"{OPTION} {shorten(variation.said)}: at {value}, {fault}"
    return f"{OPTION} with {', '.join(cell.settings)}: {message}"


def wedge_folder(name: str) -> Path:
    """Return the folder of a shot's wedges: cells and sheets."""
    return Folders.of_kind("wedge", name).home


def wedge_sequences(query: SequenceQuery) -> Iterator[SequenceGrid]:
    """Yield the cells of the wedges of a shot that have a contact sheet: its header says what was varied."""
    home = query.project.root / wedge_folder(query.path.stem)
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
