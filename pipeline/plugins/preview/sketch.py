"""One frame of a shot as a quick picture, with edges, streamlines and burn-ins over it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flowsculpt import TriangleMesh, icosphere
from flowsculpt.api.frames import Framing, RenderRequest
from flowsculpt.api.materials import Material, PaintedFaces, Surface
from flowsculpt.api.meshes import Floats
from flowsculpt.api.pictures import BurnIn, Shape, draw_preview
from flowsculpt.api.shots import Motion
from flowsculpt.pipeline.plugins.preview.holes import without_holes

MOST_BALLS = 20_000
"""Most points of a cloud that are drawn; of more points a part is drawn, with larger balls."""

QUICK_VERTICES = 60_000
"""Vertices of all balls of a quick picture, about; where balls are many, each is an octahedron."""

OCTAHEDRON = TriangleMesh(
    np.concatenate([np.eye(3), -np.eye(3)]),
    [[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]],
)

LINE = 1 / 600  # width of a streamline, over that of the picture

OF_SURFACE = {"vertices", "normals", "faces", "source_vertex", "material", "radii"}
"""Arrays of a frame besides the attributes of its vertices."""

SLOW, MIDDLE, FAST = (0.10, 0.36, 0.56), (0.86, 0.63, 0.16), (0.80, 0.24, 0.14)
"""Display colours of streamlines, from still to the fastest."""


@dataclass(frozen=True)
class Sketch:
    """The style in which frames of a shot are drawn.

    flow    draw streamlines
    edges   draw the edges of faces
    closed  True if no surface has a boundary, so that inner sides are never seen
    quick   draw points as coarse balls
    rough   let outlines show steps, which takes about half the time
    """

    request: RenderRequest
    flow: bool = False
    edges: bool = False
    burn_in: BurnIn | None = None
    closed: bool = False
    quick: bool = False
    rough: bool = False

    def picture(
        self,
        number: int,
        surfaces: Sequence[Mapping[str, np.ndarray]],
        framing: Framing,
        size: tuple[int, int],
        display: str,
    ) -> NDArray[Any]:
        """Draw a frame from the arrays of each subject, uint8 (H, W, 3). Raises FrameError."""
        picture, parts = self.request.pictures.of(number), self.request.parts
        shapes = [
            shape_of(
                {**arrays, **_copy_places(part, number, arrays)},
                look := part.pictures.of(number).look,
                self.quick,
                _paint(part, number, arrays),
            )._replace(closed=self.closed and not look.has_opacity)
            for arrays, part in zip(surfaces, parts, strict=True)
        ]
        lines = None
        if self.flow:
            streams = self._streamlines(number, surfaces)
            lines = streams.points, *line_colours(streams)
        pixels = draw_preview(
            shapes,
            picture,
            framing,
            size,
            display,
            has_edges=self.edges,
            lines=lines,
            line_width=LINE,
            is_rough=self.rough,
        )
        return pixels if self.burn_in is None else self.burn_in.over(pixels, self._facts(number))

    def path(self, at: int | None = None) -> Path:
        """Return the path of the movie, or of a still of frame `at`, relative to the root."""
        request, name = self.request, self.request.name
        mark = ".flow" * self.flow + ".edges" * self.edges
        part = "" if request.is_whole else f".{min(request.requested)}-{max(request.requested)}"
        file = f"{name}{part}{mark}.mp4" if at is None else f"{name}.{at:04d}{mark}.png"
        return request.folders.home / "preview" / file

    def _streamlines(self, number: int, surfaces: Sequence[Mapping[str, np.ndarray]]) -> StreamlineSet:
        """Return the streamlines around the surfaces of all subjects."""
        each = [
            streamlines(part.shot.motion, number, arrays["vertices"].astype(np.float64))
            for arrays, part in zip(surfaces, self.request.parts, strict=True)
        ]
        points, speeds = zip(*each, strict=True)
        return StreamlineSet(np.concatenate(points), np.concatenate(speeds))

    def _facts(self, number: int) -> dict[str, str | int]:
        code, key = self.request.shot.rate.timecode(number), self.request.keys.mesh(number)[:8]
        facts: dict[str, str | int] = {"shot": self.request.name, "frame": number, "timecode": code}
        return {**facts, "quality": "preview", "key": key}


def _paint(part: RenderRequest, number: int, arrays: Mapping[str, np.ndarray]) -> PaintedFaces | None:
    """Return what a subject has on its faces, where its look shows it."""
    if not part.pictures.of(number).look.shows_paint or "faces" not in arrays:
        return None
    return part.shot.motion.painted(arrays["material"].astype(np.float64), arrays["faces"])


def _copy_places(part: RenderRequest, number: int, arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the vertex attribute of a subject that a colour for each copy needs."""
    rest = arrays["material"].astype(np.float64)
    return part.shot.motion.copy_places(part.pictures.of(number).look.pattern, rest)


