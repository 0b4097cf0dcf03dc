"""Surfaces in Wavefront OBJ files, with their polygons, groups and creases.

By its specification (Wavefront, Advanced Visualizer, Appendix B), with crease tags as OpenSubdiv writes them:
``t crease 2/1/0 a b sharpness``, vertices numbered from 0.
"""

from __future__ import annotations

import io
import re
from collections import Counter
from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from flowsculpt import MeshError
from flowsculpt.api import plural
from flowsculpt.api.files import number_fault, text_content
from flowsculpt.api.meshes import FileSurface, SurfaceReader

_PARTING = (b"o", b"g", b"s", b"usemtl")
"""Statements that begin another object, group, smoothing group or material."""

_NAMING = (b"o", b"g", b"usemtl", b"mtllib")
"""Statements whose names may end in a backslash, as paths of Windows do; it does not continue the line."""

_RUN = re.compile(rb"^(?:(?:v [^\n#]*+\n){8,4096}+|(?:f [^\n#]*+\n){8,4096}+)", re.MULTILINE)
"""Lines of vertices, or of faces, which can be read at once; not more, since their words take memory."""

_CONTINUED = re.compile(rb"\\[ \t\f\v]*\n")

_UNSMOOTHED = (b"off", b"0")

_LEFT_OUT = {
    b"l": ("line", "lines"),
    b"p": ("set of points", "sets of points"),
    b"curv": ("free-form curve", "free-form curves"),
    b"surf": ("free-form surface", "free-form surfaces"),
    b"bzp": ("Bézier patch", "Bézier patches"),
    b"bsp": ("B-spline patch", "B-spline patches"),
}
"""Statements that other programs show and that are not faces: what one of them is called, and several."""


def read_wavefront(content: bytes) -> FileSurface:
    """Read the faces of an OBJ file, grouped by object, group, smoothing group and material.

    Faces outside all smoothing groups form one group: many writers leave smoothing out, and such a surface
    has no creases. Normals, colours and texture coordinates are skipped; lines, points, curves and free-form
    surfaces are left out with a note. Raises ValueError, with its line, for unreadable input, and MeshError
    for weights of vertices and for other files that it calls.
    """
    reader, text = _Wavefront(), text_content(content)
    line, at = 1, 0
    for run in () if _CONTINUED.search(text) else _RUN.finditer(text):
        line = _read_statements(reader, text[at : run.start()], line)
        at = run.end()
        lines = reader.run(run[0])
        line = line + lines if lines else _read_statements(reader, run[0], line)
    _read_statements(reader, text[at:], line)
    return reader.surface()


def _read_statements(reader: _Wavefront, text: bytes, first: int) -> int:
    """Read statements that begin in line `first`; return the line after them."""
    vertex, face = reader.vertex, reader.face
    for line, words in statements(text, first):
        try:
            match words[0]:
                case b"v":
                    vertex(words)
                case b"f" | b"fo":
                    face(words)
                case _:
                    reader.other(words)
        except (ValueError, MeshError) as error:
            shown = b" ".join(words).decode("utf-8", "replace")[:40]
            raise type(error)(f"line {line}: {shown}: {error}") from None
    return first + text.count(b"\n")


def statements(content: bytes, first: int) -> Iterator[tuple[int, list[bytes]]]:
    """Yield statements as words, with the line where each ends; backslashes continue lines, but not names."""
    words: list[bytes] = []
    number = 0
    for number, text in enumerate(io.BytesIO(content), first):
        if b"#" in text:
            text = text.partition(b"#")[0]
        if b"\\" in text and (begun := text.rstrip()).endswith(b"\\"):
            words += begun[:-1].split()
            if words[:1] and words[0] not in _NAMING:
                continue
        else:
            words += text.split()
        if words:
            yield number, words
            words = []
    if words:
        yield number, words


