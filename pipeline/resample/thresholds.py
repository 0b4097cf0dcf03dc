"""Thresholds of resampling: numbers or functions over the surface (P35), triangle shape (P36), creases.

Functions for edge length go by distance to a camera, by curvature, or by a formula (P26). Creases are edges
that stay hard whatever becomes of them, by their angle at rest or by their position (P31).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Protocol, cast, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from flowsculpt.pipeline.arrays import AnyArray, Faces, Floats, Indices, Points, Vectors
from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.formula import PLACE, TIME, Expression, time_values
from flowsculpt.pipeline.mesh.meshes import PolygonMesh, TriangleMesh
from flowsculpt.pipeline.mesh.normals import NORMAL, angles_between, dihedral_angles, split_at_creases
from flowsculpt.pipeline.resample.kernels.edge_scans import edge_curvature, limit_gradation
from flowsculpt.render.base.serialise import OMIT_DEFAULT

SHORT = 0.4  # share of the finest edge, below which the curvature of an edge is noise
FORMULA_NAMES = (*PLACE, *TIME)  # names that a formula may use


@dataclass(frozen=True)
class DistanceToCamera:
    """Edges of constant size in the picture: their length grows with the distance from the camera.

    position          of the camera, scene units
    pixels            length of an edge across the line of sight, in the picture
    field_of_view     radians, horizontal
    width             of the picture, in pixels
    finest, coarsest  bounds, scene units

    At distance d the edge length is 2 d tan(field_of_view / 2) / width × pixels.
    """

    position: tuple[float, float, float]
    pixels: float
    finest: float
    coarsest: float
    field_of_view: float = math.radians(26)
    width: float = 1920.0

    def __post_init__(self) -> None:
        _require_order(self.finest, self.coarsest)
        if not 0 < self.field_of_view < math.pi:
            raise UsageError(f"field_of_view {self.field_of_view:g} must lie between 0 and pi radians")
        if not (self.pixels > 0 and self.width > 0):
            raise UsageError(f"{self.pixels:g} pixels of a width of {self.width:g}: both must be above 0")

    def __call__(self, mesh: TriangleMesh) -> Floats:
        """Return edge lengths (V,), scene units."""
        distance = np.linalg.norm(mesh.vertices - np.array(self.position), axis=1)
        pixel = 2.0 * math.tan(0.5 * self.field_of_view) / self.width
        return np.clip(self.pixels * pixel * distance, self.finest, self.coarsest)


@dataclass(frozen=True)
class Curvature:
    """Edges that leave the surface by no more than a tolerance (Herzen & Barr 1987).

    tolerance         the chord height, scene units: distance of an edge's middle from the surface
    finest, coarsest  bounds for the edges, scene units
    hard_angle        radians: an edge that turns by more is a crease, not curvature, unless exact normals
                      say otherwise; pi for surfaces without creases

    A chord of length h under an arc of curvature κ has the height κh²/8, so h = sqrt(8 tolerance / κ). κ is
    measured along edges, from the change of the normal between their ends: exact normals if the mesh has them
    (attribute `normal`), else means over the surrounding faces, separate for each side of a crease. At the
    rim of a thin sheet the normal turns within an edge as long as the sheet is thick: the rim is refined
    however thin it becomes, down to `finest`.
    """

    tolerance: float
    finest: float
    coarsest: float
    hard_angle: float = math.radians(40)

    def __post_init__(self) -> None:
        _require_order(self.finest, self.coarsest)
        if not (math.isfinite(self.tolerance) and self.tolerance > 0):
            raise UsageError(f"tolerance {self.tolerance:g} must be a positive length in scene units")
        if not 0 < self.hard_angle <= math.pi:
            raise UsageError(f"hard_angle {self.hard_angle:g} must lie between 0 and pi radians")

    def __call__(self, mesh: TriangleMesh) -> Floats:
        """Return edge lengths (V,), scene units."""
        bent = curvature(mesh, self.hard_angle, SHORT * self.finest)
        flat = 8.0 * self.tolerance / self.coarsest**2
        return np.maximum(np.sqrt(8.0 * self.tolerance / np.maximum(bent, flat)), self.finest)


@dataclass(frozen=True)
class ThresholdFormula:
    """A threshold as a formula over position and time: `0.02 + 0.01 * abs(y)`.

    text         see `flowsculpt.pipeline.formula`; raises FormulaError for a wrong one
    unit         factor on its value: radians a degree, for angles written in degrees
    frame, time  the current frame and its time in seconds, if the formula uses them
    """

    text: str
    unit: float = 1.0
    frame: int | None = None
    time: float | None = None
    expression: Expression = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "expression", Expression(self.text, FORMULA_NAMES))

    def at(self, frame: int, time: float) -> ThresholdFormula:
        """Return the formula with its frame and time filled in; itself if it uses neither."""
        used = self.expression.uses
        seconds = float(time) if {"t", "time"} & used else None
        now = replace(self, frame=frame if "frame" in used else None, time=seconds)
        return self if now == self else now

    def __call__(self, mesh: TriangleMesh) -> Floats:
        """Return values (V,). Raises UsageError where a value is not finite, or the time is not known."""
        now = time_values(self.frame, self.time)
        missing = [name for name in now if name in self.expression.uses and now[name] is None]
        if missing:
            raise UsageError(f"formula {self.text!r} needs a {missing[0]}; ask for it `at` a frame first")
        known = {name: value for name, value in now.items() if value is not None}
        x, y, z = mesh.vertices.T
        return self.unit * self.expression(x=x, y=y, z=z, **known)


def curvature(mesh: TriangleMesh, hard_angle: float = math.radians(40), shortest: float = 0.0) -> Floats:
    """Return the largest curvature (V,) along the edges at every vertex, 1 / scene units; 0 where flat.

    For hard_angle and shortest see `Curvature` and `edge_curvature` of `edge_scans`.
    Raises MeshError where the mesh is not an oriented manifold.
    """
    points, faces, normals, source = _shade(mesh, hard_angle)
    apart = np.empty(len(points))
    edge_curvature(points, faces, normals, max(shortest, np.finfo(np.float64).tiny), apart)
    if source is None:
        return apart
    joined = np.zeros(len(mesh.vertices))
    np.maximum.at(joined, source, apart)
    return joined


def graded(mesh: TriangleMesh, lengths: Floats, gradation: float) -> Floats:
    """Return lengths (V,), lowered until they differ along every edge by at most gradation × its length."""
    result = np.array(lengths)  # copies are writable, as compiled kernels declare their arguments
    limit_gradation(np.array(mesh.vertices), np.array(mesh.faces), gradation, result)
    return result


def _shade(mesh: TriangleMesh, hard_angle: float) -> tuple[Points, Faces, Vectors, AnyArray | None]:
    """Return vertices, faces, unit normals and, if vertices are split at creases, their source vertices."""
    exact = mesh.attributes.get(NORMAL)
    known = None if exact is None else np.linalg.norm(exact, axis=1) > 0.5
    if exact is not None and known is not None and known.all():
        return np.array(mesh.vertices), np.array(mesh.faces), np.array(exact, np.float64), None
    points, normals, faces, source = split_at_creases(mesh, hard_angle)
    if exact is not None and known is not None:
        normals[known[source]] = exact[source[known[source]]]
    return points, faces, normals, source


def _require_order(finest: float, coarsest: float) -> None:
    if not (math.isfinite(coarsest) and 0 < finest <= coarsest):
        raise UsageError(
            f"finest {finest:g} and coarsest {coarsest:g} must be positive lengths in scene units, "
            "the first at most as long as the second"
        )


DEFAULT_RATIO = 0.4
"""Minimum over maximum edge length: the paper's compromise between thrashing and spread (P12)."""

