"""Sizes that headers of sound files announce: of whole files, of files cut off, and of those from a pipe.

A program that writes to a pipe cannot return to the header. It announces 0 or a size beyond any file's, which
FFmpeg takes at its word in some formats; and FFmpeg reads a file that was cut off as a shorter one.
"""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO, Literal, NamedTuple

_LAYOUTS: dict[bytes, tuple[int, int, int, Literal["little", "big"], int, bytes, int]] = {
    b"RIFF": (12, 4, 4, "little", 2, b"data", 0),
    b"RIFX": (12, 4, 4, "big", 2, b"data", 0),
    b"RF64": (12, 4, 4, "little", 2, b"data", 0),
    b"BW64": (12, 4, 4, "little", 2, b"data", 0),
    b"FORM": (12, 4, 4, "big", 2, b"SSND", 8),
    b"riff": (40, 16, 8, "little", 8, b"data", 24),  # Wave64, where sizes count their chunk's header
    b"caff": (8, 4, 8, "big", 1, b"data", 0),
}
"""By the first bytes of a file: the place of its first chunk, the bytes of a chunk's name and size, their
order, what chunks are aligned to, how the name of the samples begins, and their size if there are none."""

_UNKNOWN = (1 << 31, 1 << 32, 0x7F000000)
"""Programs announce these, less or more a header, where they do not know the size (SoX: the last)."""

_LONGEST_HEADER, _MOST_CHUNKS = 1 << 16, 1000


class _Size(NamedTuple):
    """A size as it stands in a header, the place that it counts from, and the size if there is nothing."""

    place: int
    width: int
    order: Literal["little", "big"]
    begin: int
    value: int
    empty: int

    @property
    def is_known(self) -> bool:
        is_placeholder = any(abs(self.value - size) < _LONGEST_HEADER for size in _UNKNOWN)
        return self.empty < self.value < 1 << 62 and not is_placeholder

    @property
    def end(self) -> int:
        return self.begin + self.value


def corrected_sizes(file: Path) -> dict[int, bytes]:
    """Return the bytes to read at places of a file, so that sizes which its program did not know are right.

    Raises ValueError for a file that ends before its header says, or has no samples by all it says.
    """
    size = file.stat().st_size
    with file.open("rb") as opened:
        total, samples = _sizes(opened, opened.read(24))
    sizes = [each for each in (total, samples) if each is not None]
    known = [each for each in sizes if each.is_known]
    end = min((each.end for each in known), default=0)  # programs count one of them wrong, or lose remarks
    if end > size + 1:
        raise ValueError(f"it is cut off: it has {size} bytes of {end}")
    if samples is None or samples in known or samples.empty < samples.value <= size - samples.begin:
        return {}
    if total in known and known[0].end >= size - 1:
        raise ValueError("it holds none")
    return {each.place: max(0, size - each.begin).to_bytes(each.width, each.order) for each in sizes}


def _sizes(file: BinaryIO, head: bytes) -> tuple[_Size | None, _Size | None]:
    """Return the sizes of all chunks and of the samples; None where a file has no such size."""

    def size_at(place: int, width: int, begin: int, empty: int = 0) -> _Size:
        file.seek(place)
        return _Size(place, width, order, begin, int.from_bytes(file.read(width), order), empty)

    order: Literal["little", "big"] = "big"
    if head[:4] == b".snd":  # AU: the place of the samples, and their size
        return None, size_at(8, 4, int.from_bytes(head[4:8], "big"))
    if head[:4] not in _LAYOUTS:
        return None, None
    place, name, width, order, align, samples, empty = _LAYOUTS[head[:4]]
    is_long = head[2:4] == b"64" and head[12:16] == b"ds64"  # sizes stand in the first chunk
    total = size_at(20, 8, 8) if is_long else size_at(name, width, 0 if name == 16 else 8)
    for _ in range(_MOST_CHUNKS):
        content = place + name + width
        found = size_at(place + name, width, place if name == 16 else content, empty)
        file.seek(place)
        if file.read(len(samples)) == samples:
            found = size_at(28, 8, content) if is_long else found
            return None if head[:4] == b"caff" else total, found
        place = min(max(content, -(-found.end // align) * align), 1 << 40)
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
