"""Fits between shapes of shots, each computed once for the user and kept in the user's cache.

A fit has the same bits on every run and with any number of threads: whoever lacks it computes it again.
A fit that is interrupted goes on after its last round.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np

from flowsculpt import MachineError, MeshError, Streamlines, TriangleMesh, UsageError, validate
from flowsculpt.api import Progress
from flowsculpt.api.files import CachedAnswer, atomic_write
from flowsculpt.api.flows import Sampled, Samples
from flowsculpt.api.frames import Locks, StoredFiles
from flowsculpt.api.meshes import Floats, connected_components
from flowsculpt.api.shots import Model, Solid
from flowsculpt.pipeline.plugins.become.fitting import THIN, Detail, Leg, Residual, State, fitted
from flowsculpt.pipeline.plugins.become.target import PATCH, FittedSurface, face_vectors, lengths
from flowsculpt.pipeline.plugins.become.velocity_path import KNOTS, STEPS, PathSpace

T = TypeVar("T")

VERSION = 8
"""Raised when equal shapes give another fit."""

MARGIN = 1.35
"""The side of the cube of the paths over the largest extent of both shapes."""

EDGES = 45
"""Edges of a solid's mesh along its largest extent."""

IN_BOX = 0.15
"""The least share of time of a path in a box, over that of all others: it moves little area, but is seen."""

REFUSED, DOUBTFUL = 0.03, 0.01
"""Residuals over the diagonal above which a fit is refused, and from which on it is warned of."""

TOLERANCE = 2.5e-6
"""The error of a sub-step along a path, as a share of the cube's side."""

DURATIONS: dict[Detail, str] = {"coarse": "half a minute", "medium": "1-2 minutes", "fine": "some minutes"}
"""About how long a fit takes, for the names of its progress."""

KEPT_PLANS = 256
"""Steps of a path whose tables of sub-steps are kept, about 10 kB each: more than a rest interval has."""

_HOLES = ("no hole", "one hole", "two holes", "three holes")


@dataclass(frozen=True)
class PlacedShape:
    """A solid or a model where it stands in a shot."""

    subject: Solid | Model
    place: tuple[float, float, float]

    @property
    def name(self) -> str:
        if isinstance(self.subject, Solid):
            return f"the {self.subject.solid}"
        name = self.subject.path.name
        return name if self.subject.files else f"the {name}"  # a surface of a plug-in has no files

    def data(self) -> Any:
        """Return what decides it, JSON-able."""
        return [self.subject.data(), list(self.place)]

    @cached_property
    def mesh(self) -> TriangleMesh:
        """The closed mesh of one part that is fitted. Raises MeshError for any other."""
        extent = float(np.ptp(self.subject.build().vertices, axis=0).max())
        mesh = self.subject.build(extent / EDGES)
        validate(mesh).require(closed=True, name=self.name)
        ends = np.stack([mesh.faces, np.roll(mesh.faces, -1, axis=1)], axis=-1).reshape(-1, 2)
        parts = len(np.unique(connected_components(len(mesh.vertices), ends[:, 0], ends[:, 1])))
        if parts > 1:
            raise MeshError(f"{self.name}: it has {parts} parts; become needs one. Use a model of one part.")
        return mesh.with_vertices(mesh.vertices + self.place)

    @cached_property
    def holes(self) -> int:
        """The genus."""
        return 1 - validate(self.mesh).require().euler // 2

    @cached_property
    def roundness(self) -> float:
        """36 π volume² / area³: 1 for a ball, less for all else."""
        points, faces = self.mesh.vertices, self.mesh.faces
        vectors = face_vectors(points, faces)
        volume = float(np.sum(vectors * (points[faces[:, 0]] - points.mean(axis=0)))) / 3.0
        return 36.0 * np.pi * volume**2 / float(np.sum(lengths(vectors))) ** 3


class PathVelocity(Sampled):
    """The velocities of a path, over the times 0 to 1."""

    def kinks(self, time: float, dt: float) -> Iterator[float]:
        """Yield none: all times are in memory, and the tolerance halves sub-steps where velocities bend."""
        return iter(())

    @property
    def name(self) -> str:
        return "become"


@dataclass(frozen=True, eq=False)
class PathStreamlines(Streamlines):
    """Streamlines that keep their sub-steps: new vertices follow those of all frames since rest."""

    def step_plan(self, time: float, dt: float, finest: bool = False) -> Any:
        return self._kept_plans(time, dt, finest)

    @cached_property
    def _kept_plans(self) -> Callable[[float, float, bool], Any]:
        return lru_cache(KEPT_PLANS)(super().step_plan)