def shape_of(
    arrays: Mapping[str, np.ndarray], look: Material, quick: bool = False, paint: PaintedFaces | None = None
) -> Shape:
    """Return the shape of a frame's arrays; of a cloud, a ball for each point, which is coarse if `quick`."""
    attributes = {name: values for name, values in arrays.items() if name not in OF_SURFACE}
    vertices, no_faces = arrays["vertices"], np.empty((0, 3), np.int32)
    normals, faces = arrays.get("normals", vertices), arrays.get("faces", no_faces)
    surface = Surface(vertices, normals, faces, attributes, arrays["material"], paint=paint)
    if look.is_of_model and look.has_opacity and paint is not None:
        surface = without_holes(surface, look, paint)
        vertices, normals, faces = surface.vertices, surface.normals, surface.faces
    if "radii" not in arrays:
        return Shape.of(surface, look)
    colours = look.vertex_colours(surface)
    step = -(-len(vertices) // MOST_BALLS)
    points, radii = vertices[::step], arrays["radii"][::step] * step ** (1 / 3)
    ball = _quick_ball(len(points)) if quick else icosphere(2)
    count = len(ball.vertices)
    vertices = (points[:, None] + radii[:, None, None] * ball.vertices).reshape(-1, 3)
    faces = (ball.faces + count * np.arange(len(points), dtype=np.int32)[:, None, None]).reshape(-1, 3)
    colours = None if colours is None else colours[::step].repeat(count, axis=0)
    normals = ball.vertices / np.linalg.norm(ball.vertices, axis=1, keepdims=True)
    return Shape(vertices, np.tile(normals, (len(points), 1)), faces.astype(np.int32), look, colours)


@lru_cache(maxsize=16)
def _quick_ball(count: int) -> TriangleMesh:
    """Return a ball to be drawn at so many points, with the mean outline of a sphere of radius 1.

    The mean area of a convex solid's shadows is a quarter of its surface (Cauchy).
    """
    fits = (ball for ball in (icosphere(2), icosphere(1)) if len(ball.vertices) * count <= QUICK_VERTICES)
    ball = next(fits, OCTAHEDRON)
    return ball.with_vertices(ball.vertices * (4.0 * np.pi / ball.areas.sum()) ** 0.5)


def is_closed(arrays: Mapping[str, np.ndarray]) -> bool:
    """Tell whether every edge of a surface has two faces, which then holds for every frame of a shot."""
    if "faces" not in arrays:
        return True
    faces, count = arrays["source_vertex"][arrays["faces"]], int(arrays["source_vertex"].max()) + 1
    ends, others = faces.astype(np.int64).ravel(), np.roll(faces, -1, axis=1).astype(np.int64).ravel()
    forward, backward = np.sort(ends * count + others), np.sort(others * count + ends)
    return bool(np.array_equal(forward, backward) and (np.diff(forward) > 0).all())


def line_colours(lines: StreamlineSet) -> tuple[Floats, Floats]:
    """Return colours (N, K, 3) by speed, and opacities (N, K) that fade at both ends."""
    fast = float(np.quantile(lines.speeds, 0.95)) if lines.speeds.size else 1.0
    share = np.clip(lines.speeds / max(fast, 1e-300), 0.0, 1.0)
    stops = np.array([SLOW, MIDDLE, FAST])
    colours = np.stack([np.interp(share, (0.0, 0.5, 1.0), stops[:, k]) for k in range(3)], axis=-1)
    along = np.linspace(0.0, np.pi, lines.speeds.shape[1])
    return colours, np.clip(np.sin(along), 0.0, 1.0)[None] ** 0.7 * (0.4 + 0.55 * share)


STEP = 1 / 16
"""Frames over which points are moved to measure velocity, which flows that are maps do not have."""

SEEDS, PIECES = 420, 48
SEED_BOX = 1.35  # half-size of the box where streamlines begin, over that of the subject

LENGTH = 0.6  # length of streamlines of median speed, over the subject's half-size
MOST_SPEED = 2.5  # upper bound of speed along a streamline, over the median speed
STILL = 0.02  # fraction of the 95th percentile of speed below which no streamline begins


class StreamlineSet(NamedTuple):
    """N polylines: points (N, PIECES + 1, 3) and speeds (N, PIECES + 1), units per second."""

    points: Floats
    speeds: Floats


def streamlines(motion: Motion, frame: int, vertices: Floats) -> StreamlineSet:
    """Trace streamlines of all flows of a shot together, held still at a frame, around vertices (V, 3).

    Raises FrameError where the flow fails.
    """
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    middle, half = (low + high) / 2, np.maximum((high - low) / 2, 0.15 * float((high - low).max()))
    begin = middle + SEED_BOX * half * (2.0 * _even_points(SEEDS) - 1.0)
    speeds = np.linalg.norm(_velocity(motion, frame, begin), axis=1)
    fast = float(np.quantile(speeds, 0.95))
    begin = begin[speeds > STILL * fast]
    if not len(begin) or fast == 0.0:
        return StreamlineSet(np.empty((0, PIECES + 1, 3)), np.empty((0, PIECES + 1)))
    median = float(np.median(speeds[speeds > STILL * fast]))
    step = LENGTH * float(half.max()) / median / PIECES
    forward, backward = (_trace(motion, frame, begin, sign * step, MOST_SPEED * median) for sign in (1, -1))
    points = np.concatenate([backward[:0:-1], forward]).swapaxes(0, 1)
    points = points[np.isfinite(points).all(axis=(1, 2))]
    speeds = np.linalg.norm(np.diff(points, axis=1), axis=2) / step
    return StreamlineSet(points, np.concatenate([speeds[:, :1], speeds], axis=1))


def _velocity(motion: Motion, frame: int, points: Floats) -> Floats:
    """Return velocities (N, 3), units per second of the film's time."""
    moved = motion.carry(points, frame, frame + STEP)
    return (moved - points) / motion.rate.seconds(STEP)


def _trace(motion: Motion, frame: int, points: Floats, step: float, limit: float) -> Floats:
    """Trace points by the midpoint method at most at speed `limit`; returns (PIECES / 2 + 1, N, 3)."""

    def velocity(points: Floats) -> Floats:
        vectors = _velocity(motion, frame, points)
        speed = np.linalg.norm(vectors, axis=1, keepdims=True)
        return np.asarray(vectors * np.minimum(1.0, limit / np.maximum(speed, 1e-300)))

    path = [points]
    for _ in range(PIECES // 2):
        middle = path[-1] + step / 2 * velocity(path[-1])
        path.append(path[-1] + step * velocity(middle))
    return np.stack(path)


def _even_points(count: int) -> Floats:
    """Return points (N, 3) spread evenly over the unit cube: the additive recurrence of Roberts (2018)."""
    root = 1.2207440846057596  # of x⁴ = x + 1
    steps = root ** -np.arange(1.0, 4.0)
    return (0.5 + np.arange(1, count + 1)[:, None] * steps) % 1.0
