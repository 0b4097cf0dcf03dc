"""Contents of files that come from outside: text in any encoding, and numpy's archives."""

from __future__ import annotations

import codecs
import io
import math
import re
import zipfile
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from flowsculpt.render.base.render_errors import quote

if TYPE_CHECKING:  # planning reads text, and does without numpy
    import numpy as np

    AnyArray = np.ndarray[Any, np.dtype[Any]]

_MARKS = (
    (codecs.BOM_UTF32_LE, "utf-32-le"),  # begins as UTF-16 does
    (codecs.BOM_UTF32_BE, "utf-32-be"),
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)
_UNMARKED = {
    b"\1\0\0\0": "utf-32-le",
    b"\0\0\0\1": "utf-32-be",
    b"\1\0\1\0": "utf-16-le",
    b"\0\1\0\1": "utf-16-be",
}
"""Encodings by which of the first four bytes are zero, in text that begins with ASCII characters."""

_DECIMAL_COMMA = re.compile(rb"[-+]?\d*,\d+(?:[eE][-+]?\d+)?")


def as_utf8(content: bytes) -> bytes:
    """Return text as UTF-8 without a byte order mark.

    UTF-16 and UTF-32 are known by their marks, or by the zeros among the first four bytes; other content is
    returned as it is. Raises ValueError for text that is damaged.
    """
    mark, encoding = next((known for known in _MARKS if content.startswith(known[0])), (b"", ""))
    if not encoding:
        zeros = bytes(min(byte, 1) for byte in content[:4])
        encoding = _UNMARKED.get(zeros, "utf-8")
    if encoding == "utf-8":
        return content[len(mark) :] if mark else content
    try:
        return content[len(mark) :].decode(encoding).encode()
    except UnicodeDecodeError as error:
        name = encoding[:6].upper()
        raise ValueError(
            f"it begins as {name} text, and byte {error.start + len(mark)} is not: {error.reason}"
        ) from None


def text_content(content: bytes) -> bytes:
    r"""Return text of any encoding of Unicode as UTF-8, with lines that end in ``\n``, whatever ended them.

    No-break spaces become spaces. Raises ValueError as `as_utf8`, and for NUL bytes, which no text holds.
    """
    content = as_utf8(content).rstrip(b"\x1a")  # the end of a file of DOS
    if (at := content.find(b"\0")) >= 0:
        line = content.count(b"\n", 0, at) + 1
        raise ValueError(f"line {line}: byte {at} is NUL, so the file is not text, or was not written whole")
    if b"\r" in content:
        content = content.replace(b"\r\n", b"\n").replace(b"\n\r", b"\n").replace(b"\r", b"\n")
    return content.replace(b"\xc2\xa0", b" ") if b"\xc2\xa0" in content else content


def number_fault(words: Iterable[bytes], parse: Callable[[bytes], object] = float) -> str:
    """Return what is wrong with the first word that `parse` refuses; empty if there is none."""
    for word in words:
        try:
            parse(word)
        except ValueError:
            shown = word.decode("utf-8", "replace")[:40]
            if _DECIMAL_COMMA.fullmatch(word):
                return f"{shown} is not a number; decimals have a point, as in {shown.replace(',', '.')}"
            return f"{shown} is not {'an integer' if parse is int else 'a number'}"
    return ""


_HEADER = 1 << 14
"""Bytes that are enough for the header of any array of numbers."""

_MOST_DEFLATED = 1100
"""Bytes that one byte unpacks to at most: 1032, and some for the beginning (RFC 1951)."""


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

    Raises ValueError, or an error of zipfile, for any other file.
    """

    def __init__(self, content: bytes) -> None:
        self._zip = zipfile.ZipFile(io.BytesIO(content))
        self._unpacked, self._present = 0, len(content)
        names = [name for name in self._zip.namelist() if name.endswith(".npy")]
        self.names = tuple(name.removesuffix(".npy") for name in dict.fromkeys(names))

    def header(self, name: str) -> ArrayHeader:
        """Return the header of an array, as its file has it. Raises ValueError where there is none."""
        from numpy.lib import format as npy

        readers = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
        with self._zip.open(f"{name}.npy") as packed:
            head = io.BytesIO(packed.read(_HEADER))
        version = npy.read_magic(head)
        if version not in readers:
            raise ValueError(f"array {quote(name)} has an unknown header version {version[0]}")
        shape, _, dtype = readers[version](head)
        return ArrayHeader(tuple(shape), dtype)

    def array(self, name: str) -> AnyArray:
        """Return an array.

        Raises ValueError where its header promises more than is there, and whatever zipfile and numpy raise.
        """
        from numpy.lib.format import read_array

        header, member = self.header(name), self._zip.getinfo(f"{name}.npy")
        if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise ValueError(f"array {quote(name)} has an unknown compression method")
        factor = _MOST_DEFLATED if member.compress_type == zipfile.ZIP_DEFLATED else 1
        present = min(factor * min(member.compress_size, self._present), member.file_size)
        is_short = min(header.shape, default=0) < 0 or header.size > present
        if not header.dtype.hasobject and (is_short or not header.dtype.itemsize):
            shape = f"has the shape {header.shape} by its header, and ends before"
            raise ValueError(f"array {quote(name)} {shape}")
        self._unpacked += header.size
        if self._unpacked > _MOST_DEFLATED * self._present:  # members may share bytes
            raise ValueError("its arrays overlap")
        with self._zip.open(member) as packed:
            values: AnyArray = read_array(packed, allow_pickle=False)
        return values