@dataclass(frozen=True, eq=False)
class Fit:
    """Paths that carry one shape onto another in the cube with the corner `low` (3,) and a side.

    legs           the paths, as single precision holds them, one after another
    ends           share of the whole way at which each leg ends; the last is 1
    is_reversed    True where the paths lead from the target to the start
    residual       of the way that is asked for
    remarks        warnings about the shapes
    """

    low: Floats
    side: float
    legs: tuple[Leg, ...]
    ends: tuple[float, ...]
    is_reversed: bool
    residual: Residual
    remarks: tuple[str, ...]

    @cached_property
    def _paths(self) -> tuple[PathStreamlines, ...]:
        """The motion of each leg, over the times 0 to 1."""
        tolerance = TOLERANCE * self.side
        return tuple(PathStreamlines(self._field(leg), tolerance=tolerance) for leg in self.legs)

    def _field(self, leg: Leg) -> PathVelocity:
        n, side = leg.space.n, leg.side * self.side
        axis = side * np.arange(n + 1) / n
        knots = leg.space.knots(leg.z).transpose(0, 2, 3, 4, 1)
        velocity = side * np.pad(knots, ((0, 0), (0, 1), (0, 1), (0, 1), (0, 0)), mode="wrap")
        samples = Samples.of_arrays(
            (axis,) * 3, np.linspace(0.0, 1.0, KNOTS), np.ascontiguousarray(velocity), ("become",)
        )
        x, y, z = (self.low + self.side * np.array(leg.low)).tolist()
        return PathVelocity(samples, "cubic", "zero" if leg.space.is_windowed else "repeat", (x, y, z))

    def displace(self, points: Floats, before: float, after: float) -> Floats:
        """Return where points (P, 3) are carried between two shares of the way."""
        if self.is_reversed:
            before, after = 1.0 - before, 1.0 - after
        legs = list(zip((0.0, *self.ends), self.ends, self._paths, strict=False))
        for begin, end, path in legs if before < after else reversed(legs):
            here, there = ((min(max(at, begin), end) - begin) / (end - begin) for at in (before, after))
            if here != there:
                points = path.displace(points, here, there - here)
        return points

    def holds(self, points: Floats) -> bool:
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
    ends = _ends(start, target)
    is_reversed = ends[0] is target
    points = np.concatenate([shape.mesh.bounds for shape in ends])
    low, high = points.min(axis=0), points.max(axis=0)
    side = MARGIN * float((high - low).max())
    low = 0.5 * (low + high - side)
    rest, onto = (
        FittedSurface((shape.mesh.vertices - low) / side, shape.mesh.faces.astype(np.int64)) for shape in ends
    )
    path = path_of(start, target, detail)
    with Locks(CachedAnswer.home()).hold_key(path.stem, lambda: None):  # one of several processes computes it
        stored = _loaded(path, _Solution.of)
        if stored is None:
            activity = f"fitting {target.name} once, {DURATIONS[detail]} of a core"
            stored = _computed(path, rest, onto, detail, activity)
        else:
            with suppress(OSError):  # the cache of another user
                os.utime(path)  # `clean` deletes what has not been used for long
    until = (*np.cumsum(stored.shares)[:-1].tolist(), 1.0)
    residual = stored.residual
    if is_reversed:  # the residual counts at the end that is seen
        share = onto.diagonal / rest.diagonal
        mean, most, back, far, patch = (share * number for number in residual[:-1])
        residual = Residual(mean, most, back, far, patch, residual.least)
    thin = stored.thin if residual.patch > 0.5 * DOUBTFUL else 0.0  # else nothing is lost
    remarks = tuple(_remarks(start, ends[1], thin))
    return Fit(low, side, stored.legs, until, is_reversed, residual, remarks)


def path_of(start: PlacedShape, target: PlacedShape, detail: Detail) -> Path:
    """Return the file of the fit between two shapes."""
    shapes = [shape.data() for shape in _ends(start, target)]
    return CachedAnswer.of("fits", [json.dumps([VERSION, shapes, detail], sort_keys=True)], ".npz").path


def _ends(start: PlacedShape, target: PlacedShape) -> tuple[PlacedShape, PlacedShape]:
    """Return two shapes, the rounder one first."""
    return (target, start) if target.roundness > start.roundness else (start, target)


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


