"""`python -m benchmarks.normals`: shading normals against exact ones, and their change by resampling.

Two films that are hard on normals run through the frame loop with exact placement: the Enright deformation,
there and back, and a ball in the Lorenz attractor. The exact normal at a vertex is that of the ball at rest,
pulled back along the flow. Prints a table; writes `benchmarks/out/normals.json`.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from flowsculpt.pipeline.animation import MeshFrame, animate
from flowsculpt.pipeline.arrays import AnyArray, Floats, Indices, Points, Vectors
from flowsculpt.pipeline.flow import Flow, Streamlines
from flowsculpt.pipeline.flow.catalogue.basic import Enright
from flowsculpt.pipeline.flow.catalogue.lorenz import Lorenz
from flowsculpt.pipeline.flow.flow_map import FrameStep
from flowsculpt.pipeline.frames import FrameRange, FrameRate
from flowsculpt.pipeline.mesh import ShadedMesh, TriangleMesh, icosphere, split_at_creases, vertex_normals
from flowsculpt.pipeline.mesh.analytic_surfaces import AnalyticSurface, SphereSurface
from flowsculpt.pipeline.mesh.normals import carried_normals, tangents, trusted_normals, unit
from flowsculpt.pipeline.resample import Thresholds
from flowsculpt.pipeline.shot import Motion, Resampling
from flowsculpt.pipeline.shot.subjects import Subject

OUT = Path(__file__).parent / "out"
EVERY = 10
"""Frames between comparisons with exact normals, whose pull-back is slow."""

GLOSS = 200
"""Exponent of the highlight (Blinn 1977): half as bright at 4.8° off its middle."""

Row = dict[str, float | str]


@dataclass(frozen=True)
class Sizzle:
    """Jump of the shading that one resampling causes at the vertices that stay (P38).

    shading  rms jump of the rendered normals, radians
    surface  rms jump of the mean face normals, radians
    share    of the earlier vertices that stay, 0 to 1
    """

    shading: float
    surface: float
    share: float


def sizzle(
    before: TriangleMesh, shaded_before: ShadedMesh, after: TriangleMesh, shaded_after: ShadedMesh
) -> Sizzle:
    """Return the jump from a surface after a move to the same surface after resampling.

    Vertices at creases, which have several normals, are left out of the shading.
    """
    old, new = surviving(before, after)
    surface = _angles(vertex_normals(before)[old], vertex_normals(after)[new])
    whole = undivided(shaded_before)[old] & undivided(shaded_after)[new]
    shading = _angles(shaded_before.normals[old[whole]], shaded_after.normals[new[whole]])
    return Sizzle(_rms(shading), _rms(surface), len(old) / len(before.vertices))


def surviving(before: TriangleMesh, after: TriangleMesh) -> tuple[Indices, Indices]:
    """Return the indices of vertices at the same position, bit for bit, in both meshes."""
    one, other = (np.ascontiguousarray(mesh.vertices + 0.0).view("V24").ravel() for mesh in (before, after))
    _, old, new = np.intersect1d(one, other, return_indices=True)
    return old.astype(np.int32), new.astype(np.int32)


def undivided(shaded: ShadedMesh) -> AnyArray:
    """Return flags (V,) of the vertices with a single normal."""
    return np.bincount(shaded.source_vertex) == 1


def _angles(one: Vectors, other: Vectors) -> Floats:
    """Return the angles between unit vectors (N, 3), radians; half chords keep the digits of small ones."""
    return 2 * np.arcsin(np.minimum(0.5 * np.linalg.norm(one - other, axis=1), 1.0))


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0


@dataclass(frozen=True)
class Ball(Subject, AnalyticSurface):
    """A geodesic sphere about a centre, which is also its own true surface."""

    frequency: int
    radius: float
    centre: tuple[float, float, float]

    def build(self, max_edge_length: float | None = None) -> TriangleMesh:
        return icosphere(self.frequency, self.radius, self.centre)

    @property
    def project(self) -> AnalyticSurface:
        return self

    @cached_property
    def _sphere(self) -> SphereSurface:
        return SphereSurface(self.radius)

    def __call__(self, points: Points) -> Points:
        on: Points = self._sphere(points - np.array(self.centre)) + np.array(self.centre)
        return on

    def normals(self, points: Points) -> Vectors:
        return self._sphere.normals(points - np.array(self.centre))


def films() -> dict[str, Motion]:
    """Return the films: 150 frames of 1/50 s, and 120 of 1/240 s."""
    enright = Streamlines(Enright((0.5, 0.5, 0.5), scale=1.0, period=3.0))
    lorenz = Streamlines(Lorenz(scale=1.0, time_scale=1.0))
    return {
        "enright": _film(Ball(16, 0.15, (0.35, 0.35, 0.35)), enright, 150, 50, 0.02),
        "lorenz": _film(Ball(32, 6.0, (3.0, -5.0, -5.0)), lorenz, 120, 240, 0.345),
    }


def _film(ball: Ball, flow: Flow, frames: int, rate: int, longest: float) -> Motion:
    resampling = Resampling(Thresholds(longest))
    return Motion(FrameRange.parse(f"0-{frames}"), FrameRate.of(rate), ball, flow, resampling)


def main() -> None:
    """Measure both films; write the numbers."""
    rows = [measure(name, motion) for name, motion in films().items()]
    OUT.mkdir(exist_ok=True)
    (OUT / "normals.json").write_text(json.dumps(rows, indent=1) + "\n")
    for name in rows[0]:
        print(f"{name:>38}" + "".join(f"{_cell(row[name]):>12}" for row in rows))
    print("\nlargest error of one frame, degrees, by the step of the differences")
    for step in (1e-5, 1e-6, 1e-7, 1e-8, 1e-9):
        print(f"{step:>38}" + "".join(f"{step_error(m, step):>12.2g}" for m in films().values()))


def step_error(motion: Motion, step: float) -> float:
    """Return the largest error, degrees, of the ball's normals after one frame.

    The Jacobian is found by two-sided differences at two distances (Richardson 1911).
    """
    ball, (time, dt) = motion.mesh_at_rest(), motion.clock.step(motion.frames.first + 1)
    assert isinstance(motion.subject, Ball)
    points, normals = ball.vertices, motion.subject.normals(ball.vertices)
    size = float(np.ptp(points, axis=0).max())

    def move(these: Points) -> Points:
        return motion.flow.displace(these, time, dt)

    def along(t: Vectors, h: float) -> Vectors:
        return (move(points + h * t) - move(points - h * t)) / (2 * h)

    one, two = ((4 * along(t, 1e-4 * size) - along(t, 2e-4 * size)) / 3 for t in tangents(normals))
    apart = np.full(len(points), step * size)
    carried = carried_normals(move, points, move(points), normals, apart)
    return math.degrees(angles(carried, unit(np.cross(one, two))).max())


def measure(name: str, motion: Motion) -> Row:
    """Return the errors at every EVERY-th frame together, and the jumps of every resample; degrees."""
    carried, weighted, overruled, vertices = [], [], 0, 0
    jumps: list[tuple[float, ...]] = []
    for before, frame in resamples(motion):
        after = frame.mesh
        jumps.append(_jumps(before, after))
        if frame.number % EVERY:
            continue
        exact = exact_normals(motion, frame)
        shaded = split_at_creases(after)
        carried.append(angles(shaded.normals[: len(exact)], exact))
        weighted.append(angles(area_weighted(after), exact))
        overruled += int((~trusted_normals(after)).sum())
        vertices += len(exact)
    good, usual = np.degrees(np.concatenate(carried)), np.degrees(np.concatenate(weighted))
    shading, surface, area, glint, glint_area = np.sqrt(np.mean(np.square(jumps), axis=0))
    return {
        "degrees": name,
        "error, carried: median": float(np.median(good)),
        "95%": float(np.quantile(good, 0.95)),
        "error, area-weighted: median": float(np.median(usual)),
        "95% ": float(np.quantile(usual, 0.95)),
        "ratio of medians: 1 /": float(np.median(usual) / np.median(good)),
        "ratio of 95%: 1 /": float(np.quantile(usual, 0.95) / np.quantile(good, 0.95)),
        "jump at a resample, carried: rms": math.degrees(shading),
        "angle-weighted": math.degrees(surface),
        "area-weighted": math.degrees(area),
        "flicker of a highlight, carried: %": 100 * glint,
        "area-weighted ": 100 * glint_area,
        "% where the geometry decides": 100 * overruled / vertices,
    }


def resamples(motion: Motion) -> Iterator[tuple[TriangleMesh, MeshFrame]]:
    """Yield every frame but the first, with the surface moved into it before it is resampled."""
    last = None
    for frame in animate(motion):
        if last is not None:
            step = FrameStep(motion.flow, *motion.clock.step(frame.number), frame.number)
            moved, normals = step.apply(last.vertices), last.attributes["normal"]
            normals = carried_normals(step.apply, last.vertices, moved, normals)
            yield last.with_vertices(moved).with_attributes(normal=normals), frame
        last = frame.mesh


def _jumps(before: TriangleMesh, after: TriangleMesh) -> tuple[float, ...]:
    """Return rms jumps over the vertices that stay.

    Radians of shading normals, of the surface's and of area-weighted ones; then of a highlight's brightness,
    shaded with the first and the last.
    """
    shaded = [split_at_creases(mesh) for mesh in (before, after)]
    told = sizzle(before, shaded[0], after, shaded[1])
    plain = [
        ShadedMesh(
            mesh.vertices, area_weighted(mesh), mesh.faces, np.arange(len(mesh.vertices), dtype=np.int32)
        )
        for mesh in (before, after)
    ]
    usual = sizzle(before, plain[0], after, plain[1])
    return (
        told.shading,
        told.surface,
        usual.shading,
        _flicker(before, after, shaded),
        _flicker(before, after, plain),
    )


def _flicker(before: TriangleMesh, after: TriangleMesh, shaded: list[ShadedMesh]) -> float:
    """Return the rms jump of a highlight's brightness over its rms brightness, at the vertices that stay."""
    old, new = surviving(before, after)
    whole = undivided(shaded[0])[old] & undivided(shaded[1])[new]
    old, new = old[whole], new[whole]
    was, now = highlight(shaded[0].normals[old]), highlight(shaded[1].normals[new])
    return float(np.sqrt(np.mean((now - was) ** 2) / np.mean(was**2)))


