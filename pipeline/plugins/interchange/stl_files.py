"""Triangles in STL files, binary or text (3D Systems, StereoLithography Interface Specification, 1989)."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import suppress
from itertools import islice

import numpy as np

from flowsculpt.api import plural
from flowsculpt.api.files import number_fault, text_content
from flowsculpt.api.meshes import FileSurface, Floats, SurfaceReader
from flowsculpt.pipeline.plugins.interchange.scene_readers import early_end

_HEADER = 84  # bytes before the triangles of a binary file; the last four are their number

TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])

_MOST_TRIANGLES = 500_000_000  # more triangles than any file holds: such a header is text or damaged
_START = 1024  # bytes that tell text from a binary file

_BLOCK = 1 << 20  # bytes of text that are parsed at once

_NEXT = rb"\b(?:facet\s+(?:normal|outer)|end[ \t]*solid)\b"
_AFTER_SOLID = re.compile(rb"\n|\Z|" + _NEXT)
_AFTER_END = re.compile(rb"\n|\Z|\bsolid\b(?=[^\n]*?" + _NEXT + rb")")  # where the name of a solid ends

_FACET = b"facet normal x y z outer loop vertex x y z vertex x y z vertex x y z endloop endfacet".split()
"""The words of a triangle; letters stand for numbers."""

_WORDS = [(place, word) for place, word in enumerate(_FACET) if len(word) > 1]
_COORDINATES = [place for place, word in enumerate(_FACET) if len(word) == 1][3:]


def read_stl(content: bytes) -> FileSurface:
    """Read the triangles of an STL file; they share no vertices. Normals and colours are skipped.

    Raises ValueError for a file that ends early, whose header promises another number of triangles, or that
    has no numbers where coordinates belong.
    """
    points = _text_points(text_content(content).lower()) if _is_text(content) else _binary_points(content)
    return FileSurface.of(points, np.arange(len(points)).reshape(-1, 3), base=None)


def _is_text(content: bytes) -> bool:
    """Tell text from a binary file, whose header may begin with `solid` too."""
    promised = int.from_bytes(content[80:_HEADER], "little")
    if len(content) == _HEADER + TRIANGLE.itemsize * promised:
        return False
    start = content[:_START]
    with suppress(ValueError):  # there are bytes of zero, or it is damaged
        start = text_content(start)
    start = start.lower()
    return start.lstrip().startswith(b"solid") and (b"facet" in start or b"\0" not in start)


def _binary_points(content: bytes) -> Floats:
    if len(content) < _HEADER:
        size = plural(len(content), "byte")
        raise ValueError(f"it ends early: it has {size}, and its header alone needs {_HEADER}")
    promised = int.from_bytes(content[80:_HEADER], "little")
    present = (len(content) - _HEADER) // TRIANGLE.itemsize
    if promised > _MOST_TRIANGLES:
        raise ValueError("it has no STL header")
    if present < promised:
        raise early_end(promised, "triangle", present)
    if present > promised and content[_HEADER + promised * TRIANGLE.itemsize :].strip(b"\0"):
        count = plural(promised, "triangle")
        raise ValueError(f"its header promises {count}, and there is room for {present}")
    triangles = np.frombuffer(content, TRIANGLE, promised, _HEADER)
    return triangles["corners"].reshape(-1, 3).astype(np.float64)


def _text_points(content: bytes) -> Floats:
    spans, is_closed = _spans_without_names(content)
    if not is_closed:
        present = plural(content.count(b"endfacet"), "triangle")
        raise ValueError(f"it ends early: endsolid is missing after {present}")
    points, count = [np.empty((0, 3))], 0
    for block in _blocks(content, spans):
        points.append(_block_points(block, count))
        count += len(points[-1]) // 3
    return np.concatenate(points)


def _spans_without_names(content: bytes) -> tuple[list[tuple[int, int]], bool]:
    """Return where text lies without `solid`, `endsolid` and their names, and whether the last was an end.

    A name ends with its line, or where the next statement begins: some files have one line only.
    """
    spans: list[tuple[int, int]] = []
    start, is_closed = 0, False
    while (at := content.find(b"solid", start)) >= 0:
        end = at
        while end > start and content[end - 1] in b" \t":
            end -= 1
        is_closed = content.endswith(b"end", start, end)
        spans.append((start, end - len(b"end") if is_closed else end))
        name_end = (_AFTER_END if is_closed else _AFTER_SOLID).search(content, at + len(b"solid"))
        start = name_end.start() if name_end else len(content)
    return [*spans, (start, len(content))], is_closed


def _blocks(content: bytes, spans: list[tuple[int, int]]) -> Iterator[bytes]:
    """Yield the text of spans in blocks of whole facets: the words of all would take ten times its size."""
    for start, end in spans:
        while start < end:
            at = content.find(b"endfacet", min(start + _BLOCK, end), end)
            last = end if at < 0 else at + len(b"endfacet")
            yield content[start:last]
            start = last


def _block_points(block: bytes, first: int) -> Floats:
    """Return the corners of the triangles of a block; `first` is the number of the first one in the file."""
    words = block.split()
    count, rest = divmod(len(words), len(_FACET))
    if rest or any(words[place :: len(_FACET)] != [word] * count for place, word in _WORDS):
        words = _regular(words, first)
        count = len(words) // len(_FACET)
    columns = [words[place :: len(_FACET)] for place in _COORDINATES]
    try:
        table = np.array([[*map(float, column)] for column in columns], np.float64)
    except ValueError:
        faults = ((first + k, number_fault(corner)) for k, corner in enumerate(zip(*columns, strict=True)))
        raise ValueError(next(f"triangle {k}: {fault}" for k, fault in faults if fault)) from None
    return np.ascontiguousarray(table.T).reshape(-1, 3)


def _regular(words: list[bytes], first: int) -> list[bytes]:
    """Return the words of triangles as `_FACET` has them, from others that lack normals or have more.

    Raises ValueError for a facet that is not a triangle.
    """
    regular: list[bytes] = []
    corners: list[bytes] = []
    remaining = iter(words)
    for word in remaining:
        if word == b"vertex":
            corners += islice(remaining, 3)
        elif word in (b"facet", b"endloop", b"endfacet") and corners:
            if len(corners) != 9:
                vertices = plural(-(-len(corners) // 3), "vertex", "vertices")
                raise ValueError(
                    f"facet {first + len(regular) // len(_FACET)} has {vertices}; each is a triangle"
                )
            place = dict(zip(_COORDINATES, corners, strict=True))
            regular += [place.get(k, word) for k, word in enumerate(_FACET)]
            corners = []
    if corners:
        raise ValueError(f"facet {first + len(regular) // len(_FACET)} has no endfacet")
    return regular


STL = SurfaceReader.of_content(read_stl, usual_up="z")  # most come from printing and construction
