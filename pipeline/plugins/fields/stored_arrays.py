"""Arrays of NetCDF, HDF5 and Zarr, opened by xarray with nothing decoded, and the files that hold them."""

from __future__ import annotations

import json
import re
import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from flowsculpt import FlowsculptError, MachineError, MissingInputError, UsageError
from flowsculpt.api import shorten, suggest
from flowsculpt.api.files import InputFile
from flowsculpt.pipeline.plugins.fields.windowed_samples import SourceFiles, file_digest

NETCDF = (".nc", ".nc4", ".cdf", ".netcdf", ".h5", ".hdf5", ".he5")
SUFFIXES = (*NETCDF, ".zarr")

NUMBERS = re.compile(r"(float|u?int)(8|16|32|64)|[<>|][fiu][1248]")
"""Names of types in Zarr whose chunks need no more than a codec to be read."""

CODECS = ("", "blosc", "gzip", "lz4", "zlib", "zstd")
"""Codecs that need no settings to decompress."""

_GROUP_FILES = (".zmetadata", ".zgroup", ".zattrs", "zarr.json")
_ARRAY_FILES = (".zarray", ".zattrs", "zarr.json")

LARGEST = 1 << 42  # bytes of a file


def is_zarr(path: Path) -> bool:
    """Tell whether a path is the folder of a Zarr store."""
    try:
        return path.is_dir() and any((path / name).is_file() for name in _GROUP_FILES)
    except (OSError, ValueError):  # a name that is too long
        return False


def is_stored(path: Path) -> bool:
    """Tell whether a path is read here: by its suffix, or as a Zarr store."""
    return path.suffix.lower() in SUFFIXES or is_zarr(path)


def require_packages(path: Path, engine: str) -> None:
    """Raise MachineError without the packages that read a file."""
    needed = {"h5netcdf": ("h5netcdf", "h5py"), "zarr": ("zarr",), "scipy": ("scipy",)}[engine]
    missing = [name for name in ("xarray", *needed) if find_spec(name) is None]
    if missing:
        raise MachineError(
            f"{path}: reading it needs the package{'s' if len(missing) > 1 else ''} {' and '.join(missing)}; "
            "install the extra: pip install 'flowsculpt[fields]'"
        )


def engine_of(path: Path) -> str:
    """Return the engine of xarray for a file, by its first bytes. Raises UsageError for other contents."""
    if path.is_dir():
        if not is_zarr(path):
            fact = "the folder has no zarr.json, .zgroup or .zmetadata, so it is not a Zarr store"
            raise UsageError(f"{path}: {fact}. Name a store.")
        return "zarr"
    with InputFile(path, LARGEST).open() as (file, _):
        head = file.read(8)
    if head[:4] in (b"CDF\x01", b"CDF\x02"):
        return "scipy"
    if head == b"\x89HDF\r\n\x1a\n":
        return "h5netcdf"
    if head.startswith(b"PK"):
        raise UsageError(f"{path}: it is a ZIP archive. Unzip it, and name the Zarr store in it.")
    fact = "it is NetCDF of the kind CDF-5" if head[:4] == b"CDF\x05" else "it is neither NetCDF nor HDF5"
    raise UsageError(
        f"{path}: {fact}; NetCDF 3 and 4, HDF5 and Zarr are read. Convert it: nccopy -k nc4 IN OUT."
    )


@contextmanager
def opened(path: Path, group: str | None = None) -> Iterator[Any]:
    """Yield the xarray.Dataset of a file, not decoded; arrays are read when they are indexed.

    Raises MachineError without the packages, and UsageError where it cannot be read.
    """
    with warnings.catch_warnings(), reported(path):
        warnings.simplefilter("ignore")
        with open_dataset(path, group) as dataset:
            yield dataset


def open_dataset(path: Path, group: str | None) -> Any:
    """Return what `opened` yields, to be closed; that of a Zarr store holds nothing open."""
    engine = engine_of(path)
    require_packages(path, engine)
    import xarray

    more: dict[str, Any] = {} if engine == "scipy" or group is None else {"group": group}
    if engine == "scipy" and group is not None:
        raise UsageError(f"{path}: NetCDF 3 has no groups. Leave out group.")
    if engine == "h5netcdf":
        more["phony_dims"] = "access"
    if engine == "zarr":  # each array's own metadata, as chunks are read by: copies of it may be stale
        more["consolidated"] = False
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            return xarray.open_dataset(str(path), engine=engine, decode_cf=False, cache=False, **more)
        except Exception as error:  # libraries raise what they like where a group is not there
            if group is None or group.strip("/") in (known := groups_of(path)):
                raise
            remedy = suggest(group, known, cutoff=1.0) if known else "Leave out group."
            raise UsageError(f"{path}: it has no group {shorten(group)}. {remedy}") from error


