"""The family tree: a row of pictures for each generation, with lines from parents to their children."""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, BaseModel, Field, ValidationError

from flowsculpt import FlowsculptError, UsageError
from flowsculpt.api.frames import Show
from flowsculpt.api.pictures import Font, read_png

RECORD = "generation.json"
"""The file that says what a generation was bred from."""

PICTURES = "pictures"
"""The folder of the last picture of each child."""

GAP, MARGIN, TEXT, ABOVE = 10, 28, 14, 64
"""Pixels between pictures, around the tree, of its letters, and between rows."""

GROUND, QUIET, INK = 24 / 255, 0.56, 0.92
"""Display values of the ground, of headings and of labels: those of contact sheets."""

LINE, FAVOURITE, PARENT = (120, 120, 120), (236, 196, 110), (255, 255, 255)
"""Colours of lines, and of frames around favourites and parents."""

VACANT = (120, 68)
"""Size of the place of a picture that is not there any more, pixels."""

Pixels = NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class Row:
    """One generation, or the shots that the first one was bred from.

    pictures    by the names of shots, in order; None where a picture is not there any more
    parents     names of shots in rows above
    favourites  names of shots in rows above
    """

    heading: str
    pictures: dict[str, Pixels | None]
    parents: tuple[str, ...] = ()
    favourites: tuple[str, ...] = ()


def _checked(name: str) -> str:
    """Return a name from which paths are made. Raises ValueError for one that no shot can have."""
    if fault := Show.name_fault(name):
        raise ValueError(fault)
    return name


Name = Annotated[str, AfterValidator(_checked)]


class _Parent(BaseModel):
    name: str = ""
    folder: Annotated[str, Field(pattern=r"^[^\x00]*$")] = ""


class _Child(BaseModel):
    name: Name


class GenerationRecord(BaseModel):
    """What is read of RECORD, which may be of somebody else."""

    name: Name
    generation: int
    seed: int
    change: float
    parents: list[_Parent]
    favourites: list[str] = []
    children: Annotated[list[_Child], Field(min_length=1)]


def read_record(folder: Path) -> GenerationRecord | None:
    """Return what a folder says of its generation; None where it has none.

    Raises UsageError for what `breed` cannot have written.
    """
    try:
        return GenerationRecord.model_validate_json((folder / RECORD).read_bytes())
    except ValidationError as error:
        fault = error.errors()[0]
        place = ".".join(map(str, fault["loc"])) or "record"
        message = fault["msg"].removeprefix("Value error, ")
        raise UsageError(f"{folder / RECORD}: {place}: {message}; flowsculpt breed writes it") from None
    except (OSError, ValueError):
        return None


def _known(folder: Path) -> GenerationRecord | None:
    with suppress(UsageError):
        return read_record(folder)
    return None


def rows_of(folder: Path, place: Path) -> list[Row]:
    """Return the rows of a generation and all before it, oldest first.

    folder  its files
    place   the folder that its record means by relative paths
    """
    found: dict[Path, tuple[GenerationRecord, Path]] = {}
    first: dict[str, Pixels | None] = {}
    waiting = [(folder, place)]
    while waiting:
        files, home = waiting.pop()
        record = _known(files)
        if record is None or home.resolve() in found:
            continue
        found[home.resolve()] = (record, files)
        for number, parent in enumerate(record.parents, 1):
            before = Path(os.path.normpath(home / parent.folder))  # home may not be there yet
            if _known(before) is not None:
                waiting.append((before, before))
            else:
                first.setdefault(parent.name, _picture(files, f"parent_{number}"))
    generations = sorted(found.values(), key=lambda item: (item[0].generation, item[0].name))
    return [Row("", first), *(_row(record, files) for record, files in generations)]


def _row(record: GenerationRecord, files: Path) -> Row:
    names = [child.name for child in record.children]
    heading = f"{record.name}   seed {record.seed}, change {record.change:g}"
    parents = tuple(parent.name for parent in record.parents)
    return Row(heading, {n: _picture(files, n) for n in names}, parents, tuple(record.favourites))


def _picture(files: Path, name: str) -> Pixels | None:
    try:
        return np.asarray(read_png(files / PICTURES / f"{name}.png")[..., :3], np.uint8)
    except (FlowsculptError, OSError):
        return None


def family_picture(folder: Path, place: Path) -> Pixels:
    """Draw the family of a generation (H, W, 3); arguments as of `rows_of`."""
    rows = rows_of(folder, place)
    sizes = [picture.shape[1::-1] for row in rows for picture in row.pictures.values() if picture is not None]
    wide, high = max(w for w, _ in [*sizes, VACANT]), max(h for _, h in [*sizes, VACANT])
    most = max(len(row.pictures) for row in rows)
    width = 2 * MARGIN + most * (wide + GAP) - GAP
    height = 2 * MARGIN + len(rows) * (high + ABOVE)
    page, font = np.full((height, width, 3), round(255 * GROUND), np.uint8), Font("DroidSans", TEXT)
    places: dict[str, tuple[int, int]] = {}
    for index, row in enumerate(rows):
        left = (width - len(row.pictures) * (wide + GAP) + GAP) // 2
        y = MARGIN + index * (high + ABOVE) + (ABOVE - 14 if index else TEXT)
        places |= {name: (left + k * (wide + GAP), y) for k, name in enumerate(row.pictures)}
        _draw_lines(page, row, places, (wide, high))
    for row in rows:
        for name, picture in row.pictures.items():
            x, y = places[name]
            page[y : y + high, x : x + wide] = round(255 * GROUND) + 14
            if picture is not None:
                h, w = picture.shape[:2]
                x0, y0 = x + (wide - w) // 2, y + (high - h) // 2
                page[y0 : y0 + h, x0 : x0 + w] = picture
            number = name.rpartition("_")[2] if row.heading else name
            label = font.cut_short(number, wide)
            font.write(page, label, (x, y + high + TEXT + 3), round(255 * INK))
        if row.heading:
            x, y = places[next(iter(row.pictures))]
            font.write(page, row.heading, (x, y - 8), round(255 * QUIET))
    for row in rows:
        for names, colour, wide_line in ((row.favourites, FAVOURITE, 3), (row.parents, PARENT, 3)):
            for name in names:
                if name in places:
                    _frame(page, places[name], (wide, high), colour, wide_line)
    return page


def _draw_lines(page: Pixels, row: Row, places: dict[str, tuple[int, int]], size: tuple[int, int]) -> None:
    """Draw a line from each parent of a row down to a line along it."""
    wide, high = size
    above = [places[name] for name in row.parents if name in places]
    if not above:
        return
    own = [places[name] for name in row.pictures]
    y = own[0][1] - 26
    columns = [x + wide // 2 for x, _ in (*above, own[0], own[-1])]
    _fill(page, min(columns), y, max(columns) + 2, y + 2, LINE)
    for x, top in above:
        _fill(page, x + wide // 2, top + high, x + wide // 2 + 2, y, LINE)


def _frame(
    page: Pixels, place: tuple[int, int], size: tuple[int, int], colour: Sequence[int], line: int
) -> None:
    (x, y), (w, h) = place, size
    for box in (
        (x, y, x + w, y + line),
        (x, y + h - line, x + w, y + h),
        (x, y, x + line, y + h),
        (x + w - line, y, x + w, y + h),
    ):
        _fill(page, *box, colour)


def _fill(page: Pixels, x0: int, y0: int, x1: int, y1: int, colour: Sequence[int]) -> None:
    page[y0:y1, x0:x1] = colour
