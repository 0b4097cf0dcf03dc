"""Text from other systems: byte order marks, UTF-16 and UTF-32, line ends, and why a word is not a number.

The first four bytes show the encoding (RFC 4627, §3), so large files cost nothing more.
"""

from __future__ import annotations

import codecs
import re
from collections.abc import Callable, Iterable

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
    r"""Return text as `as_utf8` does, with lines that end in ``\n``, whatever ended them: CR LF, LF CR or CR.

    No-break spaces become spaces. Raises ValueError for NUL bytes, which no text holds.
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
