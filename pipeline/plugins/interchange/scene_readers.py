"""Shared by readers of scenes: placed meshes joined to one surface, the files, and answers of processes."""

from __future__ import annotations

import io
import json
import math
import shlex
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from flowsculpt import FlowsculptError, MachineError, MeshError, MissingInputError
from flowsculpt.api import plural, shorten
from flowsculpt.api.files import InputFile, Parser, python_command
from flowsculpt.api.meshes import FileSurface, Floats, SourceFiles

MOST_MESHES, MOST_CORNERS = 20_000, 20_000_000
"""Meshes that are placed, and corners of faces of all; instances count each time."""


class Polygons(NamedTuple):
    """The faces of a mesh.

    points      float64 (V, 3)
    sides       int64 (F,): numbers of corners
    corners     int64 (C,), from 0, counter-clockwise seen from outside
    creases     int64 (K, 2): the edges that the file marks as creases
    groups      int64 (F,): edges between faces with different numbers are creases; None for one group
    velocities  float64 (V, 3), units per second; None where the file has none
    normals     float64 (V, 3), of any length; None where the file has none
    """

    points: Floats
    sides: np.ndarray
    corners: np.ndarray
    creases: np.ndarray = np.empty((0, 2), np.int64)
    groups: np.ndarray | None = None
    velocities: Floats | None = None
    normals: Floats | None = None

    def placed(self, matrix: Floats) -> Polygons:
        """Return the mesh transformed by a matrix (4, 4) of row vectors; a mirror turns its faces over."""
        if np.array_equal(matrix, np.eye(4)):
            return self
        points = self.points @ matrix[:3, :3] + matrix[3, :3]
        corners = self.corners
        if np.linalg.det(matrix[:3, :3]) < 0.0:
            corners = reversed_faces(corners, self.sides)
        velocities = None if self.velocities is None else self.velocities @ matrix[:3, :3]
        normals = None
        if self.normals is not None and np.linalg.det(matrix[:3, :3]):
            normals = self.normals @ np.linalg.inv(matrix[:3, :3]).T
        return self._replace(points=points, corners=corners, velocities=velocities, normals=normals)

    def without(self, dropped: np.ndarray) -> Polygons:
        """Return the mesh without the faces where `dropped` (F,) is True."""
        kept = ~dropped
        groups = None if self.groups is None else self.groups[kept]
        corners = self.corners[np.repeat(kept, self.sides)]
        return self._replace(sides=self.sides[kept], corners=corners, groups=groups)


VELOCITIES = ("velocities", "velocity", "v")
"""Names that programs give velocities which are not the format's own."""


def vertex_normals(normals: Floats, corners: np.ndarray, count: int) -> Floats | None:
    """Return normals (V, 3) of `count` vertices by those of vertices, or of corners (C, 3).

    A vertex whose corners differ has none: 0. Returns None where the normals are of neither.
    """
    if len(normals) == count or len(normals) != len(corners):
        return normals if len(normals) == count else None
    found = np.zeros((count, 3))
    found[corners] = normals
    found[corners[np.abs(normals - found[corners]).max(axis=1) > 1e-3]] = 0.0
    return found


def reversed_faces(corners: np.ndarray, sides: np.ndarray) -> np.ndarray:
    """Return the corners (C,) of faces the other way round; each face keeps its first."""
    ends = np.cumsum(sides)
    place = np.arange(len(corners)) - np.repeat(ends - sides, sides)
    count = np.repeat(sides, sides)
    return corners[np.repeat(ends - sides, sides) + (count - place) % np.maximum(count, 1)]


def require_vertices(corners: np.ndarray, sides: np.ndarray, count: int, place: str) -> None:
    """Raise MeshError where the corners (C,) of faces name a vertex that a mesh of so many lacks."""
    wrong = np.flatnonzero((corners < 0) | (corners >= count))
    if len(wrong):
        face = int(np.searchsorted(np.cumsum(sides), wrong[0], side="right"))
        raise MeshError(f"{place}: face {face} names vertex {corners[wrong[0]]}; there are {count} vertices")


def early_end(promised: int, item: str, present: int) -> ValueError:
    """Return the error of a file whose header promises more items than there are."""
    there = f"{present} {'is' if present == 1 else 'are'} there"
    count = plural(promised, item, "vertices" if item == "vertex" else "")
    return ValueError(f"it ends early: its header promises {count}, and {there}")


_PLURALS = {
    "hidden mesh": "hidden meshes",
    "object without triangles": "objects without triangles",
    "BasisCurves": "BasisCurves",
    "Points": "Points",
    "NurbsPatch": "NurbsPatches",
    "HermiteCurves": "HermiteCurves",
    "NurbsCurves": "NurbsCurves",
    "TetMesh": "TetMeshes",
}


class PlacedMeshes:
    """Collects placed meshes, and counts what is not read. Raises MeshError for more than the limits.

    remedy  what the message about too many meshes advises
    """

    def __init__(self, remedy: str = "export fewer") -> None:
        self.parts: list[Polygons] = []
        self.left_out: Counter[str] = Counter()
        self._remedy = remedy
        self._corners = 0

    @property
    def left_out_words(self) -> str:
        """Number and kind of what was left out: `2 line sets, 1 spline`."""
        counts = sorted((+self.left_out).items())[:5]
        return ", ".join(plural(count, shorten(kind), _PLURALS.get(kind, "")) for kind, count in counts)

    def add(self, polygons: Polygons, matrix: Floats) -> None:
        """Add a mesh transformed by a matrix (4, 4) of row vectors."""
        self._corners += len(polygons.corners)
        if self._corners > MOST_CORNERS or len(self.parts) >= MOST_MESHES:
            raise MeshError(
                f"it has over {MOST_MESHES} meshes or {MOST_CORNERS} corners of faces with its instances; "
                f"{self._remedy}"
            )
        self.parts.append(polygons.placed(matrix))


