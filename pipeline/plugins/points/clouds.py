"""Clouds: points that are drawn as spheres, from a file, or scattered in a solid or on it."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np

from flowsculpt import MeshError, TriangleMesh, UsageError
from flowsculpt.api import quote, suggest
from flowsculpt.api.meshes import Floats
from flowsculpt.api.shots import Solid, Subject
from flowsculpt.pipeline.plugins.points.point_files import PointSet, read_points

MOST_POINTS = 2_000_000

_EDGE = 2.45
"""Edge length of the mesh that points are scattered on, in distances between points: about a face a point."""

_GOLDEN = 1.2207440846057596  # the root of g⁴ = g + 1

_PROBES = 4096


def within(bounds: Floats, inside: Callable[[Floats], np.ndarray], count: int, seed: int) -> Floats:
    """Return points (count, 3) of the box `bounds` (2, 3) that are inside.

    inside  returns flags (N,) for points (N, 3); some of the box must be inside

    The places are those of the additive recurrence by the generalised golden ratio (Roberts, *The
    unreasonable effectiveness of quasirandom sequences*, 2018), which fills a box evenly for any count. Each
    is moved by up to 0.4 of the distance between two, which hides the rows.
    """
    random = np.random.default_rng(seed)
    low, extent = bounds[0], bounds[1] - bounds[0]
    shift, step = random.random(3), _GOLDEN ** -np.arange(1.0, 4.0)

    def places(first: int, last: int) -> Floats:
        return low + extent * ((shift + np.arange(first, last)[:, None] * step) % 1.0)

    share = max(float(inside(places(0, _PROBES)).mean()), 1.0 / _PROBES)
    reach = 0.4 * float((extent.prod() * share / count) ** (1.0 / 3.0))
    batch = int(count / share) + _PROBES
    accepted: list[Floats] = []
    taken = 0
    while sum(map(len, accepted)) < count:
        tried = places(taken, taken + batch) + random.uniform(-reach, reach, (batch, 3))
        accepted.append(tried[inside(tried)])
        taken += batch
    return np.concatenate(accepted)[:count]


class Cloud(Subject):
    """Points that move independently; they have no edges to resample."""

    @property
    def is_surface(self) -> bool:
        return False

    @abstractmethod
    def points(self) -> tuple[Floats, Floats]:
        """Return positions (N, 3) and radii (N,) at rest."""

    def build(self, max_edge_length: float | None = None) -> TriangleMesh:
        """Return a mesh of the points without faces, with their radii as the attribute `radius`."""
        points, radii = self.points()
        return TriangleMesh(points, [], {"radius": radii})


@dataclass(frozen=True)
class CloudInSolid(Cloud):
    """Points scattered evenly in a solid, or on its surface.

    radius  of each sphere, scene units
    """

    solid: Solid
    count: int
    fill: Literal["volume", "surface"]
    seed: int
    radius: float

    @property
    def body(self) -> Solid:
        return self.solid

    def points(self) -> tuple[Floats, Floats]:
        """Return positions and radii. Raises UsageError for the volume of a sheet, which encloses none."""
        mesh, surface = self.solid.build(), self.solid.project
        if self.fill == "surface":
            area = float(mesh.areas.sum())
            fine = self.solid.build(_EDGE * (area / self.count) ** 0.5)
            places = surface(fine.scattered(self.count, self.seed)[0])
        elif self.solid.solid == "sheet":
            raise UsageError("a sheet encloses no volume to fill; write fill: surface")
        else:
            places = within(mesh.bounds, surface.encloses, self.count, self.seed)
        return places, np.full(self.count, self.radius)


@dataclass(frozen=True)
class CloudOfFile(Cloud):
    """The points of a file, identified by its contents.

    digest  SHA-256 of the file
    radius  of each sphere, scene units; or the name of an attribute of the file, in the file's units
    scale   factor on all coordinates, and on radii from the file
    """

    digest: str
    radius: float | str
    scale: float = 1.0
    path: Path = field(default=Path(), metadata={"plain": False})  # keys have its digest

    @property
    def files(self) -> tuple[tuple[Path, str], ...]:
        return ((self.path, self.digest),)

    def points(self) -> tuple[Floats, Floats]:
        """Return positions and radii. Raises what `read_points` and `radii_of` raise."""
        file = read_points(self.path)
        radii = radii_of(file, self.radius, str(self.path))
        return self.scale * file.points, radii if isinstance(self.radius, float) else self.scale * radii


def radii_of(file: PointSet, radius: float | str, name: str) -> Floats:
    """Return the radii (N,) of the points of a file: one number for all, or an attribute.

    Raises MeshError, which begins with `name`, for too many points, an unknown attribute, or a value of it
    that is not above 0.
    """
    if len(file.points) > MOST_POINTS:
        raise MeshError(f"{name}: it holds {len(file.points)} points; it may hold {MOST_POINTS}. Thin it out")
    if not isinstance(radius, str):
        return np.full(len(file.points), radius)
    if radius not in file.attributes:
        hint = suggest(radius, file.attributes) if file.attributes else "It has none; write a number."
        raise MeshError(f"{name}: its points have no attribute {quote(radius)} for a radius. {hint}")
    radii = file.attributes[radius].astype(np.float64)
    bad = np.flatnonzero(~(np.isfinite(radii) & (radii > 0)))
    if len(bad):
        raise MeshError(
            f"{name}: {radius} of point {bad[0]} is {radii[bad[0]]:g} (and {len(bad) - 1} more); radii must "
            "be above 0. Correct them in the file"
        )
    return radii
