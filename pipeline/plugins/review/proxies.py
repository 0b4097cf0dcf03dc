"""Proxies of frames for the page: display pictures, and a sheet of thumbnails."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.production.picture_sequences import PictureSequence
from pipeline.production.request.keys import projection_of
from pipeline.production.store.digests import CorruptFileError
from pipeline.production.store.paths import SUFFIXES
from pipeline.production.store.store import Store, key_of
from render.base.render_errors import RenderError
from render.graphics.contact_sheet import reduced
from render.post.colour import quantise, to_display
from render.post.image import read_exr, read_png, write_jpeg, write_png

THUMB = 160
"""Width of thumbnails, about, in pixels."""

MOST_THUMBS = 400
"""Most thumbnails on a sheet; longer shots show every second frame, or every third."""

SHEET_COLUMNS = 20

EMPTY_SIZE = (16, 9)
"""Size of a sequence without pictures, pixels: its aspect on the page."""


@dataclass(frozen=True)
class Proxies:
    """The pictures of one sequence on a page.

    files   by frame, file names in the page's folder of pictures
    faults  by frame, the fault of pictures that cannot be read
    size    width and height, pixels
    """

    files: dict[int, str]
    faults: dict[int, str]
    size: tuple[int, int]


@dataclass(frozen=True)
class ProxyWriter:
    """Writes proxies (`form`: jpeg or png) to the store, and links them into the page's folder."""

    store: Store
    folder: Path
    form: str
    threads: int

    def proxies(self, sequence: PictureSequence, tell: Callable[[], None]) -> Proxies:
        """Write proxies of all readable pictures; call `tell` after each. Raises MachineError."""
        files: dict[int, str] = {}
        faults: dict[int, str] = {}
        with ThreadPoolExecutor(self.threads) as pool:
            for number, name in pool.map(lambda n: (n, self._proxy(sequence, n)), sequence.pictures):
                if name is None:
                    faults[number] = "it is damaged; flowsculpt verify repairs it"
                else:
                    files[number] = name
                tell()
        if not files:
            return Proxies(files, faults, EMPTY_SIZE)
        height, width = read_png(self.folder / next(iter(files.values()))).shape[:2]
        return Proxies(files, faults, (width, height))

    def _proxy(self, sequence: PictureSequence, number: int) -> str | None:
        """Write one proxy, and return its file's name; None if the picture is damaged."""
        picture, key = sequence.pictures[number], sequence.still_key(self.form, number)
        display = sequence.display

        def write(path: Path) -> None:
            self.store.digests.check(picture.path)
            layers, finished = read_exr(picture.path)
            pixels = quantise(to_display(layers["beauty"], display.exposure, "srgb", display.view))
            header = {"shot": sequence.shot, "frame": number, "key": key}
            if self.form == "jpeg":
                write_jpeg(path, pixels, header, projection_of(finished))
            else:
                write_png(path, pixels, header)

        try:
            self.store.put(self.form, key, write)
        except (CorruptFileError, RenderError):
            return None
        name = f"{key}{SUFFIXES[self.form]}"
        self.store.link(self.form, key, (self.folder / name).relative_to(self.store.root))
        return name

    def sheet(self, proxies: Proxies) -> dict[str, Any] | None:
        """Write a sheet of thumbnails in rows; return its file, layout and frames."""
        step = -(-len(proxies.files) // MOST_THUMBS)
        numbers = sorted(proxies.files)[:: step or 1]
        if not numbers:
            return None
        factor = max(1, round(proxies.size[0] / THUMB))
        columns = min(SHEET_COLUMNS, len(numbers))
        width, height = (max(1, side // factor) for side in proxies.size)
        names = [proxies.files[number] for number in numbers]
        name = f"{key_of('thumbs', names, factor, columns)}.jpg"
        if not self.store.is_whole(self.folder / name):
            sheet = self._laid_out(names, factor, columns, (width, height))
            self.store.write(self.folder / name, lambda path: write_jpeg(path, sheet))
        return {"file": name, "columns": columns, "size": [width, height], "frames": numbers}

    def _laid_out(
        self, names: Sequence[str], factor: int, columns: int, size: tuple[int, int]
    ) -> NDArray[np.uint8]:
        width, height = size
        sheet = np.zeros((-(-len(names) // columns) * height, columns * width, 3), np.uint8)

        def small(name: str) -> NDArray[np.uint8]:
            picture = read_png(self.folder / name)[..., :3].astype(np.float32)
            return np.rint(reduced(picture, min(factor, *picture.shape[:2]))).astype(np.uint8)

        with ThreadPoolExecutor(self.threads) as pool:
            for index, thumb in enumerate(pool.map(small, names)):
                row, column = divmod(index, columns)
                thumb = thumb[:height, :width]
                cell = sheet[row * height :, column * width :]
                cell[: thumb.shape[0], : thumb.shape[1]] = thumb
        return sheet