@dataclass(frozen=True)
class JoinedVariables:
    """The variables of several files with the same axes, by name."""

    variables: dict[str, Any]


@contextmanager
def opened_together(paths: tuple[Path, ...], group: str | None = None) -> Iterator[Any]:
    """Yield the variables of files, of one name those of the first file. Raises what `opened` raises.

    Raises UsageError too where axes of the same name differ.
    """
    with ExitStack() as stack:
        datasets = [stack.enter_context(opened(path, group)) for path in paths]
        if len(datasets) == 1:
            yield datasets[0]
            return
        joined: dict[str, Any] = {}
        for path, dataset in zip(paths, datasets, strict=True):
            for name, variable in dataset.variables.items():
                known = joined.setdefault(str(name), variable)
                is_axis = known is not variable and known.dims == (name,)
                if is_axis and (known.attrs.get("units"), *known.values) != (
                    variable.attrs.get("units"),
                    *variable.values,
                ):
                    fact = f"its axis {name} differs from that of {paths[0].name}"
                    raise UsageError(f"{path}: {fact}; components are at the same places and times")
        yield JoinedVariables(joined)


@contextmanager
def reported(path: Path) -> Iterator[None]:
    """Turn errors of xarray and the libraries below it into UsageErrors."""
    try:
        yield
    except FlowsculptError:
        raise
    except (MemoryError, RecursionError):
        raise
    except Exception as error:  # parsers raise anything
        reason = shorten(str(error).splitlines()[0] if str(error) else type(error).__name__)
        raise UsageError(f"{path}: it cannot be read ({reason}). Write or copy it again.") from error


def groups_of(path: Path) -> list[str]:
    """Return the names of the groups within HDF5 or a Zarr store that have variables; none for others."""
    if path.is_dir():
        require_packages(path, "zarr")
        import zarr

        with reported(path):
            items = zarr.open_group(path, mode="r").members(max_depth=4)
            holders = {name.rpartition("/")[0] for name, item in items if isinstance(item, zarr.Array)}
            return sorted(holders - {""})
    if engine_of(path) != "h5netcdf":
        return []
    require_packages(path, "h5netcdf")
    import h5py

    found: list[str] = []
    with reported(path), h5py.File(path, "r") as file:
        file.visititems(
            lambda name, item: (
                found.append(name)
                if isinstance(item, h5py.Group)
                and any(isinstance(part, h5py.Dataset) for part in item.values())
                else None
            )
        )
    return found


def stored_files(
    path: Path, group: str | None, at: dict[str, dict[int, int]], lacking: tuple[str, ...] = ()
) -> SourceFiles:
    """Return the files of a Zarr store that hold variables at some indices, and their digests.

    at       of each variable the index by its dimension's place; of other dimensions all
    lacking  variables of which no chunk is wanted

    A chunk that is not there, since all of it is the fill value, has an empty digest.
    """
    home = path / (group or "")
    found: dict[Path, str] = {}
    for folder in dict.fromkeys((path, home)):
        found |= {
            folder / name: file_digest(folder / name) for name in _GROUP_FILES if (folder / name).is_file()
        }
    for name in at:
        found |= {
            home / name / each: file_digest(home / name / each)
            for each in _ARRAY_FILES
            if (home / name / each).is_file()
        }
        for chunk in () if name in lacking else _chunks(home / name, at[name]):
            found[chunk] = file_digest(chunk) if chunk.is_file() else ""
    return tuple(found.items())


def position_in_chunk(path: Path, group: str | None, name: str, dimension: int, index: int) -> int:
    """Return where an index of a dimension is in its chunk; in one file, the index itself."""
    if not path.is_dir():
        return index
    return index % ChunkGrid.of(path / (group or "") / name).sizes[dimension]