def _hard_share(mesh: TriangleMesh) -> float:
    """Return the share of edges whose faces meet at more than 40 degrees."""
    vectors = face_vectors(mesh.vertices, mesh.faces)
    normals = vectors / np.maximum(lengths(vectors), 1e-300)[:, None]
    ends = np.sort(np.stack([mesh.faces, np.roll(mesh.faces, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1)
    order = np.lexsort(ends.T)
    pairs = order.reshape(-1, 2) // 3
    return float(np.mean(np.einsum("ij,ij->i", normals[pairs[:, 0]], normals[pairs[:, 1]]) < np.cos(0.7)))


class _Solution(NamedTuple):
    """What is stored of a fit.

    shares  of each leg in the way
    thin    share of the target that may be lost
    """

    legs: tuple[Leg, ...]
    shares: list[float]
    residual: Residual
    thin: float

    @classmethod
    def of(cls, arrays: Mapping[str, np.ndarray]) -> _Solution:
        """Return the fit of stored arrays. Raises any error where they are not of one."""
        legs, shares = _legs(arrays), arrays["shares"].tolist()
        if len(shares) != len(legs) or not min(shares) > 0.0:
            raise ValueError("it has no share of each leg")
        return cls(legs, shares, Residual(*map(float, arrays["residual"].tolist())), float(arrays["thin"]))


def _state_of(arrays: Mapping[str, np.ndarray]) -> State:
    """Return the state of stored arrays. Raises any error where they are not of one."""
    points, faces = arrays["points"], arrays["faces"]
    TriangleMesh(points, faces.astype(np.int32))  # refuses anything but a mesh
    return State(int(arrays["done"]), _legs(arrays), FittedSurface(points, faces))


def _computed(
    path: Path, rest: FittedSurface, onto: FittedSurface, detail: Detail, activity: str
) -> _Solution:
    """Compute a fit, and store it as far as the cache can be written."""
    unfinished = path.with_suffix(".unfinished.npz")

    def watch(state: State, rounds: int) -> None:
        Progress(activity, state.done, rounds, is_once=True).report()
        kept = {"points": state.rest.points, "faces": state.rest.faces, "done": np.array(state.done)}
        _store(unfinished, kept | _arrays(state.legs))

    state = fitted(rest, onto, detail, _loaded(unfinished, _state_of), watch)
    fit = _arrays([replace(leg, z=leg.z.astype(np.float32)) for leg in state.legs])
    legs = _legs(fit)
    residual, shares = residual_of(legs, state.rest, onto)
    thin = np.array(onto.thin_share([leg for leg in legs if not leg.space.is_windowed][-1].space.n))
    fit |= {"residual": np.array(residual), "thin": thin, "shares": np.array(shares)}
    _store(path, fit)
    with suppress(OSError):
        unfinished.unlink()
    return _Solution.of(fit)


def _arrays(legs: Sequence[Leg]) -> dict[str, np.ndarray]:
    """Return arrays to store legs as."""
    spaces = {
        "n": [leg.space.n for leg in legs],
        "length": [leg.space.length for leg in legs],
        "is_windowed": [leg.space.is_windowed for leg in legs],
        "low": [leg.low for leg in legs],
        "side": [leg.side for leg in legs],
    }
    return {name: np.array(numbers) for name, numbers in spaces.items()} | {
        f"z{number}": leg.z for number, leg in enumerate(legs)
    }


def _legs(arrays: Mapping[str, np.ndarray]) -> tuple[Leg, ...]:
    """Return the legs that `_arrays` made arrays of. Raises one of UNUSABLE for arrays of others."""
    names = ("n", "length", "is_windowed", "low", "side")
    legs = tuple(
        Leg(PathSpace(n, length, is_windowed), arrays[f"z{number}"].astype(np.float64), tuple(low), side)
        for number, (n, length, is_windowed, low, side) in enumerate(
            zip(*(arrays[name].tolist() for name in names), strict=True)
        )
    )
    if not legs or any(leg.z.shape != (leg.space.size,) or not np.isfinite(leg.z).all() for leg in legs):
        raise ValueError("its numbers are not those of a path")
    return legs


def residual_of(
    legs: Sequence[Leg], rest: FittedSurface, target: FittedSurface
) -> tuple[Residual, list[float]]:
    """Return how far legs carry a surface from its target, and the share of each in the way.

    rest  the surface where the last leg begins
    """
    x, determinants, ways = rest.points, np.ones(len(rest.points)), []
    for leg in reversed(legs[:-1]):
        x = leg.carry(x, 4 * STEPS, backwards=True)
    for leg in legs:
        before = x
        x, factors = leg.carry_with_jacobians(x)
        determinants *= factors
        areas = FittedSurface(x, rest.faces).vertex_normals[1]
        ways.append(float(np.sqrt(np.sum(areas * lengths(x - before) ** 2) / areas.sum())))
    now = FittedSurface(x, rest.faces)
    away, back = (one.distances(other, 200 * PATCH)[1] for one, other in ((now, target), (target, now)))
    patch = max(float(d.reshape(-1, PATCH).mean(axis=1).max()) for d in (away, back))
    numbers = (away.mean(), np.quantile(away, 0.95), back.mean(), np.quantile(back, 0.95), patch)
    mean, most, returning, far, patch = (float(number) / target.diagonal for number in numbers)
    least = IN_BOX * sum(way for leg, way in zip(legs, ways, strict=True) if not leg.space.is_windowed)
    ways = [max(way, least) if leg.space.is_windowed else way for leg, way in zip(legs, ways, strict=True)]
    shares = [way / sum(ways) for way in ways]
    return Residual(mean, most, returning, far, patch, float(determinants.min())), shares


def _loaded(path: Path, reader: Callable[[Mapping[str, np.ndarray]], T]) -> T | None:
    """Return what a reader makes of the arrays of a file; None where there are none that it can use."""
    try:
        return reader(StoredFiles.read_arrays(path))
    except Exception:  # a damaged file, or one of another version, raises all kinds
        return None


def _store(path: Path, arrays: Mapping[str, Any]) -> None:
    """Store arrays. A folder that cannot be written only means that they are computed again."""
    with suppress(MachineError, OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(path) as draft, draft.open("wb") as file:
            np.savez(file, **arrays)
