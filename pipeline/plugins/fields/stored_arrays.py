"""Arrays of NetCDF, HDF5 and Zarr, opened by xarray with nothing decoded, and the files that hold them."""

from __future__ import annotations

import json
import warnings
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from itertools import product
from pathlib import Path
from typing import Any

from flowsculpt import FlowsculptError, MachineError, MissingInputError, UsageError
from flowsculpt.api import shorten
from flowsculpt.api.files import InputFile
from flowsculpt.pipeline.plugins.fields.windowed_samples import SourceFiles, file_digest

NETCDF = (".nc", ".nc4", ".cdf", ".netcdf", ".h5", ".hdf5", ".he5")
SUFFIXES = (*NETCDF, ".zarr")

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
    fact = "it is NetCDF of the kind CDF-5" if head[:4] == b"CDF\x05" else "it is neither NetCDF nor HDF5"
    raise UsageError(
        f"{path}: {fact}; NetCDF 3 and 4, HDF5 and Zarr are read. Convert it: nccopy -k nc4 IN OUT."
    )


@contextmanager
def opened(path: Path, group: str | None = None) -> Iterator[Any]:
    """Yield the xarray.Dataset of a file, not decoded; arrays are read when they are indexed.

    Raises MachineError without the packages, and UsageError where it cannot be read.
    """
    engine = engine_of(path)
    require_packages(path, engine)
    with warnings.catch_warnings(), _reported(path):
        warnings.simplefilter("ignore")
        import xarray

        more: dict[str, Any] = {} if engine == "scipy" or group is None else {"group": group}
        if engine == "scipy" and group is not None:
            raise UsageError(f"{path}: NetCDF 3 has no groups. Leave out group.")
        if engine == "h5netcdf":
            more["phony_dims"] = "access"
        with xarray.open_dataset(str(path), engine=engine, decode_cf=False, cache=False, **more) as dataset:
            yield dataset


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
def _reported(path: Path) -> Iterator[None]:
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

        with _reported(path):
            items = zarr.open_group(path, mode="r").members(max_depth=4)
            holders = {name.rpartition("/")[0] for name, item in items if isinstance(item, zarr.Array)}
            return sorted(holders - {""})
    if engine_of(path) != "h5netcdf":
        return []
    require_packages(path, "h5netcdf")
    import h5py

    found: list[str] = []
    with _reported(path), h5py.File(path, "r") as file:
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
    path: Path, group: str | None, names: tuple[str, ...], at: dict[str, dict[int, int]]
) -> SourceFiles:
    """Return the files of a Zarr store that hold variables at some indices, and their digests.

    at  of each variable the index by its dimension's place; of other dimensions all

    A chunk that is not there, since all of it is the fill value, has an empty digest.
    """
    home = path / (group or "")
    found: dict[Path, str] = {}
    for folder in dict.fromkeys((path, home)):
        found |= {
            folder / name: file_digest(folder / name) for name in _GROUP_FILES if (folder / name).is_file()
        }
    for name in names:
        found |= {
            home / name / each: file_digest(home / name / each)
            for each in _ARRAY_FILES
            if (home / name / each).is_file()
        }
        for chunk in _chunks(home / name, at[name]):
            found[chunk] = file_digest(chunk) if chunk.is_file() else ""
    return tuple(found.items())


def position_in_chunk(path: Path, group: str | None, name: str, dimension: int, index: int) -> int:
    """Return where an index of a dimension is in its chunk; in one file, the index itself."""
    if not path.is_dir():
        return index
    _, sizes, _, _ = _chunk_grid(path / (group or "") / name)
    return index % sizes[dimension]


def _chunks(folder: Path, at: dict[int, int]) -> Iterator[Path]:
    """Yield the paths of the chunks of an array that hold an index of some dimensions."""
    shape, sizes, prefix, separator = _chunk_grid(folder)
    counts = [-(-length // size) for length, size in zip(shape, sizes, strict=True)]
    ranges = [
        range(at[k] // sizes[k], at[k] // sizes[k] + 1) if k in at else range(count)
        for k, count in enumerate(counts)
    ]
    for numbers in product(*ranges):
        parts = [*prefix, *map(str, numbers)]
        yield folder / (separator.join(parts) or "0")


def _chunk_grid(folder: Path) -> tuple[list[int], list[int], list[str], str]:
    """Return the shape, the size of chunks in files, the prefix of their names, and the separator."""
    try:
        if (folder / "zarr.json").is_file():
            about = json.loads((folder / "zarr.json").read_text("utf-8"))
            keys = about.get("chunk_key_encoding", {"name": "default"})
            separator = keys.get("configuration", {}).get(
                "separator", "/" if keys["name"] == "default" else "."
            )
            sizes = about["chunk_grid"]["configuration"]["chunk_shape"]
            return list(about["shape"]), list(sizes), ["c"] if keys["name"] == "default" else [], separator
        about = json.loads((folder / ".zarray").read_text("utf-8"))
        return list(about["shape"]), list(about["chunks"]), [], about.get("dimension_separator", ".")
    except (OSError, ValueError, KeyError, TypeError) as error:
        reason = f"its .zarray or zarr.json cannot be read ({shorten(str(error))})"
        raise MissingInputError(f"{folder}: {reason}. Copy the store again.") from None
