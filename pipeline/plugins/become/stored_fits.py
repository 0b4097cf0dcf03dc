"""Fits between shapes of shots, each computed once for the user and kept in the user's cache.

A fit has the same bits on every run and with any number of threads: whoever lacks it computes it again.
A fit that is interrupted goes on after its last round.
"""

from __future__ import annotations

import fcntl
import json
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.arrays import Floats, Points
from pipeline.errors import MeshError, UsageError
from pipeline.flow.catalogue.external_fields import Sampled
from pipeline.flow.parameters import Vector
from pipeline.flow.samples import Samples
from pipeline.long_computations import report_progress
from pipeline.mesh.face_soup import components
from pipeline.mesh.meshes import TriangleMesh
from pipeline.mesh.validation import require
from pipeline.plugins.become.fitting import Detail, Residual, State, fitted
from pipeline.plugins.become.target import FittedSurface, SolidGrowth, face_vectors, lengths
from pipeline.plugins.become.velocity_path import KNOTS, PathSpace, carried_with_jacobians, padded
from pipeline.shot.motion import as_data
from pipeline.shot.subjects import Model, PluginSurface, Solid
from render.base.atomic_write import atomic_write
from render.base.render_errors import MachineError
from render.base.user_cache import cache_path, writable_cache

VERSION = 2
"""Raised when equal shapes give another fit."""

MARGIN = 1.35
"""The side of the cube of the paths over the largest extent of both shapes."""

EDGES = 45
"""Edges of a solid's mesh along its largest extent."""

REFUSED, DOUBTFUL = 0.03, 0.01
"""Residuals over the diagonal above which a fit is refused, and from which on it is warned of."""

THIN = 0.1
"""The share of a target that may be thinner than two cells."""

_HOLES = ("no hole", "one hole", "two holes", "three holes")


@dataclass(frozen=True)
class PlacedShape:
    """A solid or a model where it stands in a shot."""

    subject: Solid | Model
    place: Vector

    @property
    def name(self) -> str:
        if isinstance(self.subject, PluginSurface):
            return f"the {self.subject.name}"
        return self.subject.path.name if isinstance(self.subject, Model) else f"the {self.subject.solid}"

    def data(self) -> Any:
        """Return what decides it, JSON-able."""
        return [as_data(self.subject), list(self.place)]

    @cached_property
    def mesh(self) -> TriangleMesh:
        """The closed mesh of one part that is fitted. Raises MeshError for any other."""
        extent = float(np.ptp(self.subject.build().vertices, axis=0).max())
        mesh = self.subject.build(extent / EDGES)
        require(mesh, closed=True, name=self.name)
        ends = np.stack([mesh.faces, np.roll(mesh.faces, -1, axis=1)], axis=-1).reshape(-1, 2)
        parts = len(np.unique(components(len(mesh.vertices), ends[:, 0], ends[:, 1])))
        if parts > 1:
            raise MeshError(f"{self.name}: it has {parts} parts; become needs one. Use a model of one part.")
        return mesh.with_vertices(mesh.vertices + self.place)

    @cached_property
    def holes(self) -> int:
        """The genus."""
        return 1 - require(self.mesh).euler // 2

    @cached_property
    def roundness(self) -> float:
        """36 π volume² / area³: 1 for a ball, less for all else."""
        points, faces = self.mesh.vertices, self.mesh.faces
        vectors = face_vectors(points, faces)
        volume = float(np.sum(vectors * (points[faces[:, 0]] - points.mean(axis=0)))) / 3.0
        return 36.0 * np.pi * volume**2 / float(np.sum(lengths(vectors))) ** 3


class PathVelocity(Sampled):
    """The velocities of a path, over the times 0 to 1."""

    @property
    def name(self) -> str:
        return "become"


