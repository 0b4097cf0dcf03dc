"""Copies of a subject: places scattered in a region, and the one mesh of several parts that they make."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from pipeline.arrays import AnyArray, Floats, Points
from pipeline.errors import UsageError
from pipeline.flow.regions import Region
from pipeline.mesh import PolygonMesh, TriangleMesh
from render.base.plural import plural

MOST_COPIES = 1000

GAP = 1.02
"""Distance between the middles of two copies, in diameters, at least: their surfaces at rest do not touch."""

TRIES = 200
"""Places that are tried for each copy."""

MIN_TRIES, BATCH = 20_480, 512
"""Places that are tried for all copies at least, and those that are tried together."""

_SIDES = np.array([(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if x or y or z])
DIRECTIONS: Floats = _SIDES / np.linalg.norm(_SIDES, axis=1, keepdims=True)
"""(26, 3): the points of a copy's bounding sphere that must lie in the region."""

Mesh = TypeVar("Mesh", TriangleMesh, PolygonMesh)


@dataclass(frozen=True)
class Copies:
    """The number of copies of a subject, and their places.

    seed    another one scatters the copies differently
    region  holds the bounding spheres of all copies in the first frame
    """

    count: int
    seed: int
    region: Region

    def data(self) -> dict[str, Any]:
        """Return what decides the places, as JSON-able data."""
        return {"count": self.count, "seed": self.seed, "region": self.region.cache_data(0.0)}

    def middles(self, radius: float) -> Points:
        """Return the middles (count, 3) of spheres of a radius in the region, none of which touch.

        Places are tried at random in the box around the region (dart throwing: Cook, *Stochastic sampling in
        computer graphics*, 1986). Raises UsageError where fewer than `count` find room.
        """
        found = np.empty((0, 3))
        for place in self._places(radius):
            if not len(found) or np.linalg.norm(found - place, axis=1).min() > 2.0 * GAP * radius:
                found = np.vstack([found, place])
            if len(found) == self.count:
                return found
        room = plural(len(found), "copy", "copies") if len(found) else "no copy"
        raise UsageError(
            f"the region has room for {room} of this subject, and count is {self.count}; copies lie whole in "
            f"the region, and their bounding spheres of radius {radius:.3g} do not touch. Enlarge the "
            f"region, or make the subject smaller{', or lower count' if len(found) else ''}."
        )

    def _places(self, radius: float) -> Iterator[Points]:
        """Yield places (3,) at random around which a sphere lies in the region; the same ones each time."""
        random = np.random.default_rng(self.seed)
        centre, half = (np.array(side) for side in self.region.bounds(0.0))
        for _ in range(max(MIN_TRIES, TRIES * self.count) // BATCH):
            places = centre + half * random.uniform(-1.0, 1.0, (BATCH, 3))
            ends = (places[:, None] + radius * DIRECTIONS).reshape(-1, 3)
            inside = (self.region.weight(ends, 0.0) == 1.0).reshape(-1, len(DIRECTIONS)).all(axis=1)
            yield from places[inside]


def bounding_sphere(points: Points) -> tuple[Points, float]:
    """Return the middle (3,) of the bounds of points (V, 3), and the radius of the sphere around it."""
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    return middle, float(np.linalg.norm(points - middle, axis=1).max())


def repeated(mesh: Mesh, offsets: Points) -> Mesh:
    """Return one mesh of copies of another, each moved by one of the offsets (N, 3)."""
    vertices = (offsets[:, None] + mesh.vertices).reshape(-1, 3)
    if len(offsets) == 1:
        return mesh.with_vertices(vertices)
    first = len(mesh.vertices) * np.arange(len(offsets))
    attributes = {name: np.concatenate([values] * len(offsets)) for name, values in mesh.attributes.items()}
    creases = _shifted(mesh.creases, first)
    if isinstance(mesh, TriangleMesh):
        return TriangleMesh(vertices, _shifted(mesh.faces, first), attributes, creases)
    starts = mesh.offsets[:-1] + len(mesh.corners) * np.arange(len(offsets))[:, None]
    ends = np.append(starts.reshape(-1), len(mesh.corners) * len(offsets))
    corners = (mesh.corners + first[:, None]).reshape(-1)
    return PolygonMesh.from_arrays(vertices, ends, corners, attributes, creases)


def _shifted(numbers: AnyArray, first: AnyArray) -> AnyArray:
    """Return rows (K, n) of vertex numbers once for each copy, whose first vertices are `first`."""
    return np.concatenate([numbers + start for start in first])
