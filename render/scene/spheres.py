"""Point clouds rendered as spheres, each cut into as many triangles as the picture shows.

One mesh of small geodesic spheres is lit, seen and matted like every other surface, by every variant.
Mitsuba's `ellipsoids`, which need no triangles, render as speckled boxes in its LLVM variant and have no
matte.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache

import numpy as np
from numpy.typing import NDArray

from render.base.render_errors import BadInputError
from render.scene.render_camera import Camera
from render.scene.surface import Surface

TOLERANCE = 0.25
"""Pixels by which the outline of a sphere may differ from a circle."""

MAX_SUBDIVISION = 24
"""Pieces that an edge of the icosahedron is cut into at most."""

MAX_FACES = 8_000_000
"""Faces of all spheres together, about 1.6 GB while rendering. Beyond, all spheres become coarser."""

_EDGE = math.atan(2.0)
"""The angle that an edge of the icosahedron spans, radians."""


@dataclass(frozen=True, eq=False)
class Spheres:
    """A point cloud to render.

    centres     float32 (N, 3), scene units
    radii       float32 (N,)
    attributes  by name, float32 (N, k)
    rest        float32 (N, 3), rest positions, or None; patterns need them
    """

    centres: NDArray[np.float32]
    radii: NDArray[np.float32]
    attributes: Mapping[str, NDArray[np.float32]] = field(default_factory=dict)
    rest: NDArray[np.float32] | None = None

    def surface(self, camera: Camera, width: int) -> Surface:
        """Return the spheres as triangles, fine enough for a picture `width` pixels wide.

        Vertices have the attributes of their point. Raises BadInputError for what cannot be rendered.
        """
        self._check()
        subdivisions = self._subdivisions(camera, width)
        parts = [self._part(np.flatnonzero(subdivisions == n), int(n)) for n in np.unique(subdivisions)]
        starts = np.cumsum([0, *(len(part.vertices) for part, _ in parts)])
        source = np.concatenate([points for _, points in parts])
        return Surface(
            np.concatenate([part.vertices for part, _ in parts]),
            np.concatenate([part.normals for part, _ in parts]),
            np.concatenate([part.faces + start for (part, _), start in zip(parts, starts, strict=False)]),
            {name: values[source] for name, values in self.attributes.items()},
            None if self.rest is None else self.rest[source],
        )

    def _check(self) -> None:
        count = len(self.centres)
        if not count:
            raise BadInputError("the cloud is empty; it needs at least one point")
        if self.centres.shape != (count, 3) or self.radii.shape != (count,):
            raise BadInputError(
                f"the cloud's centres have shape {self.centres.shape} and its radii {self.radii.shape}; not "
                "(N, 3) and (N,)"
            )
        bad = np.flatnonzero(
            ~np.isfinite(self.centres).all(axis=1) | ~(self.radii > 0) | ~np.isfinite(self.radii)
        )
        if len(bad):
            raise BadInputError(
                f"point {bad[0]} of the cloud and {len(bad) - 1} others are not finite, or their radius is "
                "not above 0"
            )

    def _subdivisions(self, camera: Camera, width: int) -> NDArray[np.int64]:
        """Return into how many pieces (N,) the edges of each sphere's icosahedron are cut."""
        near = camera.depths(self.centres) - self.radii
        near = np.maximum(near, self.radii)  # also for spheres around or behind the lens
        pixels = self.radii / near / camera.pixel_size(width)
        angle = np.arccos(1.0 - TOLERANCE / np.maximum(pixels, TOLERANCE))
        wanted = np.ceil(0.5 * _EDGE / angle)
        pieces: NDArray[np.int64] = np.clip(wanted, 1, MAX_SUBDIVISION).astype(np.int64)
        while pieces.max() > 1 and 20 * (pieces**2).sum() > MAX_FACES:
            pieces = np.maximum(pieces - 1, 1)
        return pieces

    def _part(self, points: NDArray[np.int64], pieces: int) -> tuple[Surface, NDArray[np.int64]]:
        """Return spheres of one subdivision, and the point (V,) of each vertex."""
        ball, faces, scale = _geodesic_sphere(pieces)
        grown = scale * self.radii[points, None, None]
        vertices = self.centres[points, None] + grown * ball
        starts = len(ball) * np.arange(len(points), dtype=np.int32)
        surface = Surface(
            vertices.reshape(-1, 3).astype(np.float32),
            np.tile(ball, (len(points), 1)),
            (starts[:, None, None] + faces).reshape(-1, 3),
        )
        return surface, np.repeat(points, len(ball))


@cache
def _geodesic_sphere(pieces: int) -> tuple[NDArray[np.float32], NDArray[np.int32], np.float32]:
    """Return an icosahedron whose edges are cut into `pieces`: unit vectors (V, 3), faces (F, 3) and a scale.

    Scaled by it, the body covers as much of the picture as the unit sphere, averaged over all directions: a
    convex body shows a quarter of its area (Cauchy 1841).
    """
    corners, triangles = _icosahedron()
    steps = np.array([(i, j) for i in range(pieces + 1) for j in range(pieces + 1 - i)])
    index = {(i, j): k for k, (i, j) in enumerate(steps.tolist())}
    cells = [(index[i, j], index[i + 1, j], index[i, j + 1]) for i, j in index if i + j < pieces]
    cells += [(index[i + 1, j], index[i + 1, j + 1], index[i, j + 1]) for i, j in index if i + j < pieces - 1]
    weights = np.column_stack([pieces - steps.sum(axis=1), steps]) / pieces
    loose = np.concatenate([weights @ corners[triangle] for triangle in triangles])
    loose /= np.linalg.norm(loose, axis=1, keepdims=True)
    _, first, joined = np.unique(np.round(loose * 2**20), axis=0, return_index=True, return_inverse=True)
    starts = len(steps) * np.arange(len(triangles))
    faces = joined.reshape(-1)[(starts[:, None, None] + np.array(cells)).reshape(-1, 3)]
    points = loose[first]
    a, b, c = points[faces].transpose(1, 0, 2)
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
    return points.astype(np.float32), faces.astype(np.int32), np.float32(math.sqrt(4.0 * math.pi / area))


def _icosahedron() -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the corners (12, 3) and the faces (20, 3) of an icosahedron.

    Its corners are those of three golden rectangles; its faces are all triples at the least distance.
    """
    golden = (1.0 + math.sqrt(5.0)) / 2.0
    flat = np.array([(0.0, a, b * golden) for a in (-1.0, 1.0) for b in (-1.0, 1.0)])
    corners = np.concatenate([np.roll(flat, k, axis=1) for k in range(3)])
    near = np.linalg.norm(corners[:, None] - corners, axis=2) < 2.1
    faces = []
    for i, j, k in np.ndindex(12, 12, 12):
        joined = i < j and i < k and j != k and near[i, j] and near[j, k] and near[k, i]
        if joined and np.linalg.det(corners[[i, j, k]]) > 0.0:
            faces.append((i, j, k))
    return corners, np.array(faces)