def _chunks(folder: Path, at: dict[int, int]) -> Iterator[Path]:
    """Yield the paths of the chunks of an array that hold an index of some dimensions."""
    grid = ChunkGrid.of(folder)
    counts = [-(-length // size) for length, size in zip(grid.shape, grid.sizes, strict=True)]
    ranges = [
        range(at[k] // grid.sizes[k], at[k] // grid.sizes[k] + 1) if k in at else range(count)
        for k, count in enumerate(counts)
    ]
    return map(grid.path, product(*ranges))


@dataclass(frozen=True)
class ChunkGrid:
    """The chunks of an array of a Zarr store that are files.

    shape   of the array
    sizes   of a chunk
    prefix  of the names of files, whose numbers are between separators
    dtype   of its numbers; None where only zarr reads them
    codec   that compresses files, by its name in numcodecs; empty for none
    fill    value of chunks that are not there; None where only zarr knows it
    """

    folder: Path
    shape: tuple[int, ...]
    sizes: tuple[int, ...]
    prefix: tuple[str, ...]
    separator: str
    dtype: str | None
    codec: str
    fill: float | None

    def path(self, numbers: Iterable[int]) -> Path:
        """Return the file of the chunk with some numbers, one for each dimension."""
        return self.folder / (self.separator.join([*self.prefix, *map(str, numbers)]) or "0")

    def file(self, at: Sequence[int | slice]) -> Path:
        """Return the file of the chunk that has some indices of each dimension."""
        firsts = (part.start if isinstance(part, slice) else part for part in at)
        return self.path(first // size for first, size in zip(firsts, self.sizes, strict=True))

    def values(self, at: Sequence[int | slice]) -> np.ndarray | None:
        """Return the values at indices in one chunk; None where only zarr reads it. Raises UsageError.

        zarr takes up to seven times as long for 500 kB, most of it to pass them between threads.
        """
        path = self.file(at)
        is_there = path.is_file()
        if self.dtype is None or not (is_there or self.fill is not None):
            return None
        with reported(path):
            if not is_there:
                values = np.full(self.sizes, self.fill, self.dtype)
            elif self.codec:
                from numcodecs import get_codec

                content = get_codec({"id": self.codec}).decode(path.read_bytes())
                values = np.frombuffer(content, self.dtype).reshape(self.sizes)
            else:
                values = np.fromfile(path, self.dtype).reshape(self.sizes)
        inside = [
            slice(part.start % size, part.start % size + part.stop - part.start)
            if isinstance(part, slice)
            else part % size
            for part, size in zip(at, self.sizes, strict=True)
        ]
        return values[tuple(inside)]

    @classmethod
    def of(cls, folder: Path) -> ChunkGrid:
        """Return that of the array in a folder. Raises MissingInputError where nothing says it."""
        try:
            if (folder / "zarr.json").is_file():
                about = json.loads((folder / "zarr.json").read_text("utf-8"))
                keys, (first, *codecs) = about.get("chunk_key_encoding", {"name": "default"}), about["codecs"]
                is_default, is_plain = keys["name"] == "default", first["name"] == "bytes"
                separator = keys.get("configuration", {}).get("separator", "/" if is_default else ".")
                sizes, dtype = about["chunk_grid"]["configuration"]["chunk_shape"], about["data_type"]
                order = ">" if first.get("configuration", {}).get("endian") == "big" else "<"
                codec = " ".join(each["name"] for each in codecs)
            else:
                about = json.loads((folder / ".zarray").read_text("utf-8"))
                is_default, separator = False, about.get("dimension_separator", ".")
                sizes, dtype, order = about["chunks"], about["dtype"], "|"  # as it says
                is_plain = about.get("order", "C") == "C" and not about.get("filters")
                codec = (about.get("compressor") or {"id": ""})["id"]
            is_plain &= isinstance(dtype, str) and NUMBERS.fullmatch(dtype) is not None and codec in CODECS
            read_as = np.dtype(dtype).newbyteorder(order).str if is_plain else None
            shape, sizes, prefix = tuple(about["shape"]), tuple(sizes), ("c",) * is_default
            fill = about.get("fill_value")
            if not isinstance(fill, int | float):
                fill = float(fill) if fill in ("NaN", "Infinity", "-Infinity") else None
            return cls(folder, shape, sizes, prefix, separator, read_as, codec, fill)
        except (OSError, ValueError, KeyError, TypeError) as error:
            reason = f"its .zarray or zarr.json cannot be read ({shorten(str(error))})"
            raise MissingInputError(f"{folder}: {reason}. Copy the store again.") from None
