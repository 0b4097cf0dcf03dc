"""Sizes that headers of sound files announce: of whole files, of files cut off, and of those from a pipe.

A program that writes to a pipe cannot return to the header. It announces 0 or a size beyond any file's, which
FFmpeg takes at its word in some formats; and FFmpeg reads a file that was cut off as a shorter one.
"""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO, Literal, NamedTuple

Order = Literal["little", "big"]


class _Layout(NamedTuple):
    """Chunks of a container: the first one's place, the bytes of a name and of a size, and their order.

    align    chunks begin at multiples of so many bytes
    samples  the name of the chunk of samples begins with it
    empty    the size of that chunk without samples
    total    place of the size of all chunks, and what it counts from; 0 if there is none
    """

    first: int
    name: int
    size: int
    order: Order
    align: int
    samples: bytes
    empty: int
    total: tuple[int, int]


_RIFF = _Layout(12, 4, 4, "little", 2, b"data", 0, (4, 8))
_LAYOUTS = {
    b"RIFF": _RIFF,
    b"RF64": _RIFF,
    b"BW64": _RIFF,
    b"RIFX": _RIFF._replace(order="big"),
    b"FORM": _RIFF._replace(order="big", samples=b"SSND", empty=8),
    b"riff": _Layout(40, 16, 8, "little", 8, b"data", 24, (16, 0)),  # Wave64: sizes with their headers
    b"caff": _Layout(8, 4, 8, "big", 1, b"data", 0, (0, 0)),
}

_UNKNOWN = (1 << 31, 1 << 32, 0x7F000000)
"""Programs announce these, less or more a header, where they do not know the size (SoX: the last)."""

_LONGEST_HEADER, _MOST_CHUNKS = 1 << 16, 1000


class _Size(NamedTuple):
    """A size as it stands in a header, the place that it counts from, and the size if there is nothing."""

    place: int
    width: int
    order: Order
    begin: int
    value: int
    empty: int = 0

    @property
    def is_unknown(self) -> bool:
        placeholder = any(abs(self.value - size) < _LONGEST_HEADER for size in _UNKNOWN)
        return self.value <= self.empty or self.value >= 1 << 62 or placeholder

    @property
    def end(self) -> int:
        return self.begin + self.value


def corrected_sizes(file: Path) -> dict[int, bytes]:
    """Return the bytes to read at places of a file, so that sizes which its program did not know are right.

    Raises ValueError for a file that ends before its header says, or has no samples by all it says.
    """
    size = file.stat().st_size
    with file.open("rb") as opened:
        total, samples = _sizes(opened)
        opened.seek(0)
        head = opened.read(16)
    sizes = [each for each in (total, samples) if each is not None]
    known = [each for each in sizes if not each.is_unknown]
    if known and known[0].end > size + 1:
        raise ValueError(f"it is cut off: it has {size} bytes of {known[0].end}")
    if samples is None or samples in known or samples.empty < samples.value <= size - samples.begin:
        return {}
    if total in known and known[0].end >= size - 1:
        raise ValueError("it holds none")
    count = {22: bytes(4)} if head[:4] == b"FORM" and head[12:] == b"COMM" else {}  # of frames; 0 is unknown
    return {each.place: (size - each.begin).to_bytes(each.width, each.order) for each in sizes} | count


def _sizes(file: BinaryIO) -> tuple[_Size | None, _Size | None]:
    """Return the sizes of all chunks and of the samples; None where a file has no such size."""

    def size_at(place: int, width: int, order: Order, begin: int, empty: int = 0) -> _Size:
        file.seek(place)
        return _Size(place, width, order, begin, int.from_bytes(file.read(width), order), empty)

    head = file.read(16)
    if head[:4] == b".snd":  # AU: the place of the samples, and their size
        return None, size_at(8, 4, "big", int.from_bytes(head[4:8], "big"))
    layout = _LAYOUTS.get(head[:4])
    if layout is None:
        return None, None
    place, name, width, order, align, samples, empty, (at, begin) = layout
    is_long = head[:2] != b"RI" and head[12:] == b"ds64"  # RF64, BW64: sizes stand in the first chunk
    total = size_at(20, 8, order, 8) if is_long else size_at(at, width, order, begin) if at else None
    for _ in range(_MOST_CHUNKS):
        found = size_at(place + name, width, order, place if name == 16 else place + name + width, empty)
        file.seek(place)
        if file.read(len(samples)) == samples:
            return total, size_at(28, 8, order, found.begin) if is_long else found
        place = max(place + name + width, -(-found.end // align) * align)
        if place >= 1 << 62:
            break
    return total, None


class WithCorrectedSizes:
    """A file to read, with other bytes at some places: as much of a file as PyAV asks for."""

    def __init__(self, file: BinaryIO, corrected: dict[int, bytes]) -> None:
        self._file, self._corrected = file, corrected
        self.seek, self.tell = file.seek, file.tell

    def read(self, count: int) -> bytes:
        """Return the next bytes, at most `count`."""
        begin = self._file.tell()
        block = bytearray(self._file.read(count))
        for place, content in self._corrected.items():
            for at, byte in enumerate(content, place - begin):
                if 0 <= at < len(block):
                    block[at] = byte
        return bytes(block)
