"""Files of VTK's XML formats: their elements, and the arrays of numbers in them.

Arrays are text, base64, or lie at the end of the file (`AppendedData`), as base64 or raw; they may be
compressed, in blocks (VTK file formats, *XML File Formats*).
"""

from __future__ import annotations

import base64
import lzma
import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any
from xml.etree import ElementTree

import numpy as np

from flowsculpt import UsageError

_TYPES = {f"Int{8 * size}": f"i{size}" for size in (1, 2, 4, 8)}
_TYPES |= {f"U{name}": f"u{kind[1]}" for name, kind in _TYPES.items()}
_TYPES |= {"Float32": "f4", "Float64": "f8"}

MOST_A_BYTE = {
    None: 1,
    "vtkZLibDataCompressor": 1032,
    "vtkLZ4DataCompressor": 255,
    "vtkLZMADataCompressor": 8000,
}
"""Numbers that a byte of a file holds at most, by its compressor; even data are packed so densely."""


@dataclass(frozen=True)
class VtkFile:
    """The parts of a file.

    head      the XML elements, without appended bytes
    appended  the bytes after the underscore, base64 or raw
    """

    head: ElementTree.Element
    appended: bytes

    @classmethod
    def of(cls, content: bytes) -> VtkFile:
        """Return the parts of a file. Raises UsageError where it is not XML."""
        text, mark, rest = content.partition(b"<AppendedData")
        body = rest[rest.find(b"_") + 1 :] if mark else b""
        encoding = b'raw"' if b"raw" in rest[: rest.find(b"_")] else b'base64"'
        try:
            closing = b'<AppendedData encoding="' + encoding + b"/></VTKFile>" if mark else b""
            head = ElementTree.fromstring(text + closing)
        except ElementTree.ParseError as error:
            raise UsageError(f"not XML ({error}); a VTK file is written by VTK or ParaView") from None
        end = body.rfind(b"</AppendedData")
        return cls(head, body[:end] if end >= 0 else body)

    @property
    def kind(self) -> str:
        """The type of the data set, such as PolyData; of a file of something else its root."""
        return (self.head.get("type") or "VTKFile") if self.head.tag == "VTKFile" else self.head.tag

    @property
    def compressor(self) -> str | None:
        return self.head.get("compressor") or None

    def numbers(self, element: ElementTree.Element, most: int) -> np.ndarray:
        """Return the values of a DataArray, flat; of compressed ones no more than `most` are unpacked.

        Raises UsageError where it cannot be read.
        """
        kind = _TYPES.get(element.get("type", ""))
        if kind is None:
            raise UsageError(f"{element.get('type')} is not a type of numbers")
        if element.get("format") == "ascii":
            return np.array((element.text or "").split(), dtype=kind)
        order = ">" if self.head.get("byte_order") == "BigEndian" else "<"
        try:
            content = self._bytes(element, order, most * np.dtype(kind).itemsize)
            return np.frombuffer(content, dtype=order + kind)
        except UsageError:
            raise
        except Exception as error:  # decompressors raise anything
            raise UsageError(f"array {element.get('Name')} cannot be read ({error})") from None

    def _bytes(self, element: ElementTree.Element, order: str, most: int) -> bytes:
        if element.get("format") == "appended":
            offset = int(element.get("offset", "0"))
            if not 0 <= offset < len(self.appended):
                raise ValueError(f"it begins at byte {offset}, and {len(self.appended)} bytes are appended")
            text = self.appended[offset:]
            appended = self.head.find("AppendedData")
            is_base64 = appended is not None and appended.get("encoding") == "base64"
        else:
            text, is_base64 = (element.text or "").strip().encode(), True
        code = order + ("Q" if self.head.get("header_type") == "UInt64" else "I")
        if self.compressor is not None:
            return self._decompressed(text, is_base64, code, most)
        size = struct.calcsize(code)
        (length,) = struct.unpack(code, _take(text, is_base64, 0, size))
        return _take(text, is_base64, size, length)

    def _decompressed(self, text: bytes, is_base64: bool, code: str, most: int) -> bytes:
        """Decompress blocks: a header of count, size, last size and compressed sizes, then the blocks."""
        if self.compressor not in _DECOMPRESSORS:
            known = ", ".join(_DECOMPRESSORS)
            raise UsageError(f"it is compressed by {self.compressor}, and only {known} are read")
        size = struct.calcsize(code)
        (count,) = struct.unpack(code, _take(text, is_base64, 0, size))
        head = np.frombuffer(_take(text, is_base64, 0, (3 + count) * size), dtype=code).tolist()
        start = _length(is_base64, (3 + count) * size)
        packed = _take(text[start:], is_base64, 0, sum(head[3:]))
        sizes = [head[1]] * count
        if count and head[2]:
            sizes[-1] = head[2]
        if sum(sizes) > most:
            raise ValueError("it holds more numbers than it should have")
        blocks, at = list[bytes](), 0
        for length, whole in zip(head[3:], sizes, strict=True):
            blocks.append(_DECOMPRESSORS[self.compressor](packed[at : at + length], whole))
            at += length
            if len(blocks[-1]) != whole:
                raise ValueError(f"a compressed block has {len(blocks[-1])} bytes instead of {whole}")
        return b"".join(blocks)


def _streamed(decompressor: Callable[[], Any]) -> Callable[[bytes, int], bytes]:
    """Return what decompresses a block of a size, by a class of the standard library."""

    def decompress(block: bytes, size: int) -> bytes:
        unpacker = decompressor()
        content: bytes = unpacker.decompress(block, size + 1)
        if not unpacker.eof:
            raise ValueError("a compressed block is truncated")
        return content

    return decompress


def _lz4(block: bytes, size: int) -> bytes:
    """Decompress a block of LZ4 (LZ4 block format): literals, and copies of what is up to 64 KiB before."""
    content, at = bytearray(), 0
    while at < len(block):
        token = block[at]
        count, at = _lz4_length(block, at + 1, token >> 4)
        if at + count > len(block):
            raise ValueError("a compressed block is truncated")
        content += block[at : at + count]
        at += count
        if at == len(block):
            break
        back = int.from_bytes(block[at : at + 2], "little")
        count, at = _lz4_length(block, at + 2, token & 15)
        if not 0 < back <= len(content) or len(content) + count > size:
            raise ValueError("a compressed block is damaged")
        start = len(content) - back
        copied = content[start : start + count + 4]
        content += (copied * -(-(count + 4) // back))[: count + 4]
    return bytes(content)


def _lz4_length(block: bytes, at: int, length: int) -> tuple[int, int]:
    """Return a length that goes on in further bytes if it is 15, and the byte after it."""
    if length == 15:
        while block[at] == 255:
            length, at = length + 255, at + 1
        length, at = length + block[at], at + 1
    return length, at


_DECOMPRESSORS: dict[str, Callable[[bytes, int], bytes]] = {
    "vtkZLibDataCompressor": _streamed(zlib.decompressobj),
    "vtkLZ4DataCompressor": _lz4,
    "vtkLZMADataCompressor": _streamed(lambda: lzma.LZMADecompressor(memlimit=256 << 20)),
}


def _take(text: bytes, is_base64: bool, first: int, count: int) -> bytes:
    """Return bytes `first` to `first + count` of base64 text, or of raw bytes."""
    content = base64.b64decode(text[: _length(is_base64, first + count)]) if is_base64 else text
    if len(content) < first + count:
        raise ValueError(f"{first + count} bytes are announced, but {len(content)} exist")
    return content[first : first + count]


def _length(is_base64: bool, count: int) -> int:
    """Return the length of `count` bytes in the file."""
    return -(-count // 3) * 4 if is_base64 else count
