"""Pictures of the page: proxies of frames, a sheet of thumbnails, and layers of some frames.

A page in a local folder may not read pixels of picture files, but it may run scripts: each layer of a frame
is a script that calls the page's `reviewLayer`.
"""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flowsculpt.api.frames import PictureSequence, Store, StoredFiles, key_of
from flowsculpt.api.pictures import HDR_DISPLAYS, RenderError, read_exr, read_header, read_png, write_still

THUMB = 160  # width of thumbnails, about, in pixels

MOST_THUMBS = 400  # most thumbnails on a sheet; longer shots show every second frame, or every third

SHEET_COLUMNS = 20

EMPTY_SIZE = (16, 9)  # size of a sequence without pictures, pixels: its aspect on the page


@dataclass(frozen=True)
class Proxies:
    """The files of one sequence by frame, the faults of unreadable ones, and the size in pixels.

    scopes  the files of their levels
    """

    files: dict[int, str]
    scopes: dict[int, str]
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
        files, scopes = dict[int, str](), dict[int, str]()
        faults: dict[int, str] = {}
        with ThreadPoolExecutor(self.threads) as pool:
            names = pool.map(lambda number: self._proxy(sequence, number), sequence.pictures)
            for number, written in zip(sequence.pictures, names, strict=True):
                if written is None:
                    faults[number] = "it is damaged; flowsculpt verify repairs it"
                else:
                    files[number], scopes[number] = written
                tell()
        if not files:
            return Proxies(files, scopes, faults, EMPTY_SIZE)
        height, width = read_png(self.folder / next(iter(files.values()))).shape[:2]
        return Proxies(files, scopes, faults, (width, height))

    def _proxy(self, sequence: PictureSequence, number: int) -> tuple[str, str] | None:
        """Write one proxy and its levels, and return their files' names; None if the picture is damaged."""
        picture, key = sequence.pictures[number], sequence.still_key(self.form, number)
        scope = f"{key_of('scope', SCOPE_FORMAT, sequence.still_key('png', number))}.js"

        def shown() -> NDArray[Any]:
            self.store.digests.check(picture.path)
            layers, _ = read_exr(picture.path)
            pixels = sequence.display.pixels(layers["beauty"], "srgb", 8)
            if not self.store.is_whole(self.scopes / scope):
                text = scope_script(scope, pixels)
                self.store.write(self.scopes / scope, lambda draft: draft.write_text(text, encoding="utf-8"))
            return pixels

        def write(path: Path) -> None:
            header = {"shot": sequence.shot, "frame": number, "key": key}
            write_still(path, shown(), header, form=self.form, projection=picture.projection)

        try:
            self.store.put(self.form, key, write)
            if not self.store.is_whole(self.scopes / scope):
                shown()
        except (*StoredFiles.DAMAGED, RenderError):
            return None
        name = f"{key}{StoredFiles(self.form).suffix}"
        self.store.link(self.form, key, (self.folder / name).relative_to(self.store.root))
        return name, scope

    @property
    def scopes(self) -> Path:
        """The folder of the levels of pictures."""
        return self.folder.parent / "scopes"

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
            self.store.write(self.folder / name, lambda path: write_still(path, sheet, form="jpeg"))
        return {"file": name, "columns": columns, "size": [width, height], "frames": numbers}

    def _laid_out(
        self, names: Sequence[str], factor: int, columns: int, size: tuple[int, int]
    ) -> NDArray[np.uint8]:
        width, height = size
        sheet = np.zeros((-(-len(names) // columns) * height, columns * width, 3), np.uint8)

        def small(name: str) -> NDArray[np.uint8]:
            picture = read_png(self.folder / name)[..., :3]
            step = min(factor, *picture.shape[:2])
            height, width = (side // step for side in picture.shape[:2])
            blocks = picture[: height * step, : width * step].reshape(height, step, width, step, 3)
            return np.rint(blocks.mean(axis=(1, 3), dtype=np.float32)).astype(np.uint8)

        with ThreadPoolExecutor(self.threads) as pool:
            for index, thumb in enumerate(pool.map(small, names)):
                row, column = divmod(index, columns)
                thumb = thumb[:height, :width]
                cell = sheet[row * height :, column * width :]
                cell[: thumb.shape[0], : thumb.shape[1]] = thumb
        return sheet


SCOPE_FORMAT, SCOPE_COLUMNS, SCOPE_LEVELS = 1, 96, 64
"""Version of the scripts of levels, and columns and levels of their waveforms: `levels.js` has the same."""


def scope_script(file: str, pixels: NDArray[np.uint8]) -> str:
    """Return a call of the page's `reviewScope` with the levels of a picture (H, W, 3): deflate, base64.

    Bytes (4, SCOPE_LEVELS, SCOPE_COLUMNS) of luma, red, green and blue are the root of the share of the
    pixels of a column that have a level; 32-bit numbers (4, 256) are the pixels of each step.
    """
    height, width = pixels.shape[:2]
    red, green, blue = np.moveaxis(pixels[..., :3], 2, 0)
    luma = np.floor(0.2126 * red + 0.7152 * green + 0.0722 * blue + 0.5).astype(np.uint8)
    columns = np.arange(width) * SCOPE_COLUMNS // width
    whole = height * np.bincount(columns, minlength=SCOPE_COLUMNS).clip(1)
    waves, counts = list[bytes](), list[bytes]()
    for values in (luma, red, green, blue):
        places = (values // (256 // SCOPE_LEVELS)).astype(np.int64) * SCOPE_COLUMNS + columns
        found = np.bincount(places.ravel(), minlength=SCOPE_LEVELS * SCOPE_COLUMNS).reshape(SCOPE_LEVELS, -1)
        waves.append(np.floor(255.0 * np.sqrt(found / whole) + 0.5).astype(np.uint8).tobytes())
        counts.append(np.bincount(values.ravel(), minlength=256).astype("<u4").tobytes())
    data = base64.b64encode(zlib.compress(b"".join((*waves, *counts)), 6)).decode("ascii")
    return f"reviewScope({json.dumps(file)}, {json.dumps(data)});\n"


FORMAT = 3

VIEW = "view"  # the table of the view of a sequence, as a layer: display values by light

DISPLAY = "picture"  # the layer of display values, 8 bits: the picture as the page's JPEG or PNG shows it

HDR = "nits"  # the layer of what an HDR screen of 1000 nits shows, by channels of BT.2020

LIGHT = ("beauty", "denoised", "noise")
"""Layers shown by the shot's exposure through the display's curve, as are those of light groups."""

GROUP = "light_"  # the beginning of the names of layers of light groups

REFLECTANCE = ("albedo", "denoise_albedo")  # layers shown through the display's curve; others are data

LARGEST_HALF = 65504.0


@dataclass(frozen=True)
class LayerWriter:
    """Writes the layers of at most `most` frames of each sequence into the page's folder of layers."""

    store: Store
    folder: Path
    most: int
    threads: int

    def chosen(self, sequence: PictureSequence) -> list[int]:
        """Return the frames, evenly spaced, with the first and the last of those that can be read."""
        numbers = sorted(sequence.pictures)
        indices = np.linspace(0, len(numbers) - 1, min(self.most, len(numbers))).round().astype(int)
        return [numbers[index] for index in dict.fromkeys(indices.tolist())]

    def write(self, sequence: PictureSequence, tell: Callable[[], None]) -> dict[int, dict[str, str]]:
        """Write layers unless they are there; return the names of files by frame and layer."""

        def written(number: int) -> tuple[int, dict[str, str]]:
            files = self._write(sequence, number)
            tell()
            return number, files

        with ThreadPoolExecutor(self.threads) as pool:
            return {number: files for number, files in pool.map(written, self.chosen(sequence)) if files}

    def _write(self, sequence: PictureSequence, number: int) -> dict[str, str]:
        """Write the layers of one frame, and return their files; none if the picture is damaged."""
        picture = sequence.pictures[number]
        try:
            self.store.digests.check(picture.path)
            finished = read_exr(picture.path)[0].arrays
            display = sequence.display
            shown = display.pixels(finished["beauty"], "srgb", 8)
            arrays = {**finished, **_raw_layers(sequence, number, finished), **_hdr_layer(sequence, finished)}
        except (*StoredFiles.DAMAGED, RenderError, ValueError):
            return {}
        files = {}
        view = self._write_view(sequence)
        for name, values in {DISPLAY: shown, **arrays}.items():
            file = f"{key_of('layer', FORMAT, sequence.still_key('png', number), name)}.js"
            if not self.store.is_whole(self.folder / file):
                about = {"view": view} if name == "beauty" or name.startswith(GROUP) else {}
                self._write_text(file, as_script(file, name, values, display.exposure, about))
            files[name] = file
        return {**files, VIEW: view}

    def _write_view(self, sequence: PictureSequence) -> str:
        """Write the table of a sequence's view unless it is there, and return its file's name."""
        file = f"{key_of('view', FORMAT, sequence.display.view.recipe)}.js"
        if not self.store.is_whole(self.folder / file):
            table = sequence.display.table()
            side = table.values.shape[0]
            steps = np.rint(255.0 * np.clip(table.values, 0.0, 1.0)).astype(np.uint8)
            about = {"toe": table.toe, "white": table.white, "side": side}
            self._write_text(file, as_script(file, DISPLAY, steps.reshape(side * side, side, 3), about=about))
        return file

    def _write_text(self, file: str, script: str) -> None:
        self.store.write(self.folder / file, lambda draft: draft.write_text(script, encoding="utf-8"))


def _hdr_layer(sequence: PictureSequence, finished: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Return the nits of a frame on an HDR screen; nothing for views of a shot's own, which have no HDR."""
    try:
        return {HDR: HDR_DISPLAYS["pq"].nits(sequence.display.values(finished["beauty"], "pq"))}
    except RenderError:
        return {}


def _raw_layers(
    sequence: PictureSequence, number: int, finished: Mapping[str, NDArray[Any]]
) -> dict[str, NDArray[Any]]:
    """Return the AOVs of the rendered frame that the finished one was made from and does not have.

    There are none if the rendered frame is gone, or was rendered again since.
    """
    path, picture = sequence.raws.get(number), sequence.pictures[number]
    if path is None or not path.is_file():
        return {}
    try:
        if read_header(path).get("key") != picture.header.get("raw_key"):
            return {}
        arrays = read_exr(path)[0].arrays
    except RenderError:
        return {}
    return {name: arrays[name] for name in sorted(arrays) if name not in finished}


def as_script(
    file: str,
    name: str,
    values: NDArray[Any],
    exposure: float = 0.0,
    about: Mapping[str, Any] = MappingProxyType({}),
) -> str:
    """Return a call of the page's `reviewLayer` with a layer, (H, W) or (H, W, C).

    Channels lie one after another as 16 bits, half floats or display steps; each value is the difference
    from the one before it, modulo 2^16; of each channel the lower bytes, then the upper; deflate; base64.

    low, high  shown as black and white; vectors have zero in the middle
    exposure   stops, of layers of light
    about      further facts for the page
    """
    planes = np.moveaxis(values.reshape(*values.shape[:2], -1), 2, 0)
    if name == DISPLAY:
        kind, bits, low, high = "display", planes.astype("<u2"), 0.0, 255.0
    else:
        is_light = name in LIGHT or name.startswith(GROUP)
        kind = "light" if is_light or name in REFLECTANCE else "data"
        bits = np.clip(planes, -LARGEST_HALF, LARGEST_HALF).astype("<f2").view("<u2")
        low, high = _range(planes) if kind == "data" else (0.0, 2.0**-exposure if is_light else 1.0)
    rows = np.diff(bits.reshape(len(bits), -1), prepend=np.uint16(0))
    differences = np.ascontiguousarray(rows, "<u2")
    swapped = np.moveaxis(differences.view(np.uint8).reshape(*differences.shape, 2), 2, 1)
    data = {
        "kind": kind,
        "width": values.shape[1],
        "height": values.shape[0],
        "channels": len(planes),
        "low": low,
        "high": high,
        **about,
        "data": base64.b64encode(zlib.compress(swapped.tobytes(), 6)).decode("ascii"),
    }
    return f"reviewLayer({json.dumps(file)}, {json.dumps(data)});\n"


def _range(planes: NDArray[Any]) -> tuple[float, float]:
    """Return the values of a data layer that are shown as black and white."""
    finite = planes[np.isfinite(planes)]
    if not finite.size:
        return 0.0, 1.0
    low, high = float(finite.min()), float(finite.max())
    if len(planes) > 1 and low < 0.0:
        low, high = -max(-low, high), max(-low, high)
    elif low >= 0.0 and high <= 1.0:
        low, high = 0.0, 1.0
    return low, high if high > low else low + 1.0
