"""Triangle surfaces as they are rendered: vertices with normals, split where creases look sharp."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from render.base.errors import BadInputError
from render.scene.camera import Camera

INSIDE = 0.99
"""Winding number from which a point counts as inside a closed surface. Deep in an open vessel it is less."""

_CHUNK = 1 << 16
"""Faces per step of `winding_number`, which bounds its memory."""


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
            f"the camera is inside the sculpture, at {place}; it sees nothing but its back. Move the camera "
            "away, or aim it from farther off"
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
