"""Lines over a surface along its edges, of the same width everywhere in the picture.

Each edge becomes a ribbon that faces the lens, a little before the surface. So lines lie on every look, are
smoothed and lit as the rest of the picture is, and show where the denoiser must keep them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from render.base.errors import BadInputError
from render.base.serialise import Triple
from render.scene.camera import Camera
from render.scene.surface import Surface

Rows = NDArray[np.float64]

_BEFORE = 1.0
"""How far before the surface ribbons lie, in their widths: less, and slopes hide half of them."""


@dataclass(frozen=True)
class Wireframe:
    """How edges are drawn.

    colour  linear Rec.709 reflectance
    width   pixels of the picture
    """

    colour: Triple = (0.02, 0.02, 0.025)
    width: float = 1.0

    def __post_init__(self) -> None:
        if not (all(0.0 <= part <= 1.0 for part in self.colour) and 0.0 < self.width <= 100.0):
            raise BadInputError(
                f"wireframe has colour {self.colour} and width {self.width}; reflectances lie between 0 "
                "and 1, widths above 0 and up to 100 pixels"
            )

    def material(self) -> dict[str, Any]:
        ink = {"type": "diffuse", "reflectance": {"type": "rgb", "value": list(self.colour)}}
        return {"type": "twosided", "material": ink}


def ribbons(surface: Surface, wireframe: Wireframe, camera: Camera, pixels: int) -> Surface:
    """The lines of a picture so many pixels wide: two triangles for each of the surface's edges."""
    edges = _once(surface)
    ends = surface.vertices[edges].astype(np.float64)  # (E, 2, 3)
    normals = surface.normals[edges]
    view = ends - camera.origin
    ahead = camera.axes()[2]
    pixel = 2.0 * math.tan(camera.field_of_view / 2.0) / pixels * np.maximum(view @ ahead, 0.0)
    width = (wireframe.width * pixel)[..., None]
    sideways = np.cross(ends[:, 1] - ends[:, 0], view[:, 0])
    length = np.linalg.norm(sideways, axis=1)
    seen = length > 0.0
    sideways = (sideways[seen] / length[seen, None])[:, None]
    towards = -view[seen] / np.linalg.norm(view[seen], axis=2, keepdims=True)
    middle = ends[seen] + _BEFORE * width[seen] * towards
    half = 0.5 * width[seen] * sideways
    vertices = np.stack([middle - half, middle + half], axis=2).reshape(-1, 3)
    shading = np.repeat(normals[seen][:, :, None], 2, axis=2).reshape(-1, 3)
    first = 4 * np.arange(int(seen.sum()), dtype=np.int32)[:, None]
    faces = np.concatenate([first + np.array([0, 2, 1]), first + np.array([1, 2, 3])]).astype(np.int32)
    return Surface(vertices.astype(np.float32), shading, faces)


def outlines(faces: NDArray[np.int32], pieces: int) -> NDArray[np.int32]:
    """(E, 2): the edges of triangles that were each cut into pieces² triangles, one after the other.

    Those are the edges that belong to one of the pieces only; those between pieces belong to two.
    """
    each = pieces * pieces
    edges = np.sort(_edges_of(faces.reshape(-1, 3)), axis=1).reshape(len(faces) // each, 3 * each, 2)
    code = edges[..., 0].astype(np.int64) << 32 | edges[..., 1]
    order = np.argsort(code, axis=1, kind="stable")
    ranked = np.take_along_axis(code, order, axis=1)
    same = ranked[:, 1:] == ranked[:, :-1]
    edge = np.zeros((len(code), 1), dtype=bool)
    alone = ~(np.hstack([same, edge]) | np.hstack([edge, same]))
    kept = np.unique(ranked[alone])
    return np.stack([kept >> 32, kept & 0xFFFFFFFF], axis=1).astype(np.int32)


def _edges_of(faces: NDArray[np.int32]) -> NDArray[np.int32]:
    """(3F, 2), those of a face one after the other."""
    return faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)


def _once(surface: Surface) -> NDArray[np.int32]:
    """(E, 2): every edge once, whichever side of a crease its vertices belong to."""
    edges = outlines(surface.faces, 1) if surface.edges is None else surface.edges
    _, place = np.unique(surface.vertices, axis=0, return_inverse=True)
    there = np.sort(place.reshape(-1)[edges], axis=1)
    _, first = np.unique(there, axis=0, return_index=True)
    return np.asarray(edges[np.sort(first)], dtype=np.int32)