def joined(parts: Sequence[Polygons], notes: Sequence[str] = ()) -> FileSurface:
    """Return meshes as one surface; edges that two of them share are creases.

    Its vertices have the numbers of the file where there is one mesh.
    """
    firsts = np.cumsum([0, *(len(part.points) for part in parts)])[:-1].tolist()
    groups, base = [], 0
    for part in parts:
        own = np.zeros(len(part.sides), np.int64) if part.groups is None else part.groups
        groups.append(own + base)
        base += int(own.max(initial=0)) + 1
    velocities = [part.velocities for part in parts if part.velocities is not None]
    has_normals = any(part.normals is not None for part in parts)
    normals = [np.zeros_like(p.points) if p.normals is None else p.normals for p in parts if has_normals]
    return FileSurface(
        points=np.concatenate([part.points for part in parts]),
        offsets=np.concatenate([[0], np.cumsum(np.concatenate([part.sides for part in parts]))]),
        corners=np.concatenate([part.corners + first for part, first in zip(parts, firsts, strict=True)]),
        groups=np.concatenate(groups),
        tagged=np.concatenate([part.creases + first for part, first in zip(parts, firsts, strict=True)]),
        base=0 if len(parts) == 1 else None,
        notes=tuple(notes),
        velocities=np.concatenate(velocities) if len(velocities) == len(parts) else None,
        normals=np.concatenate(normals) if has_normals else None,
    )


def cages_note(count: int) -> str:
    """Return the line about meshes that other programs show subdivided."""
    return (
        f"{plural(count, 'mesh', 'meshes')} would be smoothed by subdivision, which is not done here; to "
        "make it smooth, subdivide it in the program that made the file"
    )


def bound_note(count: int) -> str:
    """Return the line about meshes that other programs show as their skeletons and blend shapes move them."""
    return (
        f"{plural(count, 'mesh', 'meshes')} would be moved by a skeleton or blend shapes, which are not "
        "applied; apply them in the program that made the file"
    )


def one_file(up_of: Callable[[Path, str], str]) -> Callable[[Path], SourceFiles]:
    """Return a function that returns the one file of a model and the axis that it says is up."""

    def files(path: Path) -> SourceFiles:
        digest = InputFile(path).digest()
        return SourceFiles.of([(path, digest)], up_of(path, digest))

    return files


def require_package(files: str, module: str, package: str, extra: str) -> None:
    """Raise MachineError where the package that reads some files is not installed; `extra` installs it."""
    if find_spec(module) is None:
        name = package.partition(" ")[0]
        installing = shlex.join(python_command("pip", "install", name))
        raise MachineError(
            f"{files} need the package {package}, which is not installed; install the extra [{extra}], or "
            f"only the package, for the Python of flowsculpt: {installing}"
        )


def answered(read: Callable[[], bytes]) -> bytes:
    """Return what `read` returns after an empty line, or a line of JSON with its error: see `asked`."""
    try:
        return b"\n" + read()
    except FlowsculptError as error:
        kind = "missing" if isinstance(error, MissingInputError) else "fault"
        return json.dumps({kind: str(error)}).encode()


def asked(module: str, path: Path, *options: str) -> bytes:
    """Return what the process of a module answers by `answered`.

    Raises MissingInputError or MeshError as it did, and what `Parser.answer` raises.
    """
    return content_of(Parser(module).answer(path, *options), path)


def content_of(answer: bytes, path: Path) -> bytes:
    """Return the content of an answer of `answered`. Raises the error in it."""
    head, _, content = answer.partition(b"\n")
    error = json.loads(head or b"{}")
    if "missing" in error:
        raise MissingInputError(f"{path}: {error['missing']}")
    if "fault" in error:
        raise MeshError(error["fault"])
    return content


_FACTS = ("base", "notes", "unit")


def packed_surface(surface: FileSurface) -> bytes:
    """Return a surface as bytes: a line of JSON, and its arrays as npz."""
    fields = {name: value for name, value in surface._asdict().items() if value is not None or name in _FACTS}
    facts = {name: fields.pop(name) for name in _FACTS}
    return json.dumps(facts).encode() + b"\n" + packed_arrays(fields)


def packed_arrays(arrays: Mapping[str, Any]) -> bytes:
    """Return arrays as bytes, an npz, for the answer of a process."""
    file = io.BytesIO()
    np.savez(file, allow_pickle=False, **arrays)
    return file.getvalue()


def unpacked_surface(content: bytes) -> FileSurface:
    """Return the surface that `packed_surface` turned into bytes."""
    head, _, archive = content.partition(b"\n")
    facts = json.loads(head)
    with np.load(io.BytesIO(archive), allow_pickle=False) as arrays:
        return FileSurface(**arrays, **(facts | {"notes": tuple(facts["notes"])}))


def known_unit(length: float) -> float | None:
    """Return the length of a unit, metres; None for one that is not above 0 and finite."""
    return length if 0.0 < length < math.inf else None