HIGHEST_RATIO = 0.5  # from here on a split makes edges that are at once too short (P13)

DEFAULT_HARD_ANGLE = math.radians(40)

DEFAULT_GRADATION = 0.3
"""Growth of edge lengths per scene unit along the surface: an edge is at most about a third longer than the
one before it, and the triangles between stay well shaped."""


@runtime_checkable
class Timed(Protocol):
    """A threshold that changes over time."""

    def at(self, frame: int, time: float) -> Threshold:
        """Return the threshold of a frame, `time` seconds from the start of the shot; itself if constant."""


ActiveFunction = Callable[[TriangleMesh], ArrayLike]
"""A callable: a mesh to one number for each of its vertices, (V,); of `bends` to three, (V, 3)."""

Threshold = float | ActiveFunction | Timed


@dataclass(frozen=True)
class Thresholds:
    """Length limits for edges, and the angle that makes an edge hard.

    max_edge_length   scene units; after a pass no edge is longer (P8)
    min_edge_length   scene units; shorter edges collapse where they may (P9); by default 40% of the maximum,
                      and None while the maximum is a function
    hard_angle        radians between the normals of two faces; an edge that turns more is hard (P29): in each
                      frame, or with `Exact` placement at rest; 40°
    max_vertices      a frame that would need more stops with an error instead of filling the memory
    gradation         for lengths that are functions: their largest difference between two ends of an edge, as
                      a share of its length
    bends             a function that returns unit normals (V, 3) over eight times the height that the middle
                      of an edge may have over the surface, scene units; both limits of an edge that bends
                      more are lower, to a 64th at least, so that edges are short only along the
                      direction in which the surface is curved; None where they may bend

    The first three are numbers, or callables `mesh -> (V,)` in the same units, such as those of
    `flowsculpt.pipeline.resample.thresholds`. Raises UsageError for impossible numbers.
    """

    max_edge_length: Threshold
    min_edge_length: Threshold | None = None
    hard_angle: Threshold = DEFAULT_HARD_ANGLE
    max_vertices: int = 2_000_000
    gradation: float = DEFAULT_GRADATION
    bends: ActiveFunction | None = field(default=None, metadata=OMIT_DEFAULT)

    def __post_init__(self) -> None:
        longest, shortest = _plain(self.max_edge_length), _plain(self.min_edge_length)
        angle, gradation = _plain(self.hard_angle), float(self.gradation)
        if shortest is None and isinstance(longest, float):
            shortest = DEFAULT_RATIO * longest
        _check_numbers(longest, shortest, angle)
        if self.max_vertices < 4:
            raise UsageError(f"max_vertices {self.max_vertices} is too few for any surface; 2000000 is usual")
        if not (math.isfinite(gradation) and gradation > 0):
            raise UsageError(f"gradation {gradation:g} must be positive; {DEFAULT_GRADATION:g} is usual")
        values = (longest, shortest, angle, int(self.max_vertices), gradation, self.bends)
        for name, value in zip(self.__dataclass_fields__, values, strict=True):
            object.__setattr__(self, name, value)

    @property
    def active(self) -> bool:
        """True if the limits of edges vary: any of the three is a function, or edges may not bend."""
        return self.bends is not None or not all(isinstance(threshold, float) for threshold in self._three)

    @property
    def _three(self) -> tuple[Threshold, Threshold | None, Threshold]:
        return self.max_edge_length, self.min_edge_length, self.hard_angle

    @property
    def numbers(self) -> tuple[float, float, float]:
        """Maximum, minimum (scene units), hard angle (radians). Raises UsageError where one is a function."""
        if self.active:
            raise UsageError("active thresholds are functions, not three numbers; use `fields` of a mesh")
        return cast(tuple[float, float, float], self._three)

    def hard_angles(self, mesh: TriangleMesh) -> float | Floats:
        """Return the hard angle, radians; (V,) for a function. Raises UsageError like `fields`."""
        if isinstance(self.hard_angle, float):
            return self.hard_angle
        rule = "between 0 and pi radians"
        return _over("hard_angle", self.hard_angle, mesh, lambda v: (v > 0) & (v <= math.pi), rule)

    def with_hard_edges(self, mesh: TriangleMesh) -> TriangleMesh:
        """Return a mesh whose hard edges are creases as well. Raises UsageError like `fields`."""
        edges = edges_by_angle(mesh, self.hard_angles(mesh))
        return mesh.with_creases(np.concatenate([mesh.creases, edges]))

    def at(self, frame: int, time: float) -> Thresholds:
        """Return the thresholds of one frame, `time` seconds from the start of the shot.

        Returns itself if nothing depends on time.
        """
        three = self._three
        if all(t is None or isinstance(t, float) for t in three):  # known at once; a protocol is not
            return self
        now = [t.at(frame, time) if isinstance(t, Timed) else t for t in three]
        if all(new is old for new, old in zip(now, three, strict=True)):
            return self
        longest, shortest, angle = now
        assert longest is not None and angle is not None, "only a minimum may be left to its ratio"
        return replace(self, max_edge_length=longest, min_edge_length=shortest, hard_angle=angle)

    def fields(self, mesh: TriangleMesh) -> Floats:
        """Return maximum and minimum edge length, scene units, and hard angle, radians, per vertex: (V, 3).

        With `bends` their numbers follow: (V, 6).

        Lengths that are functions are graded: between two ends of an edge the maximum differs by at most
        `gradation` times its length, and the minimum by half of that, so that it stays below.

        Raises UsageError, naming the vertex, where a value is not finite or impossible.
        """
        out = np.empty((len(mesh.vertices), 3))
        longest, shortest, rule = self.max_edge_length, self.min_edge_length, "length in scene units"
        out[:, 0] = _over("max_edge_length", longest, mesh, lambda v: v > 0, f"a positive {rule}")
        if not isinstance(longest, float):
            out[:, 0] = graded(mesh, out[:, 0], self.gradation)
        if shortest is None:
            out[:, 1] = DEFAULT_RATIO * out[:, 0]
        else:
            out[:, 1] = _over("min_edge_length", shortest, mesh, lambda v: v >= 0, f"a {rule}")
            if not isinstance(shortest, float):
                out[:, 1] = graded(mesh, out[:, 1], 0.5 * self.gradation)
            _require_ratio(out, mesh)
        out[:, 2] = self.hard_angles(mesh)
        return out if self.bends is None else np.column_stack([out, self.bends(mesh)])