@dataclass(frozen=True, eq=False)
class Fit:
    """A path that carries one shape onto another in the cube with the corner `low` (3,) and a side.

    path_space, z  the path, as single precision holds it
    is_reversed    True where the path leads from the target to the start
    residual       of the way that is asked for
    remarks        warnings about the shapes
    """

    low: Floats
    side: float
    path_space: PathSpace
    z: Floats
    is_reversed: bool
    residual: Residual
    remarks: tuple[str, ...]

    @cached_property
    def field(self) -> PathVelocity:
        """The velocities over the times 0 to 1 of the path."""
        n = self.path_space.n
        axis = self.side * np.arange(n + 1) / n
        knots = self.path_space.knots(self.z).transpose(0, 2, 3, 4, 1)
        velocity = self.side * np.pad(knots, ((0, 0), (0, 1), (0, 1), (0, 1), (0, 0)), mode="wrap")
        samples = Samples(
            (axis,) * 3, np.linspace(0.0, 1.0, KNOTS), np.ascontiguousarray(velocity), ("become",)
        )
        x, y, z = self.low.tolist()
        return PathVelocity(samples, "cubic", "repeat", (x, y, z))

    def holds(self, points: Points) -> bool:
        """Tell whether points (P, 3) lie in the cube."""
        return bool(((points >= self.low) & (points <= self.low + self.side)).all())


@lru_cache(maxsize=4)
def fit_between(start: PlacedShape, target: PlacedShape, detail: Detail) -> Fit:
    """Return the fit that carries one shape onto another; computed where it is not stored.

    The rounder shape is carried onto the other, and the path is played backwards for the other way, so that
    the way back is the way there.

    Raises MeshError where a shape is open or of several parts, UsageError where they have not as many holes.
    """
    _require_alike(start, target)
    is_reversed = target.roundness > start.roundness
    ends = (target, start) if is_reversed else (start, target)
    points = np.concatenate([shape.mesh.bounds for shape in ends])
    low, high = points.min(axis=0), points.max(axis=0)
    side = MARGIN * float((high - low).max())
    low = 0.5 * (low + high - side)
    rest, onto = (
        FittedSurface((shape.mesh.vertices - low) / side, shape.mesh.faces.astype(np.int64)) for shape in ends
    )
    key = json.dumps([VERSION, [shape.data() for shape in ends], detail], sort_keys=True)
    path = cache_path("fits", [key], ".npz")
    with _alone(path):
        stored = _loaded(path)
        if stored is None:
            stored = _computed(path, rest, onto, detail, f"fitting {target.name}")
    space, z = PathSpace(int(stored["n"]), float(stored["length"])), stored["z"].astype(np.float64)
    residual = Residual(*stored["residual"].tolist())
    if is_reversed:  # the residual counts at the end that is seen
        share = onto.diagonal / rest.diagonal
        mean, most, back, far = (share * number for number in residual[:4])
        residual = Residual(mean, most, back, far, residual.least)
    remarks = tuple(_remarks(start, ends[1], float(stored["thin"])))
    return Fit(low, side, space, z, is_reversed, residual, remarks)


def _require_alike(start: PlacedShape, target: PlacedShape) -> None:
    if start.holes != target.holes:
        one, other = (
            _HOLES[shape.holes] if shape.holes < len(_HOLES) else f"{shape.holes} holes"
            for shape in (start, target)
        )
        with_as_many = {0: "an icosphere", 1: "a torus"}.get(target.holes, "a model with as many")
        raise UsageError(
            f"{start.name} has {one} and {target.name} {other}; a flow neither opens nor closes any. "
            f"Begin with {with_as_many}."
        )


def _remarks(start: PlacedShape, onto: PlacedShape, thin: float) -> Iterator[str]:
    """Yield warnings about what a path cannot do well."""
    if (share := _hard_share(start.mesh)) > 0.0:
        yield f"{share:.0%} of the edges of {start.name} are hard and stay as faint seams. Round them."
    if thin > THIN:
        yield (
            f"{thin:.0%} of {onto.name} is thinner than two cells of the grid, and may be lost. "
            "Write detail: fine, or thicken it."
        )


