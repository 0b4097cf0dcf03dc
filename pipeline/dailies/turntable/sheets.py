"""Sheets and movies drawn from rendered turntables: key angles, and looks side by side.

renders/turntable/<name>/<quality>/<name>.png                   key angles, beside the movie
renders/turntable/<name>/<quality>/<name>.clay-glaze.{mp4,png}  looks side by side, and their key angles
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from pipeline.dailies.turntable.request import (
    EIGHTHS,
    QUARTERS,
    TurntableRequest,
    key_numbers,
    turn_and_angle,
)
from pipeline.errors import FrameError
from pipeline.production.request.crop_and_scale import movie_bits
from pipeline.production.request.keys import PictureKeys
from pipeline.production.request.render_request import RenderRequest
from pipeline.production.request.turntable import Turntable
from pipeline.production.stages import TURNTABLE_SHEET
from pipeline.production.store.paths import Folders
from pipeline.production.store.store import Store, key_of
from pipeline.production.versions.wedge import shown_picture
from render.graphics.contact_sheet import Caption, ContactSheet, columns_for, reduction
from render.movie.codecs import movie_encode
from render.movie.encode import write_movie
from render.movie.sequences import prefetch
from render.post.image import write_png

ROW = 4
"""Most looks in one row; with as many looks or more, each has its own row of key angles."""

Bar = Callable[[str, int], Callable[[], None]]
"""Adds a progress bar by name and total, and returns what advances it by one."""


def _no_bar(name: str, total: int) -> Callable[[], None]:
    return lambda: None


@dataclass(frozen=True, eq=False)
class TurntableSheets:
    """Sheets of a rendered turntable; missing pictures are shown as missing."""

    turning: TurntableRequest

    def draw(self, bar: Bar = _no_bar) -> list[Path]:
        """Draw all sheets that are not stored yet, and return their paths relative to the root.

        Return nothing if no picture is rendered. Raises FrameError for a damaged picture, MachineError if
        the disk refuses.
        """
        if not any(
            self._shown(index, n) for index, request in enumerate(self._takes) for n in request.requested
        ):
            return []
        drawn = [self._angles([index], request.movie_path) for index, request in enumerate(self._takes)]
        if len(self._takes) > 1:
            together = self._together
            every = range(len(self._takes))
            drawn = [self._movie(together, bar), self._angles(every, together), *drawn]
        return drawn

    @cached_property
    def _takes(self) -> list[RenderRequest]:
        return self.turning.requests

    @cached_property
    def _keys(self) -> list[PictureKeys | None]:
        return [request.picture_keys(self._store) for request in self._takes]

    @property
    def _store(self) -> Store:
        return self.turning.project.store

    @property
    def _table(self) -> Turntable:
        """The turntable of the first look; all have the same frames."""
        table = self._takes[0].turntable
        assert table is not None, "all takes are turntables"
        return table

    @property
    def _together(self) -> Path:
        """The path of the movie of all looks."""
        first, turns = self._takes[0], self.turning.turns
        folders = Folders(first.folders.home.parent, first.folders.name)
        part = "" if len(turns) > 1 else f".{turns[0]}"
        return folders.movie(first.quality_name, "-".join(self.turning.looks) + part)

    def _angles(self, which: Sequence[int], movie: Path) -> Path:
        """Draw key angles of one look, or of several: then each turn has a row, or each of many looks."""
        numbers = key_numbers(self._table, self.turning.turns, EIGHTHS if len(which) == 1 else QUARTERS)
        cells = [(index, number) for index in which for number in numbers]
        columns = min(QUARTERS, self._table.frames) if len(which) < ROW else len(numbers)
        captions = [self._caption(index, number, len(which) > 1) for index, number in cells]
        look = self.turning.looks[which[0]] if len(which) == 1 and self.turning.looks else ""
        sheet, factor = self._sheet(captions, columns)
        note = self._note(look)
        header = {"turntable": self._takes[0].folders.name, "quality": self._takes[0].quality_name}

        def write(path: Path) -> None:
            write_png(path, sheet.picture(self._pictures(cells, factor, 8, "srgb"), note), header)

        key = self._key("png", cells, captions, columns, note)
        self._store.put("png", key, write)
        self._store.link("png", key, movie.with_suffix(".png"))
        return movie.with_suffix(".png")

    def _movie(self, target: Path, bar: Bar) -> Path:
        """Write the movie of all looks side by side."""
        first, every = self._takes[0], range(len(self._takes))
        size = first.quality.width, first.quality.height
        columns = len(every) if len(every) <= ROW else columns_for(len(every), size)
        captions: list[Caption] = [(("", look),) for look in self.turning.looks]
        sheet, factor = self._sheet(captions, columns, 16)

        def page(number: int) -> NDArray[Any]:
            pictures = self._pictures([(index, number) for index in every], factor, 16, "rec709")
            return sheet.picture(pictures, " ".join(turn_and_angle(self._table, number)))

        def write(path: Path) -> None:
            shown = bar("side by side", len(first.requested))

            def pages() -> Iterator[NDArray[Any]]:
                for number in first.requested:
                    yield page(number)
                    shown()

            encode = movie_encode(movie_bits(first.quality_name))
            write_movie(path, prefetch(pages()), first.shot.rate.fps, encode)

        cells = [(index, number) for index in every for number in first.requested]
        key = self._key("movie", cells, captions, columns, str(first.source.summary.rate))
        self._store.put("movie", key, write)
        self._store.link("movie", key, target)
        return target

    def _sheet(self, captions: Sequence[Caption], columns: int, bits: int = 8) -> tuple[ContactSheet, int]:
        quality = self._takes[0].quality
        factor = reduction(len(captions), columns, (quality.width, quality.height))
        size = quality.width // factor, quality.height // factor
        return ContactSheet(self._heading, captions, size, columns, bits), factor

    @property
    def _heading(self) -> str:
        request = self._takes[0]
        return request.name if self._table.of_file else f"{request.name}: {request.shot.title}"

    def _note(self, look: str) -> str:
        frame = "" if self._table.of_file else f"frame {self._table.at}"
        return " · ".join(filter(None, (look, frame, self._takes[0].quality_name)))

    def _caption(self, index: int, number: int, with_look: bool) -> Caption:
        turn, angle = turn_and_angle(self._table, number)
        return ((self.turning.looks[index], f"{turn} {angle}"),) if with_look else ((turn, angle),)

    def _shown(self, index: int, number: int) -> str | None:
        """Return the key of a finished picture, if it is stored."""
        keys = self._keys[index]
        key = keys[number].frame if keys is not None else None
        return key if self._store.holds("frame", key) else None

    def _pictures(
        self, cells: Sequence[tuple[int, int]], factor: int, bits: int, display: str
    ) -> list[NDArray[Any] | None]:
        return [self._picture(index, number, factor, bits, display) for index, number in cells]

    def _picture(self, index: int, number: int, factor: int, bits: int, display: str) -> NDArray[Any] | None:
        keys = self._keys[index]
        if keys is None or self._shown(index, number) is None:
            return None
        request = self._takes[index]
        found = shown_picture(request, keys, self._store, number, factor, bits, display)
        if found is None:
            path = request.place("frame", number)
            raise FrameError(f"{path} cannot be read to its end; flowsculpt verify repairs it")
        return found

    def _key(self, kind: str, cells: Sequence[tuple[int, int]], *said: Any) -> str:
        shown = [self._shown(index, number) for index, number in cells]
        seen_through = [dict(request.shown_as) for request in self._takes]
        return key_of(TURNTABLE_SHEET.recipe, kind, self._heading, shown, seen_through, *said)