def _plain(threshold: Any) -> Any:
    """Return a function as it is, anything else as a float."""
    active = threshold is None or callable(threshold) or isinstance(threshold, Timed)
    return threshold if active else float(threshold)


def _check_numbers(longest: Any, shortest: Any, angle: Any) -> None:
    """Raise UsageError for impossible numbers."""
    if isinstance(longest, float) and not (math.isfinite(longest) and longest > 0):
        raise UsageError(f"max_edge_length {longest:g} must be a positive length in scene units")
    if isinstance(shortest, float) and not (math.isfinite(shortest) and shortest >= 0):
        raise UsageError(f"min_edge_length {shortest:g} must not be negative; 0 removes nothing")
    if isinstance(longest, float) and isinstance(shortest, float) and shortest >= HIGHEST_RATIO * longest:
        raise UsageError(_too_close(longest, shortest))
    if isinstance(angle, float) and not 0 < angle <= math.pi:
        raise UsageError(f"hard_angle {angle:g} must lie between 0 and pi radians; 0.7 (40 degrees) is usual")


def _too_close(longest: float, shortest: float, where: str = "") -> str:
    return (
        f"min_edge_length {shortest:g} is {shortest / longest:.0%} of max_edge_length {longest:g}{where}; "
        f"it must be below 50%, or splitting and collapsing undo each other. "
        f"Try {DEFAULT_RATIO * longest:g}."
    )


