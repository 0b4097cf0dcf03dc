"""Arrays of Zarr stores as files: which chunks hold an index, and the numbers in them.

The library zarr takes up to a millisecond for each chunk, more than reading it takes. Chunks in the usual
forms are read here without it: not compressed, or by one compressor.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from math import prod
from pathlib import Path
from typing import Any

import numpy as np

from flowsculpt import MissingInputError
from flowsculpt.api import shorten
from flowsculpt.api.files import InputFile

LARGEST = 1 << 42  # bytes of a file

COMPRESSORS = ("blosc", "zstd", "gzip", "zlib", "lz4")
"""Those whose data say themselves how they are decompressed."""


@dataclass(frozen=True)
class StoredNumbers:
    """How the numbers of a chunk are stored.

    dtype       of the bytes
    compressor  the name of one; None where there is none
    fill        the number of chunks that are not there
    """

    dtype: np.dtype
    compressor: str | None
    fill: float

    @classmethod
    def of(cls, about: Mapping[str, Any]) -> StoredNumbers | None:
        """Return those of an array by its metadata; None for forms that are not read here."""
        try:
            dtype, fill = np.dtype(about.get("data_type", about.get("dtype"))), about["fill_value"]
            if "data_type" in about:  # version 3
                first, *others = about["codecs"]
                is_plain = first["name"] == "bytes" and not about.get("storage_transformers")
                names = [codec["name"] for codec in others]
                if dtype.itemsize > 1:
                    dtype = dtype.newbyteorder({"little": "<", "big": ">"}[first["configuration"]["endian"]])
            else:
                is_plain = not about["filters"] and about["order"] == "C"
                names = [] if about["compressor"] is None else [about["compressor"]["id"]]
            known = cls(dtype, names[0] if names else None, fill if isinstance(fill, int) else float(fill))
        except (ValueError, KeyError, TypeError):
            return None
        is_known = known.compressor in (None, *COMPRESSORS) and len(names) < 2 and dtype.kind in "fiu"
        return known if is_plain and is_known else None

    def numbers(self, path: Path, shape: Sequence[int]) -> np.ndarray:
        """Return the numbers of a chunk. Raises MissingInputError, and what decompressors raise."""
        content: Any = InputFile(path, LARGEST).content()
        if self.compressor is not None:
            from numcodecs import get_codec

            content = get_codec({"id": self.compressor}).decode(content)
        numbers = np.frombuffer(content, self.dtype)
        if numbers.size != prod(shape):
            raise ValueError(f"chunk {path.name} has {numbers.size} numbers instead of {prod(shape)}")
        return numbers.reshape(shape)


@dataclass(frozen=True)
class ZarrArray:
    """An array of a store.

    folder     of its files
    shape      length along each dimension
    sizes      of its chunks, or of its shards, along each dimension
    prefix     of the names of chunks
    separator  of the numbers in them
    stored     how numbers are stored; None where zarr must read them
    """

    folder: Path
    shape: tuple[int, ...]
    sizes: tuple[int, ...]
    prefix: tuple[str, ...]
    separator: str
    stored: StoredNumbers | None

    @classmethod
    def of(cls, folder: Path) -> ZarrArray:
        """Return the array of a folder. Raises MissingInputError where its metadata cannot be read."""
        is_new = (folder / "zarr.json").is_file()
        try:
            about = json.loads((folder / ("zarr.json" if is_new else ".zarray")).read_text("utf-8"))
            shape, sizes, keys = about["shape"], about.get("chunks"), about.get("chunk_key_encoding", {})
            if is_new:
                sizes = about["chunk_grid"]["configuration"]["chunk_shape"]
            is_default = is_new and keys.get("name", "default") == "default"
            separator = about.get("dimension_separator", "/" if is_default else ".")
            separator = keys.get("configuration", {}).get("separator", separator)
            prefix = ("c",) if is_default else ()
            return cls(folder, tuple(shape), tuple(sizes), prefix, separator, StoredNumbers.of(about))
        except (OSError, ValueError, KeyError, TypeError) as error:
            reason = f"its .zarray or zarr.json cannot be read ({shorten(str(error))})"
            raise MissingInputError(f"{folder}: {reason}. Copy the store again.") from None

    def chunks(self, ranges: Sequence[range]) -> Iterator[tuple[tuple[int, ...], Path]]:
        """Yield the numbers and the paths of the chunks that hold ranges of indices."""
        spans = (
            range(wanted.start // size, -(-wanted.stop // size))
            for wanted, size in zip(ranges, self.sizes, strict=True)
        )
        for numbers in product(*spans):
            parts = [*self.prefix, *map(str, numbers)]
            yield numbers, self.folder / (self.separator.join(parts) or "0")

    def paths(self, at: Mapping[int, int]) -> Iterator[Path]:
        """Yield the paths of the chunks that hold indices by their dimension's place; of others all."""
        ranges = [
            range(at.get(k, 0), at[k] + 1 if k in at else length) for k, length in enumerate(self.shape)
        ]
        return (path for _, path in self.chunks(ranges))

    def read(self, ranges: Sequence[range]) -> np.ndarray:
        """Return the numbers at ranges of indices. Raises what `StoredNumbers.numbers` raises."""
        assert self.stored is not None, "zarr reads the others"
        dtype = self.stored.dtype.newbyteorder("=")
        out = np.empty([len(wanted) for wanted in ranges], dtype)
        for numbers, path in self.chunks(ranges):
            begins = [number * size for number, size in zip(numbers, self.sizes, strict=True)]
            parts = [
                range(max(begin, wanted.start), min(begin + size, wanted.stop))
                for begin, size, wanted in zip(begins, self.sizes, ranges, strict=True)
            ]
            to = tuple(_slice(part, wanted.start) for part, wanted in zip(parts, ranges, strict=True))
            if not path.is_file():
                out[to] = self.stored.fill
                continue
            inside = tuple(_slice(part, begin) for part, begin in zip(parts, begins, strict=True))
            out[to] = self.stored.numbers(path, self.sizes)[inside]
        return out


def _slice(part: range, begin: int) -> slice:
    return slice(part.start - begin, part.stop - begin)
