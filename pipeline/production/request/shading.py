"""Rendered surfaces of mesh frames: split at creases, diced, and moved within the shutter.

Times are offsets in frames. Within the shot the flow moves the points. Before its first frame and after its
last they move on in a straight line, at the velocity of that end.

Facets of outlines are hidden by cutting the curved patches over the triangles as finely as a picture needs:
it shows a straight edge where the patch over it curves (P37). Half-way along an edge the two are farthest
apart. Where that is less than LEAST pixels no corner shows, and nothing is cut.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from flowsculpt.pipeline.animation import MeshFrame, moved_to_subframe
from flowsculpt.pipeline.arrays import AnyArray, Floats, Indices, Points, Vectors
from flowsculpt.pipeline.mesh import TriangleMesh
from flowsculpt.pipeline.mesh.control_net import bspline_surface, bspline_values
from flowsculpt.pipeline.mesh.normals import (
    MOST_PIECES,
    ShadedMesh,
    split_at_creases,
    spread,
    spread_curved,
    tessellate,
    twins_of,
    vertex_normals,
)
from flowsculpt.pipeline.mesh.placed_copies import COPIES, STARTS, Placements, all_copies, shifted
from flowsculpt.pipeline.production.request.framing import Framing, rotate_y
from flowsculpt.pipeline.resample import Thresholds
from flowsculpt.pipeline.shot import Motion
from flowsculpt.pipeline.shot.motion import VELOCITY_STEP
from flowsculpt.render.base.serialise import from_plain, to_plain
from flowsculpt.render.scene.render_camera import Camera
from flowsculpt.render.scene.render_quality import Quality
from flowsculpt.render.scene.surface import Surface

LEAST = 0.2
"""Pixels between an edge and the patch over it that no one sees."""

SHARE = 0.99
"""Share of the edges that must be so close: a few noisy normals do not justify cutting all."""

MOST_FACET_PIECES, MOST_FACET_FACES = 8, 1_000_000
"""The most pieces of an edge, and the most faces, that are cut for this reason."""

_EDGE = 1.1
"""Edges count up to here from the middle of the picture, in halves of its sides."""


def pieces_without_facets(
    arrays: Mapping[str, AnyArray],
    camera: Camera,
    quality: Quality,
    spin: float,
    around: AnyArray | None = None,
) -> int:
    """Return into how many pieces every edge of a surface is cut, so that its outline has no corners.

    arrays  as `Shading.arrays` returns them
    spin    turn of the subject, radians
    around  points about the axis of whose bounds it turns; by default its own
    """
    faces = arrays["faces"]
    most = min(MOST_FACET_PIECES, math.isqrt(MOST_FACET_FACES // max(1, len(faces))))
    if most < 2:
        return 1
    points = rotate_y(arrays["vertices"], spin, around=around)
    seen = camera.project(points, quality.aspect)
    visible = (seen[:, 2] > camera.near) & (np.abs(seen[:, :2]) <= _EDGE).all(axis=1)
    distances = []
    for corner in range(3):
        a, b = faces[:, corner], faces[:, (corner + 1) % 3]
        counted = (a < b) & visible[a] & visible[b]
        a, b = a[counted], b[counted]
        distances.append(_patch_distance(points, rotate_y(arrays["normals"], spin, True), a, b) / seen[a, 2])
    found = np.concatenate(distances)
    if not len(found):
        return 1
    pixels = float(np.quantile(found, SHARE)) / camera.pixel_size(quality.width)
    return max(1, min(most, math.ceil(math.sqrt(pixels / LEAST) - 1e-6)))


def _patch_distance(points: AnyArray, normals: AnyArray, a: AnyArray, b: AnyArray) -> Floats:
    """Return the distance (N,) of patches from the middle of their edges between vertices a and b (N,)."""
    along = points[b] - points[a]
    out, back = (np.einsum("ij,ij->i", along, normals[v])[:, None] * normals[v] for v in (a, b))
    return np.asarray(np.linalg.norm(out - back, axis=1) / 8.0)


def dice(arrays: Mapping[str, AnyArray], pieces: int, has_pigment: bool = False) -> dict[str, AnyArray]:
    """Return the arrays of a surface whose edges are cut into pieces, on curved patches.

    has_pigment  as of `Shading`
    """
    if pieces == 1:
        return dict(arrays)
    vertices, normals = (arrays[name].astype(np.float64) for name in ("vertices", "normals"))
    shaded = ShadedMesh(vertices, normals, arrays["faces"], arrays["source_vertex"])
    fine = tessellate(shaded, pieces)
    itself = shaded._replace(source_vertex=np.arange(len(vertices), dtype=np.int32))
    cut = {**arrays, **_stored(fine)}
    if "material" in arrays:
        spread_by = spread_curved if has_pigment else spread
        cut["material"] = spread_by(arrays["material"], itself, fine).astype(np.float32)
    if Surface.VALUES in arrays:
        cut[Surface.VALUES] = spread(arrays[Surface.VALUES], itself, fine).astype(np.float32)
    return cut


@dataclass(frozen=True, eq=False)
class Shading:
    """The rendered form of a mesh frame: points, the smooth surface of a control net, or patches of a mesh.

    split   a mesh split at its creases, before dicing; of rigid copies the one that all are copies of
    pieces  into which every edge is diced
    twin    (3F,) half-edges of a mesh, by `twins_of`

    has_pigment  True if rest positions follow curves between vertices too, for borders without corners
    """

    frame: MeshFrame
    split: ShadedMesh | None
    pieces: int
    twin: Indices | None = None
    has_pigment: bool = False

    @classmethod
    def of(cls, frame: MeshFrame, thresholds: Thresholds, pieces: int) -> Shading:
        """Split a mesh at its creases, which the hard angle of the frame's thresholds decides."""
        if frame.is_cloud or frame.lattice is not None:
            return cls(frame, None, pieces)
        twin = twins_of(frame.own)
        split = split_at_creases(frame.own, thresholds.hard_angles(frame.own), twin)
        return cls(frame, split, pieces, twin)

    def cut_for(
        self, camera: Camera, quality: Quality, pixels: float, spin: float, around: AnyArray | None = None
    ) -> Shading:
        """Dice until no edge spans more than so many pixels, with the subject turned by `spin` radians.

        around  points about the axis of whose bounds it turns; by default its own
        """
        if self.frame.is_cloud:
            return self
        uncut = replace(self, pieces=1)._cut(self.frame.own.vertices, self.split)
        vertices, faces = uncut.vertices, uncut.faces
        if (copies := self.frame.copies) is not None:
            vertices, faces = copies.points(vertices), shifted(faces, len(vertices) * np.arange(len(copies)))
        most = MOST_PIECES if self.split else MOST_SPANS
        points = rotate_y(vertices, spin, around=around)
        return replace(self, pieces=pieces_for(points, faces, camera, quality, pixels, most))

    def arrays(self) -> dict[str, AnyArray]:
        """Return the arrays of what is rendered, at the frame itself: of rigid copies those of all."""
        return self.of_all_copies(self.stored())

    def stored(self) -> dict[str, AnyArray]:
        """Return the arrays of the normals file, at the frame itself: of rigid copies one, and placements."""
        if self.frame.copies is not None and self.frame.starts is not None:
            shaded = self._cut(self.frame.own.vertices, self.split)
            placed = {COPIES: self.frame.copies.matrices, STARTS: self.frame.starts.matrices}
            return {**_stored(shaded), **placed}
        material = self.frame.material
        if self.frame.is_cloud:
            points = self.frame.mesh.vertices
            return {
                "vertices": points.astype(np.float32),
                "radii": self.frame.radii.astype(np.float32),
                "source_vertex": np.arange(len(points), dtype=np.int32),
                "material": material.astype(np.float32),
            }
        shaded = self._cut(self.frame.own.vertices, self.split)
        if self.frame.lattice is not None:
            material = bspline_values(material, self.frame.lattice, self.pieces)
        elif self.split is not None and self.has_pigment:
            material = spread_curved(material[self.split.source_vertex], self.split, shaded)
        elif self.split is not None:
            material = spread(material, self.split, shaded)
        named = {"material": material}
        if self.split is not None and Surface.VALUES in self.frame.own.attributes:
            named[Surface.VALUES] = spread(self.frame.own.attributes[Surface.VALUES], self.split, shaded)
        return {**_stored(shaded), **{name: each.astype(np.float32) for name, each in named.items()}}

    @staticmethod
    def of_all_copies(stored: Mapping[str, AnyArray]) -> dict[str, AnyArray]:
        """Return the arrays of all copies of what `stored` returns."""
        return all_copies(stored)

    def at(self, points: Points) -> tuple[Points, Vectors | None]:
        """Return vertices and normals, float64, with the vertices of the mesh moved to `points`.

        Points have no normals. Creases stay where they were, and normals turn as the faces around them do.
        """
        if self.frame.is_cloud:
            return points, None
        shaded = self._cut(points, None if self.split is None else self._turned(points, self.split))
        return shaded.vertices, shaded.normals

    def speeds(self, motion: Motion) -> AnyArray:
        """Return the speed of the vertices, (V, 1) float32, scene units per second."""
        velocity = self.moved_by(motion).velocity()
        return np.asarray(np.linalg.norm(velocity, axis=1, keepdims=True), dtype=np.float32)

    def moved_by(self, motion: Motion) -> SurfaceMotion:
        """Return the movement of what is rendered: the mesh of a shot's frame, moved by its flow."""
        if self.frame.copies is None:
            return _moved_by_flow(motion, self.frame, self.at)
        one = self.at(self.frame.own.vertices)
        return _moved_by_flow(motion, self.frame, lambda matrices: _copies_of(one, matrices))

    @staticmethod
    def vertex_motion(motion: Motion, frame: MeshFrame) -> SurfaceMotion:
        """Return the movement of the vertices of a shot's mesh frame, without normals."""
        if frame.copies is None:
            return _moved_by_flow(motion, frame, lambda points: (points, None))
        return _moved_by_flow(
            motion, frame, lambda matrices: _copies_of((frame.own.vertices, None), matrices)
        )

    def _cut(self, points: Points, split: ShadedMesh | None) -> ShadedMesh:
        if split is not None:
            return tessellate(split, self.pieces, self.twin)
        assert self.frame.lattice is not None, "a surface without faces is a net"
        return bspline_surface(points, self.frame.lattice, self.pieces)

    def _turned(self, points: Points, split: ShadedMesh) -> ShadedMesh:
        """Return the split mesh at other points; its normals turn as those of its faces do."""
        vertices = points[split.source_vertex]
        now, before = (vertex_normals(TriangleMesh(v, split.faces)) for v in (vertices, split.vertices))
        normals = split.normals + (now - before)
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        turned = np.where(lengths > 0.1, normals / np.maximum(lengths, 0.1), now)
        return split._replace(vertices=vertices, normals=turned)


