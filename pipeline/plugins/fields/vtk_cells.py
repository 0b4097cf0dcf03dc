"""Cells of unstructured grids of VTK, and their skin: the faces that only one solid cell has."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from flowsculpt import MeshError
from flowsculpt.api.meshes import Floats

# Corners of the faces of solid cells (VTK file formats; vtkCellType.h)
_SOLIDS: dict[int, list[list[int]]] = {
    10: [[0, 1, 3], [1, 2, 3], [2, 0, 3], [0, 2, 1]],
    11: [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]],
    12: [[0, 4, 7, 3], [1, 2, 6, 5], [0, 1, 5, 4], [3, 7, 6, 2], [0, 3, 2, 1], [4, 5, 6, 7]],
    13: [[0, 1, 2], [3, 5, 4], [0, 3, 4, 1], [1, 4, 5, 2], [2, 5, 3, 0]],
    14: [[0, 3, 2, 1], [0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]],
    15: [[0, 4, 3, 2, 1], [5, 6, 7, 8, 9], *([k, (k + 1) % 5, 5 + (k + 1) % 5, 5 + k] for k in range(5))],
    16: [[0, 5, 4, 3, 2, 1], [*range(6, 12)], *([k, (k + 1) % 6, 6 + (k + 1) % 6, 6 + k] for k in range(6))],
}
_CORNERS = {5: 3, 8: 4, 9: 4, 10: 4, 11: 8, 12: 8, 13: 6, 14: 5, 15: 10, 16: 12}
_THIN = {1: "point", 2: "point", 3: "line", 4: "line"}
_STRIP, _POLYGON, _PIXEL, POLYHEDRON = 6, 7, 8, 42


class Faces(NamedTuple):
    """Faces of cells.

    sides    int64 (F,): numbers of corners
    corners  int64 (C,)
    cells    int64 (F,): the cell of each
    """

    sides: np.ndarray
    corners: np.ndarray
    cells: np.ndarray

    @classmethod
    def of(cls, corners: np.ndarray, cells: np.ndarray) -> Faces:
        """Return faces of the same number of corners, (F, n)."""
        return cls(np.full(len(corners), corners.shape[1], np.int64), corners.reshape(-1), cells)

    @classmethod
    def joined(cls, parts: Sequence[Faces]) -> Faces:
        empty = cls(*(np.empty(0, np.int64) for _ in cls._fields))
        return cls(*(np.concatenate(values) for values in zip(empty, *parts, strict=True)))

    def kept(self, chosen: np.ndarray) -> Faces:
        """Return the faces where `chosen` (F,) is True."""
        return Faces(self.sides[chosen], self.corners[np.repeat(chosen, self.sides)], self.cells[chosen])


class Cells(NamedTuple):
    """The cells of a grid.

    types      int64 (N,), as VTK numbers them
    starts     int64 (N + 1,): cell c has the points ``points[starts[c]:starts[c + 1]]``
    points     int64 (C,)
    polyhedra  the faces of polyhedra
    shown      bool (N,): False for cells that are hidden, or another piece has too
    """

    types: np.ndarray
    starts: np.ndarray
    points: np.ndarray
    polyhedra: Faces
    shown: np.ndarray

    @classmethod
    def joined(cls, pieces: Sequence[Cells], counts: Sequence[int]) -> Cells:
        """Return the cells of pieces with so many points each."""
        starts, points, faces = [np.zeros(1, np.int64)], [np.empty(0, np.int64)], list[Faces]()
        cell = corner = point = 0
        for piece, count in zip(pieces, counts, strict=True):
            starts.append(piece.starts[1:] + corner)
            points.append(piece.points + point)
            sides, corners, cells = piece.polyhedra
            faces.append(Faces(sides, corners + point, cells + cell))
            cell, corner, point = cell + len(piece.types), corner + len(piece.points), point + count
        shown = np.concatenate([np.empty(0, bool), *(piece.shown for piece in pieces)])
        types = np.concatenate([np.empty(0, np.int64), *(piece.types for piece in pieces)])
        return cls(types, np.concatenate(starts), np.concatenate(points), Faces.joined(faces), shown)

    def require_faces_or_none(self, count: int) -> None:
        """Raise MeshError for curved cells, ones with a wrong number of points, or without one of `count`."""
        known = np.isin(self.types, [0, *_THIN, *_CORNERS, _STRIP, _POLYGON, POLYHEDRON])
        if not known.all():
            cell = int(np.argmin(known))
            raise MeshError(
                f"cell {cell} has VTK's type {self.types[cell]}; only cells with straight edges are read, "
                "types 1 to 16 and 42. Tessellate it, by a filter of that name in ParaView"
            )
        needed = np.full(256, -1)
        needed[list(_CORNERS)] = list(_CORNERS.values())
        needed, sizes = needed[self.types], np.diff(self.starts)
        wrong = (needed >= 0) & (sizes != needed)
        wrong |= np.isin(self.types, [_STRIP, _POLYGON]) & (sizes < 3)
        if wrong.any():
            cell = int(np.argmax(wrong))
            raise MeshError(f"cell {cell} of VTK's type {self.types[cell]} has {sizes[cell]} points")
        for corners in (self.points, self.polyhedra.corners):
            wrong = (corners < 0) | (corners >= count)
            if wrong.any():
                raise MeshError(f"a cell names point {corners[np.argmax(wrong)]}; there are {count} points")

    @property
    def thin(self) -> list[tuple[int, str]]:
        """How many cells have no faces, and their kind."""
        kinds = [_THIN[kind] for kind in self.types[np.isin(self.types, list(_THIN))].tolist()]
        return [(kinds.count(kind), kind) for kind in ("line", "point") if kind in kinds]

    def means(self, values: Floats, count: int) -> Floats:
        """Return the means (count, W) at points of values (N, W) of the cells around them."""
        of = np.repeat(np.arange(len(self.types)), np.diff(self.starts))
        around = np.maximum(np.bincount(self.points, minlength=count), 1)
        sums = [np.bincount(self.points, column[of], count) for column in values.T]
        return np.asarray(np.stack(sums, axis=1) / around[:, None])

    def skin(self, points: Floats) -> Faces:
        """Return the flat cells, and the faces that one solid cell has, turned outwards.

        points  (V, 3): where the corners are
        """
        flat = [self._of_type(kind, [[*range(_CORNERS[kind])]]) for kind in (5, 9)]
        flat += [self._of_type(_PIXEL, [[0, 1, 3, 2]]), self._polygons(), self._strips()]
        solid = [self._of_type(kind, table) for kind, table in _SOLIDS.items()]
        faces = Faces.joined([*flat, *solid, self.polyhedra])
        is_solid = np.arange(len(faces.sides)) >= sum(len(part.sides) for part in flat)
        shown = self.shown[faces.cells]
        faces, is_solid = faces.kept(shown), is_solid[shown]
        if not is_solid.any():
            return faces
        numbers, number_of = _same_faces(faces)
        solids = np.bincount(number_of[is_solid], minlength=numbers)[number_of]
        outer = np.where(is_solid, solids == 1, solids == 0)
        return self._outwards(faces.kept(outer), points, is_solid[outer])

    def _of_type(self, kind: int, table: list[list[int]]) -> Faces:
        cells = np.flatnonzero(self.types == kind)
        rows = self.points[self.starts[cells][:, None] + np.arange(_CORNERS[kind])]
        return Faces.joined([Faces.of(rows[:, face], cells) for face in table])

    def _polygons(self) -> Faces:
        every = Faces(np.diff(self.starts), self.points, np.arange(len(self.types)))
        return every.kept(self.types == _POLYGON)

    def _strips(self) -> Faces:
        cells = np.flatnonzero(self.types == _STRIP)
        rows = [_triangles(self.points[self.starts[cell] : self.starts[cell + 1]]) for cell in cells]
        of = np.repeat(cells, [len(row) for row in rows])
        return Faces.of(np.concatenate(rows), of) if rows else Faces.joined([])

    def _outwards(self, faces: Faces, points: Floats, is_solid: np.ndarray) -> Faces:
        """Return faces; those of solid cells that face the middle of their cell the other way round."""
        sizes = np.maximum(np.diff(self.starts), 1)
        of = np.repeat(np.arange(len(self.types)), np.diff(self.starts))
        sums = np.stack([np.bincount(of, points[self.points, k], len(sizes)) for k in range(3)], 1)
        ends = np.cumsum(faces.sides)
        face_of = np.repeat(np.arange(len(ends)), faces.sides)
        places = points[faces.corners] - (sums / sizes[:, None])[faces.cells][face_of]
        following = np.arange(len(faces.corners)) + 1
        following[ends - 1] = ends - faces.sides
        turning = np.cross(places, places[following])
        area = np.stack([np.bincount(face_of, turning[:, k], len(ends)) for k in range(3)], 1)
        middle = np.stack([np.bincount(face_of, places[:, k], len(ends)) for k in range(3)], 1)
        inwards = is_solid & (np.einsum("ij,ij->i", area, middle) < 0.0)
        backwards = (2 * ends - faces.sides - 1)[face_of] - np.arange(len(faces.corners))
        return faces._replace(corners=np.where(inwards[face_of], faces.corners[backwards], faces.corners))


def faces_of_streams(streams: np.ndarray, ends: np.ndarray) -> Faces:
    """Return the faces of polyhedra as files of VTK before 9.4 have them.

    streams  int64 (S,): of each polyhedron its number of faces, of each face its number of corners, and these
    ends     int64 (N,): where the stream of each cell ends; -1 where it is not a polyhedron

    Raises MeshError where they do not fit.
    """
    sides, corners, cells, at = list[int](), list[np.ndarray](), list[int](), 0
    for cell in np.flatnonzero(ends >= 0).tolist():
        count, at = int(streams[at]) if at < len(streams) else 0, at + 1
        for _ in range(count):
            size = int(streams[at]) if at < len(streams) else 0
            if size < 3 or at + size >= len(streams):
                raise MeshError(f"cell {cell}, a polyhedron, ends within its faces")
            sides.append(size)
            corners.append(streams[at + 1 : at + 1 + size])
            at += 1 + size
        if at != ends[cell] or count < 1:
            raise MeshError(f"cell {cell}, a polyhedron, has other faces than faceoffsets says")
        cells += [cell] * count
    return Faces(np.array(sides), np.concatenate(corners), np.array(cells)) if sides else Faces.joined([])


def _triangles(strip: np.ndarray) -> np.ndarray:
    """Return the triangles (F, 3) of a strip of points; every second one is wound the other way round."""
    rows = np.stack([strip[:-2], strip[1:-1], strip[2:]], axis=1)
    rows[1::2] = rows[1::2, [1, 0, 2]]
    return rows


def _same_faces(faces: Faces) -> tuple[int, np.ndarray]:
    """Return how many different faces there are, and the number (F,) of each by its set of corners."""
    width = int(faces.sides.max(initial=1))
    rows = np.full((len(faces.sides), width), -1, np.int64)
    rows[np.arange(width) < faces.sides[:, None]] = faces.corners
    rows.sort(axis=1)
    rows[:, 1:][rows[:, 1:] == rows[:, :-1]] = -1  # cells may have several corners at one point
    rows.sort(axis=1)
    order = np.lexsort(rows.T)
    is_new = np.ones(len(rows), bool)
    is_new[1:] = (rows[order[1:]] != rows[order[:-1]]).any(axis=1)
    numbers = np.empty(len(rows), np.int64)
    numbers[order] = np.cumsum(is_new) - 1
    return int(is_new.sum()), numbers
