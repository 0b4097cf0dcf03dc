"""Surfaces as they are rendered: triangles with normals, split where creases look sharp; wireframes; spheres.

Each edge of a wireframe becomes a ribbon that faces the camera, a little in front of the surface. So lines
are equally wide everywhere in the picture, work with every material, are antialiased and lit like the rest of
the picture, and appear in the denoiser's auxiliary AOVs.

The points of a cloud become one mesh of small geodesic spheres, each cut into as many triangles as the
picture shows, which is lit, seen and matted like every other surface, by every variant. Mitsuba's
`ellipsoids`, which need no triangles, render as speckled boxes in its LLVM variant and have no matte.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.base.serialise import Colour
from flowsculpt.render.scene.painted_faces import PaintedFaces
from flowsculpt.render.scene.render_camera import Camera

INSIDE = 0.99
"""Winding number from which a point counts as inside a closed surface. Deep in an open vessel it is less."""

_CHUNK = 1 << 16
"""Faces per step of `winding_number`, which bounds its memory."""

_OFFSET = 1.0
"""Distance of ribbons in front of the surface, in their widths. With less, slopes hide half of them."""


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles to render. Vertices on a crease are split, one for each side.

    vertices    float32 (V, 3), scene units
    normals     float32 (V, 3), unit length
    faces       int32 (F, 3), counter-clockwise seen from outside
    attributes  by name, float32 (V, k)
    rest        float32 (V, 3), rest positions: where the points were before any flow moved them, or None.
                Patterns and textures need them
    edges       int32 (E, 2), edges that a wireframe shows; None for all edges of the faces
    paint       what a model's file has on the faces, or None

    SPEED       name of the attribute (V, 1) that the measure "speed" shows
    VALUES      name of the attribute (V, 2) that the measure "values" shows; see `with_known`
    """

    SPEED: ClassVar[str] = "speed"
    VALUES: ClassVar[str] = "values"

    vertices: NDArray[np.float32]
    normals: NDArray[np.float32]
    faces: NDArray[np.int32]
    attributes: Mapping[str, NDArray[np.float32]] = field(default_factory=dict)
    rest: NDArray[np.float32] | None = None
    edges: NDArray[np.int32] | None = None
    paint: PaintedFaces | None = None

    @property
    def bounds(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return the least and the greatest coordinates, (3,) each."""
        columns = self.vertices.T  # column by column is ten times as fast as all together
        return np.array([column.min() for column in columns]), np.array([column.max() for column in columns])

    def check(self) -> None:
        """Raise BadInputError for what Mitsuba would render wrongly, or crash on, without a message."""
        count = len(self.vertices)
        if not count or not len(self.faces):
            raise BadInputError("the surface is empty; it needs at least one triangle")
        for name, array in (("vertices", self.vertices), ("normals", self.normals)):
            if array.shape != (count, 3):
                raise BadInputError(f"the surface's {name} have shape {array.shape}; not ({count}, 3)")
            if not np.isfinite(array).all():
                bad = np.flatnonzero(~np.isfinite(array).all(axis=1))
                raise BadInputError(
                    f"the surface's {name} are not finite at vertex {bad[0]} and {len(bad) - 1} others; "
                    "the flow must keep them finite"
                )
        if self.faces.ndim != 2 or self.faces.shape[1] != 3:
            raise BadInputError(f"the surface's faces have shape {self.faces.shape}; they must be (F, 3)")
        if self.faces.min() < 0 or self.faces.max() >= count:
            raise BadInputError(
                f"a face names vertex {int(self.faces.max())} or {int(self.faces.min())}; there are {count}"
            )
        if self.edges is not None and (
            self.edges.ndim != 2
            or self.edges.shape[1] != 2
            or ((self.edges < 0) | (self.edges >= count)).any()
        ):
            raise BadInputError(f"the surface's edges must be (E, 2), and name some of its {count} vertices")
        for name, array in self.attributes.items():
            if array.ndim != 2 or len(array) != count or not np.isfinite(array).all():
                raise BadInputError(f"attribute {name!r} must be finite and have shape ({count}, k)")
        if self.rest is not None and (self.rest.shape != (count, 3) or not np.isfinite(self.rest).all()):
            raise BadInputError(f"the surface's rest positions must be finite and have shape ({count}, 3)")

    def with_copied_vertices(self, source: NDArray[np.integer], faces: NDArray[np.int32]) -> Surface:
        """Return the surface with vertex i a copy of vertex source[i], and faces (F, 3) of these copies."""
        return replace(
            self,
            vertices=self.vertices[source],
            normals=self.normals[source],
            faces=faces,
            attributes={name: values[source] for name, values in self.attributes.items()},
            rest=None if self.rest is None else self.rest[source],
            edges=None,
        )

    def require_rest(self, because: str) -> NDArray[np.float64]:
        """Return the rest positions (V, 3). Raise BadInputError where there are none.

        because  what needs them, for the message: "look has a pigment"
        """
        if self.rest is None:
            raise BadInputError(f"{because}, and the surface has no rest positions; give it `rest`")
        return np.asarray(self.rest, dtype=np.float64)


def require_camera_outside(surface: Surface, camera: Camera) -> None:
    """Raise BadInputError where the camera is inside a closed surface and would see its back."""
    origin = np.array(camera.origin)
    low, high = surface.bounds
    if not ((low < origin) & (origin < high)).all():
        return
    if abs(winding_number(surface, origin)) >= INSIDE:
        place = ", ".join(f"{x:.4g}" for x in camera.origin)
        raise BadInputError(
            f"the camera is inside the sculpture, at {place}; it sees only the inside. Move the camera "
            "farther away"
        )


def winding_number(surface: Surface, point: NDArray[np.float64]) -> float:
    """Return how often a surface winds around a point: 1 inside a closed surface, 0 outside.

    The sum of the solid angles of its triangles (van Oosterom and Strackee 1983), over that of a sphere.
    """
    total = 0.0
    for start in range(0, len(surface.faces), _CHUNK):
        corners = surface.vertices[surface.faces[start : start + _CHUNK]] - point
        a, b, c = corners.transpose(1, 0, 2)
        la, lb, lc = (np.linalg.norm(side, axis=1) for side in (a, b, c))
        numerator = np.einsum("ij,ij->i", a, np.cross(b, c))
        denominator = (
            la * lb * lc
            + np.einsum("ij,ij->i", a, b) * lc
            + np.einsum("ij,ij->i", b, c) * la
            + np.einsum("ij,ij->i", c, a) * lb
        )
        total += float(np.arctan2(numerator, denominator).sum())
    return 2.0 * total / (4.0 * math.pi)


@dataclass(frozen=True)
class Wireframe:
    """Colour and width of the lines along a surface's edges.

    colour  linear Rec.709 reflectance
    width   pixels of the picture
    """

    colour: Colour = (0.02, 0.02, 0.025)
    width: float = 1.0

    def __post_init__(self) -> None:
        if not (all(0.0 <= part <= 1.0 for part in self.colour) and 0.0 < self.width <= 100.0):
            raise BadInputError(
                f"wireframe has colour {self.colour} and width {self.width}; reflectances lie between 0 "
                "and 1, widths above 0 and up to 100 pixels"
            )


def ribbons(surface: Surface, wireframe: Wireframe, camera: Camera, pixels: int) -> Surface:
    """Return two triangles for each edge of the surface, for a picture `pixels` wide."""
    edges = _unique_edges(surface)
    ends = surface.vertices[edges].astype(np.float64)  # (E, 2, 3)
    normals = surface.normals[edges]
    view = ends - camera.origin
    pixel = camera.pixel_size(pixels) * np.maximum(camera.depths(ends), 0.0)
    width = (wireframe.width * pixel)[..., None]
    sideways = np.cross(ends[:, 1] - ends[:, 0], view[:, 0])
    length = np.linalg.norm(sideways, axis=1)
    kept = length > 0.0
    sideways = (sideways[kept] / length[kept, None])[:, None]
    to_camera = -view[kept] / np.linalg.norm(view[kept], axis=2, keepdims=True)
    middle = ends[kept] + _OFFSET * width[kept] * to_camera
    half = 0.5 * width[kept] * sideways
    vertices = np.stack([middle - half, middle + half], axis=2).reshape(-1, 3)
    shading = np.repeat(normals[kept][:, :, None], 2, axis=2).reshape(-1, 3)
    first = 4 * np.arange(int(kept.sum()), dtype=np.int32)[:, None]
    faces = np.concatenate([first + np.array([0, 2, 1]), first + np.array([1, 2, 3])]).astype(np.int32)
    return Surface(vertices.astype(np.float32), shading, faces)


def outlines(faces: NDArray[np.int32], pieces: int) -> NDArray[np.int32]:
    """Return the edges (E, 2) of the original triangles, each cut into pieces² consecutive
    faces.

    Edges of the original belong to one piece of their triangle, edges between pieces to two.
    """
    count = pieces * pieces
    edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]], axis=2).reshape(len(faces) // count, 3 * count, 2)
    code = edges[..., 0].astype(np.int64) << 32 | edges[..., 1]
    order = np.argsort(code, axis=1, kind="stable")
    ranked = np.take_along_axis(code, order, axis=1)
    same = ranked[:, 1:] == ranked[:, :-1]
    edge = np.zeros((len(code), 1), dtype=bool)
    alone = ~(np.hstack([same, edge]) | np.hstack([edge, same]))
    kept = np.unique(ranked[alone])
    return np.stack([kept >> 32, kept & 0xFFFFFFFF], axis=1).astype(np.int32)


def _unique_edges(surface: Surface) -> NDArray[np.int32]:
    """Return every edge (E, 2) once, though vertices on creases are split."""
    edges = outlines(surface.faces, 1) if surface.edges is None else surface.edges
    _, position = np.unique(surface.vertices, axis=0, return_inverse=True)
    joined = np.sort(position.reshape(-1)[edges], axis=1)
    _, first = np.unique(joined, axis=0, return_index=True)
    return np.asarray(edges[np.sort(first)], dtype=np.int32)


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
