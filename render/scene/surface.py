"""Triangle surfaces as they are rendered, with normals, split where creases look sharp; and their wireframes.

Each edge of a wireframe becomes a ribbon that faces the camera, a little in front of the surface. So lines
are equally wide everywhere in the picture, work with every material, are antialiased and lit like the rest of
the picture, and appear in the denoiser's auxiliary AOVs.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from render.base.render_errors import BadInputError
from render.base.serialise import Colour
from render.scene.render_camera import Camera

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
    """

    vertices: NDArray[np.float32]
    normals: NDArray[np.float32]
    faces: NDArray[np.int32]
    attributes: Mapping[str, NDArray[np.float32]] = field(default_factory=dict)
    rest: NDArray[np.float32] | None = None
    edges: NDArray[np.int32] | None = None

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
