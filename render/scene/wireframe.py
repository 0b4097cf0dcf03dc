"""Wireframes: lines along the edges of a surface, equally wide everywhere in the picture.

Each edge becomes a ribbon that faces the camera, a little in front of the surface. So lines work with every
material, are antialiased and lit like the rest of the picture, and appear in the denoiser's auxiliary AOVs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from render.base.errors import BadInputError
from render.base.serialise import Triple
from render.scene.camera import Camera
from render.scene.surface import Surface

Rows = NDArray[np.float64]

_OFFSET = 1.0
"""Distance of ribbons in front of the surface, in their widths. With less, slopes hide half of them."""


@dataclass(frozen=True)
class Wireframe:
    """Colour and width of the lines.

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


def ribbons(surface: Surface, wireframe: Wireframe, camera: Camera, pixels: int) -> Surface:
    """Return two triangles for each edge of the surface, for a picture `pixels` wide."""
    edges = _unique_edges(surface)
    ends = surface.vertices[edges].astype(np.float64)  # (E, 2, 3)
    normals = surface.normals[edges]
    view = ends - camera.origin
    forward = camera.axes()[2]
    pixel = 2.0 * math.tan(camera.field_of_view / 2.0) / pixels * np.maximum(view @ forward, 0.0)
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
    """Return the edges (E, 2) of the original triangles, of which each was cut into pieces² consecutive
    faces.

    Edges of the original belong to one piece of their triangle, edges between pieces to two.
    """
    count = pieces * pieces
    edges = np.sort(_edges_of(faces.reshape(-1, 3)), axis=1).reshape(len(faces) // count, 3 * count, 2)
    code = edges[..., 0].astype(np.int64) << 32 | edges[..., 1]
    order = np.argsort(code, axis=1, kind="stable")
    ranked = np.take_along_axis(code, order, axis=1)
    same = ranked[:, 1:] == ranked[:, :-1]
    edge = np.zeros((len(code), 1), dtype=bool)
    alone = ~(np.hstack([same, edge]) | np.hstack([edge, same]))
    kept = np.unique(ranked[alone])
    return np.stack([kept >> 32, kept & 0xFFFFFFFF], axis=1).astype(np.int32)


def _edges_of(faces: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return the edges (3F, 2) of faces, those of a face one after the other."""
    return faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)


def _unique_edges(surface: Surface) -> NDArray[np.int32]:
    """Return every edge (E, 2) once, though vertices on creases are split."""
    edges = outlines(surface.faces, 1) if surface.edges is None else surface.edges
    _, position = np.unique(surface.vertices, axis=0, return_inverse=True)
    joined = np.sort(position.reshape(-1)[edges], axis=1)
    _, first = np.unique(joined, axis=0, return_index=True)
    return np.asarray(edges[np.sort(first)], dtype=np.int32)