def _thin_share(surface: FittedSurface, n: int) -> float:
    """Return the share of a surface that is thinner than two of n cells, seen from one cell below it."""
    points, normals = surface.samples(4000)
    depths, _ = SolidGrowth.of(surface).residual(points - normals / n, np.inf)
    return float(np.mean(depths > -0.7 / n))


def _hard_share(mesh: TriangleMesh) -> float:
    """Return the share of edges whose faces meet at more than 40 degrees."""
    vectors = face_vectors(mesh.vertices, mesh.faces)
    normals = vectors / np.maximum(lengths(vectors), 1e-300)[:, None]
    ends = np.sort(np.stack([mesh.faces, np.roll(mesh.faces, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1)
    order = np.lexsort(ends.T)
    pairs = order.reshape(-1, 2) // 3
    return float(np.mean(np.einsum("ij,ij->i", normals[pairs[:, 0]], normals[pairs[:, 1]]) < np.cos(0.7)))


def _computed(
    path: Path, rest: FittedSurface, onto: FittedSurface, detail: Detail, activity: str
) -> dict[str, Any]:
    """Compute a fit, and store it as far as the cache can be written."""
    unfinished = path.with_suffix(".unfinished.npz")

    def watch(state: State, rounds: int) -> None:
        report_progress(activity, state.done, rounds)
        kept = {"points": state.rest.points, "faces": state.rest.faces, "z": state.z, "done": state.done}
        _store(unfinished, {**kept, "n": state.space.n, "length": state.space.length})

    state = None
    if (kept := _loaded(unfinished)) is not None:
        space = PathSpace(int(kept["n"]), float(kept["length"]))
        state = State(int(kept["done"]), space, kept["z"], FittedSurface(kept["points"], kept["faces"]))
    state = fitted(rest, onto, detail, state, watch)
    z = state.z.astype(np.float32)
    residual = residual_of(state.space, z.astype(np.float64), state.rest, onto)
    grid = {"n": np.array(state.space.n), "length": np.array(state.space.length)}
    thin = np.array(_thin_share(onto, state.space.n))
    fit = {**grid, "z": z, "residual": np.array(residual), "thin": thin}
    _store(path, fit)
    with suppress(OSError):
        unfinished.unlink()
    return fit


def residual_of(space: PathSpace, z: Floats, rest: FittedSurface, target: FittedSurface) -> Residual:
    """Return how far a path carries a surface from its target."""
    x, determinants = carried_with_jacobians(padded(space.knots(z)), space.n, rest.points)
    now = FittedSurface(x, rest.faces)
    distances, areas = lengths(x - target.nearest(x)[0]), now.vertex_normals[1]
    order = np.argsort(distances, kind="stable")
    shares = np.cumsum(areas[order]) / areas.sum()
    there = target.samples(10_000)[0]
    back = lengths(there - now.nearest(there)[0])
    numbers = (
        np.sum(areas * distances) / areas.sum(),
        distances[order[min(int(np.searchsorted(shares, 0.95)), len(order) - 1)]],
        back.mean(),
        np.quantile(back, 0.95),
    )
    mean, most, returning, far = (float(number) / target.diagonal for number in numbers)
    return Residual(mean, most, returning, far, float(determinants.min()))


def _loaded(path: Path) -> dict[str, Any] | None:
    """Return the arrays of a file; None where there is none that can be read."""
    with suppress(OSError, ValueError, EOFError, KeyError), np.load(path, allow_pickle=False) as arrays:
        return dict(arrays)
    return None


def _store(path: Path, arrays: dict[str, Any]) -> None:
    """Store arrays. A folder that cannot be written only means that they are computed again."""
    with suppress(MachineError, OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(path, flush=False) as draft, draft.open("wb") as file:
            np.savez(file, **arrays)


@contextmanager
def _alone(path: Path) -> Iterator[None]:
    """Wait until no other process computes a fit, so that it is computed once."""
    folder = writable_cache() / "fits"
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / f"{path.stem}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield
