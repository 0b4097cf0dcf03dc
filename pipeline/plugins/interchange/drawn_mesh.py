"""One mesh as graphics cards draw it, and its motion as a few keyframes with straight lines between them.

Cards know one normal and one pair of texture coordinates a vertex: vertices are split at creases and seams.
Their order follows a space-filling curve over the surface at rest, so that neighbours are close in memory and
differences from one vertex to the next are small.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from flowsculpt.api.meshes import Floats, Indices, edge_keys, morton_order
from flowsculpt.pipeline.plugins.interchange.one_mesh import OneMesh

MOST_ERROR = 0.25
"""Distance of a vertex between keyframes from its true position, maximum edge lengths of the frame."""

_STEPS = 512
"""Steps of whole-number positions in an edge. Where the flow squeezes the surface, edges are far shorter."""

_LARGEST = 32767  # of int16


def split_corners(
    corner_normals: Indices, texture: Floats | None, colours: np.ndarray | None = None
) -> tuple[Indices, Indices]:
    """Return vertices (W,), each a corner of a face, and faces (F, 3) of them.

    Corners with the same normal, and so the same vertex, the same texture coordinates and the same colour
    (F, 3, 3), where there are any, are one vertex.
    """
    normals = corner_normals.reshape(-1)
    held = [values for values in (texture, colours) if values is not None]
    if not held:
        some_corner: Indices = np.zeros(int(normals.max()) + 1, np.int32)
        some_corner[normals] = np.arange(len(normals), dtype=np.int32)
        return some_corner, corner_normals
    rows = np.column_stack([normals, *(values.reshape(len(normals), -1) for values in held)])
    _, corner, vertex = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    return corner.astype(np.int32), vertex.astype(np.int32).reshape(-1, 3)


@dataclass(frozen=True, eq=False)
class DrawnMesh:
    """One mesh with W vertices of one normal each.

    source     (W,): the vertex of one mesh that each is
    row        (W,): the row of its normal in the normals of a frame
    faces      (F, 3) into the W vertices
    texture    coordinates (W, 2), to the right and upwards, or None
    painted    linear Rec.709 reflectances (W, 3) that a model's file has; None where it has none
    materials  (F,): numbers of a model's materials, ascending; None of other looks
    """

    mesh: OneMesh
    source: Indices
    row: Indices
    faces: Indices
    texture: Floats | None
    painted: np.ndarray | None = None
    materials: np.ndarray | None = None

    @classmethod
    def of(cls, mesh: OneMesh) -> DrawnMesh:
        """Split the vertices of a mesh, and order vertices and faces for drawing."""
        painted = None if mesh.paint is None else mesh.paint.colours
        corner, faces = split_corners(mesh.corner_normals, mesh.texture, painted)
        source = mesh.faces.reshape(-1)[corner]
        order = morton_order(mesh.rest[source])
        place = np.empty(len(order), np.int32)
        place[order] = np.arange(len(order), dtype=np.int32)
        faces = place[faces]
        turned = (np.argmin(faces, axis=1)[:, None] + np.arange(3)) % 3  # each begins with its first vertex
        faces = np.take_along_axis(faces, turned, axis=1)
        texture = None if mesh.texture is None else mesh.texture.reshape(-1, 2)[corner[order]]
        row = mesh.corner_normals.reshape(-1)[corner[order]]
        if painted is not None:
            painted = painted.reshape(-1, 3)[corner[order]]
        materials = None if mesh.paint is None else mesh.paint.materials
        drawn = np.lexsort((*faces.T[::-1], *([] if materials is None else [materials])))
        if materials is not None:
            materials = materials[drawn]
        return cls(mesh, source[order], row, faces[drawn], texture, painted, materials)

    @property
    def colours(self) -> Floats | None:
        """Linear Rec.709 reflectances (W, 3); None where the look has one colour."""
        if self.painted is not None:
            return self.painted
        return None if self.mesh.colours is None else self.mesh.colours[self.source]

    @cached_property
    def is_closed(self) -> bool:
        """True if each edge has two faces, so that nobody sees the inside."""
        faces = self.mesh.faces
        edges = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
        return bool((np.unique(edge_keys(edges), return_counts=True)[1] == 2).all())

    def frame(self, number: int) -> tuple[Floats, Floats]:
        """Return positions (W, 3) and unit normals (W, 3) at a frame."""
        frame = self.mesh.frame(number)
        return frame.points[self.source], frame.normals[self.row]

    @cached_property
    def bounds(self) -> tuple[Floats, Floats]:
        """The least and the greatest coordinates (3,) of all frames."""
        low, high = np.full(3, math.inf), np.full(3, -math.inf)
        for number in self.mesh.frames:
            points = self.mesh.points_at(number)
            low, high = np.minimum(low, points.min(axis=0)), np.maximum(high, points.max(axis=0))
        return low, high

    def edge_at(self, number: int, points: Floats) -> float:
        """Return the maximum edge length of a frame; where there is none, the mean length of the edges."""
        longest = self.mesh.longest_at(number)
        if math.isfinite(longest):
            return longest
        corners = points[self.mesh.faces]
        return float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).mean())


@dataclass(frozen=True, eq=False)
class KeyPoses:
    """The motion of a drawn mesh as K poses, between which vertices move on straight lines.

    numbers  the frames of the poses, ascending
    places   int32 (K, W, 3): positions in whole steps from `centre`; differences between poses fit int16
    normals  float32 (K, W, 3), unit
    step     scene units
    error    the largest distance between the poses and any frame, in maximum edge lengths of that frame
    """

    drawn: DrawnMesh
    numbers: tuple[int, ...]
    places: np.ndarray
    normals: np.ndarray
    centre: Floats
    step: float
    error: float

    @classmethod
    def of(
        cls, drawn: DrawnMesh, passed: Callable[[], None] = lambda: None, share: float = math.inf
    ) -> KeyPoses:
        """Choose the fewest poses that keep every frame within MOST_ERROR; `passed` is called by frame.

        share  keep them also within this share of the longest side of the bounds
        """
        low, high = drawn.bounds
        extent = float((high - low).max())
        longest = max(share * extent / MOST_ERROR, 1e-30)
        edges = {n: min(drawn.edge_at(n, drawn.mesh.points_at(n)), longest) for n in drawn.mesh.frames}
        finest = min(edges.values())
        step = max(finest / _STEPS, extent / _LARGEST, 1e-30)
        rounding = 0.5 * math.sqrt(3.0) * step / finest
        numbers, error = _poses(_frames(drawn.mesh, edges, passed), MOST_ERROR - rounding)
        centre = 0.5 * (low + high)
        places, normals = [], []
        for number in numbers:
            points, normal = drawn.frame(number)
            places.append(np.rint((points - centre) / step).astype(np.int32))
            normals.append(normal.astype(np.float32))
        return cls(drawn, numbers, np.stack(places), np.stack(normals), centre, step, error + rounding)

    def points_at(self, number: float) -> Floats:
        """Return positions (W, 3) at a frame or between frames, as players show them."""
        index = min(int(np.searchsorted(self.numbers, number, side="right")), len(self.numbers) - 1)
        before, after = self.numbers[max(index - 1, 0)], self.numbers[index]
        share = (number - before) / (after - before) if after > before else 0.0
        place = (1.0 - share) * self.places[max(index - 1, 0)] + share * self.places[index]
        return np.asarray(self.centre + self.step * place)


_Pose = tuple[int, np.ndarray, float]


def _frames(mesh: OneMesh, edges: dict[int, float], passed: Callable[[], None]) -> Iterator[_Pose]:
    """Yield number, positions float32 (V, 3) and maximum edge length of each frame."""
    for number in mesh.frames:
        yield number, mesh.points_at(number).astype(np.float32), edges[number]
        passed()


def _poses(frames: Iterable[_Pose], most: float) -> tuple[tuple[int, ...], float]:
    """Return the frames to keep, the first and the last among them, and the largest error between them.

    Each span grows until a frame within it would leave the straight line.
    """
    kept: list[int] = []
    span: list[_Pose] = []
    worst = error = 0.0
    for pose in frames:
        if not span:
            kept.append(pose[0])
        elif (longer := _error([*span, pose], most)) <= most:
            error = longer
        else:
            kept.append(span[-1][0])
            worst, error, span = max(worst, error), 0.0, span[-1:]
        span.append(pose)
    if span[-1][0] != kept[-1]:
        kept.append(span[-1][0])
    return tuple(kept), max(worst, error)


def _error(span: list[_Pose], most: float) -> float:
    """Return the largest distance from straight lines between the ends of a span, in edges.

    It ends at the first frame beyond `most`.
    """
    (start, first, _), (end, last, _) = span[0], span[-1]
    worst = 0.0
    for number, points, edge in span[-2:0:-1]:
        apart = first + (last - first) * np.float32((number - start) / (end - start)) - points
        worst = max(worst, math.sqrt(float(np.einsum("ij,ij->i", apart, apart).max())) / edge)
        if worst > most:
            break
    return worst
