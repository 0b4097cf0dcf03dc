"""Read arrays of numpy's archives, .npz (numpy.lib.format), that come from outside.

The headers of members are compared with the bytes that are there before anything is unpacked, and only the
arrays that are asked for are.
"""

from __future__ import annotations

import io
import math
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.arrays import AnyArray

_HEADER = 1 << 14
"""Bytes that are enough for the header of any array of numbers."""

_MOST_DEFLATED = 1100
"""Bytes that one byte unpacks to at most: 1032, and some for the beginning (RFC 1951)."""

_HEADERS: dict[tuple[int, int], Callable[[Any], Any]] = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}


@dataclass(frozen=True)
class ArrayHeader:
    """The shape and type of an array in an archive. `size` is its number of bytes once unpacked."""

    shape: tuple[int, ...]
    dtype: np.dtype[Any]

    @property
    def size(self) -> int:
        return math.prod(self.shape) * self.dtype.itemsize


class Archive:
    """Arrays of numbers in the content of an .npz file, which are unpacked one by one.

    Raises ValueError, and whatever zipfile raises, for what is no such file.
    """

    def __init__(self, content: bytes) -> None:
        self._zip = zipfile.ZipFile(io.BytesIO(content))
        self._unpacked, self._present = 0, len(content)
        names = [name for name in self._zip.namelist() if name.endswith(".npy")]
        self.names = tuple(name.removesuffix(".npy") for name in dict.fromkeys(names))

    def header(self, name: str) -> ArrayHeader:
        """Return the header of an array, as its file has it. Raises ValueError where there is none."""
        with self._zip.open(f"{name}.npy") as packed:
            head = io.BytesIO(packed.read(_HEADER))
        version = np.lib.format.read_magic(head)
        if version not in _HEADERS:
            raise ValueError(f"array {name[:40]} has a header of version {version[0]}, which is not read")
        shape, _, dtype = _HEADERS[version](head)
        return ArrayHeader(tuple(shape), dtype)

    def array(self, name: str) -> AnyArray:
        """Return an array.

        Raises ValueError where its header promises more than is there, and whatever zipfile and numpy raise.
        """
        header, member = self.header(name), self._zip.getinfo(f"{name}.npy")
        if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise ValueError(f"array {name[:40]} has an unknown compression method")
        factor = _MOST_DEFLATED if member.compress_type == zipfile.ZIP_DEFLATED else 1
        present = min(factor * min(member.compress_size, self._present), member.file_size)
        is_short = min(header.shape, default=0) < 0 or header.size > present
        if not header.dtype.hasobject and (is_short or not header.dtype.itemsize):
            raise ValueError(f"array {name[:40]} has the shape {header.shape} by its header, and ends before")
        self._unpacked += header.size
        if self._unpacked > _MOST_DEFLATED * self._present:  # members may share bytes
            raise ValueError("its arrays overlap")
        with self._zip.open(member) as packed:
            values: AnyArray = np.lib.format.read_array(packed, allow_pickle=False)
        return values