def _over(
    name: str, threshold: Threshold, mesh: TriangleMesh, is_possible: Callable[[Floats], AnyArray], rule: str
) -> Floats:
    """Return a threshold at every vertex, (V,). Raises UsageError for the first without a possible number."""
    if not (callable(threshold) or isinstance(threshold, float)):
        raise UsageError(f"{name} changes in time; ask for the thresholds `at` a frame first")
    values = np.asarray(threshold(mesh) if callable(threshold) else threshold, np.float64)
    if values.shape not in ((), mesh.vertices.shape[:1]):
        raise UsageError(
            f"{name} gave an array of shape {values.shape} for {len(mesh.vertices)} vertices; "
            "it must give one number for each"
        )
    values = np.array(np.broadcast_to(values, mesh.vertices.shape[:1]))
    bad = np.flatnonzero(~(is_possible(values) & np.isfinite(values)))
    if bad.size:
        raise UsageError(f"{name} is {values[bad[0]]:g} at {_vertex(mesh, int(bad[0]))}; it must be {rule}")
    return values


def _require_ratio(fields: Floats, mesh: TriangleMesh) -> None:
    """Raise UsageError where the minimum is too close to the maximum (P13)."""
    bad = np.flatnonzero(fields[:, 1] >= HIGHEST_RATIO * fields[:, 0])
    if bad.size:
        longest, shortest, _ = fields[bad[0]]
        raise UsageError(_too_close(longest, shortest, f" at {_vertex(mesh, int(bad[0]))}"))