def highlight(normals: Vectors) -> Floats:
    """Return the brightness (N,) of a glossy surface under a ring of eight lights: some always glint."""
    turn = 2 * np.pi * np.arange(8) / 8
    halves = unit(np.column_stack([np.cos(turn), np.sin(turn), np.full(8, 1.5)]))
    glints: Floats = (np.maximum(normals @ halves.T, 0.0) ** GLOSS).sum(axis=1)
    return glints


def exact_normals(motion: Motion, frame: MeshFrame) -> Vectors:
    """Return the normals (V, 3) of the ball at rest, pulled back along the flow.

    They are Bᵀ n with B the Jacobian of the inverse flow, by two-sided differences over 1e-4 of an edge.
    """
    assert isinstance(motion.subject, Ball) and motion.resampling is not None
    points, longest = frame.mesh.vertices, motion.resampling.thresholds.max_edge_length
    assert isinstance(longest, float)
    h = 1e-4 * longest
    asked = np.concatenate([points + sign * h * axis for axis in np.eye(3) for sign in (1, -1)] + [points])
    ahead = np.split(back(motion, frame.number, asked), 7)
    at_rest = motion.subject.normals(ahead[6])
    gradient = [np.einsum("ij,ij->i", ahead[2 * k] - ahead[2 * k + 1], at_rest) for k in range(3)]
    return unit(np.column_stack(gradient))


def back(motion: Motion, number: int, points: Points) -> Points:
    """Return the rest positions of points (N, 3) of a frame."""
    for frame in range(number, motion.frames.first, -1):
        start, dt = motion.clock.step(frame)
        points = motion.flow.displace(points, start + dt, -dt)
    return points


def area_weighted(mesh: TriangleMesh) -> Vectors:
    """Return vertex normals (V, 3): the mean of the adjacent faces' normals, weighted by area."""
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    doubled = np.cross(b - a, c - a)
    corners = mesh.faces.reshape(-1)
    sums = [np.bincount(corners, np.repeat(doubled[:, k], 3), len(mesh.vertices)) for k in range(3)]
    return unit(np.column_stack(sums))


def angles(one: Vectors, other: Vectors) -> Floats:
    """Return the angles (N,) between vectors, radians."""
    sine, cosine = np.linalg.norm(np.cross(one, other), axis=1), np.einsum("ij,ij->i", one, other)
    between: Floats = np.arctan2(sine, cosine)
    return between


def _cell(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:.4g}"


if __name__ == "__main__":
    main()
