"""Proxies of frames for the page: display pictures, and a sheet of thumbnails."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.dailies.review.sequence import PictureSequence
from pipeline.production.store.store import SUFFIXES, Key, Store, key_of
from render.base.errors import RenderError
from render.graphics.contact_sheet import reduced
from render.post.colour import quantise, to_display
from render.post.image import read_exr, read_png, write_jpeg, write_png

THUMB = 160
"""Width of thumbnails, about, in pixels."""

MOST_THUMBS = 400
"""Most thumbnails on a sheet; longer shots show every second frame, or every third."""

SHEET_COLUMNS = 20


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

    def proxies(self, pictures: PictureSequence, tell: Callable[[], None]) -> Proxies:
        """Write proxies of all readable pictures; call `tell` after each. Raises MachineError."""
        files: dict[int, str] = {}
        faults: dict[int, str] = {}
        with ThreadPoolExecutor(self.threads) as pool:
            for number, name in pool.map(lambda n: (n, self._proxy(pictures, n)), pictures.found):
                if name is None:
                    faults[number] = "it cannot be read to its end; flowsculpt verify repairs it"
                else:
                    files[number] = name
                tell()
        settings = next(iter(pictures.found.values())).header.get("settings", {}) if files else {}
        size = self._size(files) or (settings.get("width", 16), settings.get("height", 9))
        return Proxies(files, faults, size)

    def _proxy(self, pictures: PictureSequence, number: int) -> str | None:
        found, key = pictures.found[number], pictures.still_key(self.form, number)
        display = pictures.display

        def write(path: Path) -> None:
            light = read_exr(found.path)[0]["beauty"]
            shown = quantise(to_display(light, display.exposure, "srgb", display.view))
            header = {"shot": pictures.shot, "frame": number, "key": key}
            (write_jpeg if self.form == "jpeg" else write_png)(path, shown, header)

        try:
            self.store.put(self.form, key, write)
        except RenderError:
            return None
        name = f"{key}{SUFFIXES[self.form]}"
        self.store.link(self.form, key, (self.folder / name).relative_to(self.store.root))
        return name

    def _size(self, files: dict[int, str]) -> tuple[int, int] | None:
        for name in files.values():
            height, width = read_png(self.folder / name).shape[:2]
            return width, height
        return None

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
        name = f"{sheet_key(names, factor, columns)}.jpg"
        if not (self.folder / name).exists():
            write_jpeg(self.folder / name, self._laid_out(names, factor, columns, (width, height)))
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
                place = sheet[row * height :, column * width :]
                place[: thumb.shape[0], : thumb.shape[1]] = thumb
        return sheet


def sheet_key(names: Sequence[str], factor: int, columns: int) -> Key:
    return key_of("thumbs", list(names), factor, columns)