def _vertex(mesh: TriangleMesh, index: int) -> str:
    x, y, z = mesh.vertices[index]
    return f"vertex {index} ({x:g}, {y:g}, {z:g})"


DEFAULT_ROUNDNESS = 0.6
"""At this value one triangle in a hundred falls short. Improving more would show as flicker (P38)."""

_DEMANDING = 0.7  # from here on one round of relaxation is not enough


@dataclass(frozen=True)
class TriangleShape:
    """Triangles below a roundness are improved by flipping edges and moving vertices.

    min_roundness  twice the inradius over the circumradius: 1 for an equilateral triangle, 0 for a needle; 0
                   improves only what splits and collapses touched

    Raises UsageError for a number outside 0 to 1.
    """

    min_roundness: float = DEFAULT_ROUNDNESS

    def __post_init__(self) -> None:
        if not 0 <= self.min_roundness < 1:
            raise UsageError(
                f"min_roundness {self.min_roundness:g} must lie between 0 (as it comes) and 1 (equilateral); "
                f"{DEFAULT_ROUNDNESS:g} is usual, 0.85 is demanding"
            )

    @property
    def rounds(self) -> int:
        """Rounds of moving vertices in a frame."""
        if self.min_roundness == 0:
            return 0
        return 1 if self.min_roundness < _DEMANDING else 3

    @cached_property
    def longest_share(self) -> float:
        """Share of the longest side in the summed squared sides of an isosceles triangle with this roundness.

        With the angle θ at its apex its roundness is 8 sin(θ/2) sin²((π - θ)/4), which falls from 60° on.
        """
        if self.min_roundness == 0:
            return 1.0
        low, high = math.pi / 2, math.pi
        while high - low > 1e-6:
            angle = 0.5 * (low + high)
            round_enough = 8 * math.sin(angle / 2) * math.sin((math.pi - angle) / 4) ** 2 > self.min_roundness
            low, high = (angle, high) if round_enough else (low, angle)
        return (1 - math.cos(low)) / (2 - math.cos(low))


Mesh = TriangleMesh | PolygonMesh

Region = Callable[[Points], AnyArray]
"""A callable: points (N, 3) to (N,) flags, True for points inside."""


def edges_by_angle(mesh: Mesh, hard_angle: float | Floats) -> Indices:
    """Return the edges (K, 2) whose faces enclose more than hard_angle (radians), as creases for a mesh.

    With one angle per vertex, an edge has the mean of its two ends' angles.

    Raises MeshError where the mesh is not an oriented manifold.
    """
    turns = _turns(mesh)
    if isinstance(hard_angle, float):
        return _once(_sides(mesh, np.flatnonzero(turns > hard_angle)))  # not where they are nan
    ends = _sides(mesh)
    return _once(ends[np.nan_to_num(turns) > hard_angle[ends].mean(axis=1)])


def edges_in_region(mesh: Mesh, region: Region) -> Indices:
    """Return the edges (K, 2) with both ends in a region, as creases for a mesh.

    Raises UsageError where the region does not return one flag per vertex.
    """
    within = np.asarray(region(mesh.vertices))
    if within.shape != (len(mesh.vertices),):
        raise UsageError(
            f"the region returned shape {within.shape} for {len(mesh.vertices)} vertices; "
            "it must return one flag for each vertex"
        )
    ends = _sides(mesh)
    return _once(ends[within.astype(bool)[ends].all(axis=1)])


def _sides(mesh: Mesh, chosen: AnyArray | slice = slice(None)) -> Indices:
    """Return the two vertices (C, 2) of each side of each face, or of the chosen ones only."""
    if isinstance(mesh, PolygonMesh):
        return np.column_stack([mesh.corners[chosen], mesh.heads[chosen]])
    return mesh.halfedge_ends if isinstance(chosen, slice) else mesh.ends_of(chosen)


def _turns(mesh: Mesh) -> Floats:
    """Return the angle (C,) between the normals of the two faces at each side, radians; nan on a boundary."""
    if isinstance(mesh, TriangleMesh):
        return dihedral_angles(mesh)
    twin, normals = mesh.twins, mesh.normals
    return angles_between(normals[mesh.owners], normals[mesh.owners[twin]], twin)


def _once(pairs: Indices) -> Indices:
    return np.unique(np.sort(pairs, axis=1), axis=0)