class _Wavefront:
    """The state of a file's statements up to a line.

    corners  vertices of all faces, from 1
    sides    number of corners of each face
    """

    def __init__(self) -> None:
        self.coordinates: list[float] = []
        self.corners: list[int] = []
        self.sides: list[int] = []
        self.groups: list[int] = []
        self.tagged: list[tuple[int, int]] = []
        self.left_out: Counter[bytes] = Counter()
        self._part = dict.fromkeys(_PARTING, b"")
        self._numbers: dict[tuple[bytes, ...], int] = {}
        self._group: int | None = None

    def vertex(self, words: list[bytes]) -> None:
        """Add a vertex; numbers after its coordinates are a weight, if there is one, or colours."""
        try:
            self.coordinates += map(float, words[1:4])
            if len(words) == 5 and float(words[4]) != 1.0:
                fact = "its fourth number is a weight, which belongs to rational curves, not to faces"
                raise MeshError(f"{fact}. Export it without weights.")
        except ValueError:
            raise ValueError(number_fault(words[1:5])) from None
        if len(words) < 4:
            number = len(self.coordinates) // 3 + 1
            raise ValueError(f"vertex {number} has {plural(len(words) - 1, 'coordinate')}, not 3")

    def face(self, words: list[bytes]) -> None:
        """Add a face whose corners are ``v``, ``v/vt``, ``v//vn`` or ``v/vt/vn``; negative count back."""
        names = words[1:]
        if b"/" in words[-1]:
            names = [name.partition(b"/")[0] for name in names]
        try:
            numbers = [*map(int, names)]
        except ValueError:  # mixed forms
            names = [name.partition(b"/")[0] for name in names]
            if fault := number_fault(names, int):
                raise ValueError(fault) from None
            numbers = [*map(int, names)]
        if numbers and min(numbers) <= 0:
            numbers = [number if number > 0 else self._counted_back(number) for number in numbers]
        self._add_faces(numbers, len(numbers), 1)

    def run(self, text: bytes) -> int:
        """Read lines of vertices alone, or of faces with as many corners each; return their number.

        Return 0, with nothing read, where a line has another form than the first, or holds a fault.
        """
        words, lines = text.split(), text.count(b"\n")
        width, kind = len(text[: text.index(b"\n")].split()), words[0]
        if len(words) != width * lines or words[::width] != lines * [kind] or (kind == b"v" and width != 4):
            return 0
        del words[::width]
        try:
            if kind == b"v":
                self.coordinates += [*map(float, words)]
                return lines
            names = [word.partition(b"/")[0] for word in words] if b"/" in text else words
            numbers = [*map(int, names)]
        except ValueError:
            return 0
        if min(numbers, default=0) <= 0:
            return 0
        self._add_faces(numbers, width - 1, lines)
        return lines

    def _add_faces(self, corners: list[int], sides: int, count: int) -> None:
        """Add faces with so many sides each to the group that has begun."""
        if self._group is None:
            self._group = self._numbers.setdefault(tuple(self._part.values()), len(self._numbers))
        self.corners += corners
        self.sides += count * [sides]
        self.groups += count * [self._group]

    def _counted_back(self, number: int) -> int:
        vertices = len(self.coordinates) // 3
        if number == 0:
            raise ValueError("vertices are numbered from 1")
        if -number > vertices:
            there = plural(vertices, "vertex", "vertices")
            raise ValueError(f"{number} counts back beyond the first of {there}")
        return vertices + 1 + number

    def other(self, words: list[bytes]) -> None:
        """Note a change of group, a crease, or what is left out."""
        name = words[0]
        match name:
            case b"s":
                smooth = words[1:2] != [] and words[1] not in _UNSMOOTHED
                self._begin(b"s", words[1] if smooth else b"")
            case b"o" | b"g" | b"usemtl":
                self._begin(name, b" ".join(words[1:]))
            case b"t" if words[1:2] == [b"crease"]:
                self.tagged += _creases(words)
            case b"call":
                raise MeshError("files that this file calls are not read. Export it as one file.")
            case _ if name in _LEFT_OUT:
                self.left_out[name] += 1

    def _begin(self, name: bytes, value: bytes) -> None:
        self._part[name] = value
        self._group = None

    def surface(self) -> FileSurface:
        """Return the faces. Raises ValueError where one names a missing vertex."""
        counts = [
            f"{plural(count, *_LEFT_OUT[name])} ({name.decode()})" for name, count in self.left_out.items()
        ]
        notes = (f"{' and '.join(counts)} left out: only faces (f) make a surface",) if counts else ()
        points = np.array(self.coordinates, np.float64).reshape(-1, 3)
        corners = np.array(self.corners, np.int64) - 1
        return FileSurface.of(points, corners, self.groups, self.tagged, 1, notes, self.sides)


def _creases(words: list[bytes]) -> list[tuple[int, int]]:
    """Return the edges of one tag: consecutive pairs of its vertices, unless its sharpness is 0."""
    if len(words) < 3:
        raise ValueError("its counts are missing")
    count = int(words[2].split(b"/", 1)[0])
    chain = [int(word) for word in words[3 : 3 + count]]
    sharpness = [float(word) for word in words[3 + count :]]
    return list(pairwise(chain)) if any(sharpness) else []


OBJ = SurfaceReader.of_content(
    read_wavefront,
    # a reader lost the first vertex after a byte order mark, and statements after names that end in \
    misread=re.compile(
        rb"\A\xef\xbb\xbf|^[ \t]*(?:o|g|usemtl|mtllib)[ \t][^\r\n]*\\[ \t]*[\r\n]", re.MULTILINE
    ),
)