def _stored(shaded: ShadedMesh) -> dict[str, AnyArray]:
    """Return the arrays of a shaded surface as they are stored, without material positions."""
    return {
        "vertices": shaded.vertices.astype(np.float32),
        "normals": shaded.normals.astype(np.float32),
        "faces": shaded.faces,
        "source_vertex": shaded.source_vertex,
    }


# Dicing

MOST_FACES = 4_000_000
"""The most faces of a diced frame."""

MOST_SPANS = 256
"""Pieces of a span between two control points of a net."""


def pieces_for(
    points: AnyArray, faces: AnyArray, camera: Camera, quality: Quality, pixels: float, most: int
) -> int:
    """Return into how many pieces every edge is cut, so that each spans at most so many pixels.

    points  (V, 3) of the uncut surface, scene units
    faces   (F, 3)

    Edges behind the lens or outside the picture do not count. `most` at most, and few enough for MOST_FACES.
    """
    wanted = math.ceil(_longest_edge(points, faces, camera, quality) / pixels - 1e-9)
    return max(1, min(wanted, most, math.isqrt(MOST_FACES // max(1, len(faces)))))


def _longest_edge(points: AnyArray, faces: AnyArray, camera: Camera, quality: Quality) -> float:
    """Return the longest edge in the picture, pixels in its middle; 0 where there is none."""
    seen = camera.project(points, quality.aspect)
    within = (seen[:, 2] > camera.near) & (np.abs(seen[:, :2]) <= _EDGE).all(axis=1)
    if camera.projection.is_wide:  # a spherical picture stretches what is above and below, and has a seam
        pixels = (points - camera.origin) / (np.abs(seen[:, 2:]) * camera.pixel_size(quality.width))
    else:
        pixels = seen[:, :2] * (quality.width / 2.0, quality.height / 2.0)
    longest = 0.0
    for corner in range(3):
        a, b = faces[:, corner], faces[:, (corner + 1) % 3]
        counted = within[a] & within[b]
        if counted.any():
            longest = max(longest, float(np.linalg.norm((pixels[a] - pixels[b])[counted], axis=1).max()))
    return longest


# Motion within the shutter

Shown = tuple[Points, Vectors | None]


@dataclass(frozen=True, eq=False)
class SurfaceMotion:
    """The vertices and normals of a picture as a function of the offset in frames; `at(0)` is the picture.

    fps            frames per second
    begins, ends   True at the first frame, and at the last
    """

    at: Callable[[float], Shown]
    fps: float
    begins: bool = False
    ends: bool = False

    def displacement(self, offset: float) -> Vectors:
        """Return the displacement from offset 0, (V, 3) scene units."""
        return np.asarray(self.at(offset)[0] - self.at(0.0)[0])

    def velocity(self) -> Vectors:
        """Return velocities, (V, 3) scene units per second: central differences, one-sided at the ends."""
        if self.begins or self.ends:
            step = -VELOCITY_STEP if self.begins else VELOCITY_STEP
            return self.displacement(step) * (self.fps / step)
        return np.asarray(
            (self.at(VELOCITY_STEP)[0] - self.at(-VELOCITY_STEP)[0]) * (0.5 * self.fps / VELOCITY_STEP)
        )


def _copies_of(one: Shown, matrices: Floats) -> Shown:
    """Return the vertices and normals of all copies of one, with the matrices of their placements."""
    (points, normals), placements = one, Placements(matrices)
    return placements.points(points), None if normals is None else placements.directions(normals)


def _moved_by_flow(motion: Motion, frame: MeshFrame, shown: Callable[[Floats], Shown]) -> SurfaceMotion:
    """Return the movement of what `shown` makes of the vertices of a frame, or the matrices of its copies."""
    first, last = motion.frames.first, motion.frames.last

    def placed(offset: float) -> Floats:
        inside = min(max(frame.number + offset, first), last)
        if inside != frame.number + offset:
            return _movable(frame) + offset * _end_velocity(motion, frame)
        return _movable(frame if offset == 0.0 else moved_to_subframe(motion, frame, inside))

    fps = float(motion.rate.fps)
    return SurfaceMotion(lambda o: shown(placed(o)), fps, frame.number == first, frame.number == last)


def _movable(frame: MeshFrame) -> Floats:
    """Return what the flow moves: vertices (V, 3), or the matrices (N, 3, 4) of rigid copies."""
    return frame.own.vertices if frame.copies is None else frame.copies.matrices


def turning_motion(
    vertices: Points,
    normals: Vectors | None,
    spin: float,
    turn: float,
    fps: float,
    around: AnyArray | None = None,
) -> SurfaceMotion:
    """Return the movement of a mesh frame at `spin` radians, which turns by `turn` radians a picture.

    around  points about the axis of whose bounds it turns; by default the vertices
    """

    def at(offset: float) -> Shown:
        angle = spin + offset * turn
        turned_normals = None if normals is None else rotate_y(normals, angle, about_origin=True)
        return np.asarray(rotate_y(vertices, angle, around=around), np.float64), turned_normals

    return SurfaceMotion(at, fps)


def _end_velocity(motion: Motion, frame: MeshFrame) -> Floats:
    """Return the change per frame of what moves, at an end: a one-sided second-order difference."""
    now = _movable(frame)
    if motion.frames.first == motion.frames.last:
        return np.zeros_like(now)
    step = VELOCITY_STEP if frame.number == motion.frames.first else -VELOCITY_STEP
    near, far = (_movable(moved_to_subframe(motion, frame, frame.number + k * step)) for k in (1, 2))
    return np.asarray((4.0 * near - far - 3.0 * now) / (2.0 * step))


def framing_at(framings: Mapping[int, Framing], number: int, offset: float) -> Framing:
    """Interpolate camera and stage linearly to the next frame; extrapolate beyond the first and the last."""
    if offset == 0.0:
        return framings[number]
    ahead = 1 if offset > 0.0 else -1
    share = abs(offset)
    if number + ahead not in framings:
        ahead, share = -ahead, -share
    if number + ahead not in framings:
        return framings[number]
    one, other = to_plain(framings[number]), to_plain(framings[number + ahead])
    return from_plain(Framing, _mix(one, other, share))


def _mix(one: Any, other: Any, share: float) -> Any:
    """Interpolate the numbers in two pieces of plain data of one form; the rest stays that of the first."""
    if isinstance(one, dict):
        return {name: _mix(value, other[name], share) for name, value in one.items()}
    if isinstance(one, list | tuple):
        return [_mix(a, b, share) for a, b in zip(one, other, strict=True)]
    is_number = isinstance(one, float) and isinstance(other, float)
    return one + share * (other - one) if is_number else one
