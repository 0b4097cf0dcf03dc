"""One frame of a shot as a quick picture, with edges, streamlines and burn-ins over it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import AnyArray, Floats
from pipeline.dailies.preview.streamlines import StreamlineSet, streamlines
from pipeline.mesh import icosphere
from pipeline.production.render_inputs.framing import Framing
from pipeline.production.request.render_request import RenderRequest
from render.graphics.burn_in import BurnIn
from render.movie.sequences import timecode
from render.post.colour import quantise
from render.raster import Edges, Shape, StageSetup, preview, with_lines
from render.scene.materials import Material
from render.scene.measure import SPEED
from render.scene.surface import Surface
from render.scene.vertex_colours import vertex_colours

MOST_BALLS = 20_000
"""Most points of a cloud that are drawn; of more points a part is drawn, with larger balls."""

LINE = 1 / 600
"""Width of a streamline, over that of the picture."""

SLOW, MIDDLE, FAST = (0.10, 0.36, 0.56), (0.86, 0.63, 0.16), (0.80, 0.24, 0.14)
"""Display colours of streamlines, from still to the fastest."""


@dataclass(frozen=True)
class Sketch:
    """The style in which frames of a shot are drawn.

    flow     draw streamlines
    edges    draw the edges of faces
    burn_in  fields that are written over the picture
    closed   True if the surface has no boundary, so that its inner side is never seen
    """

    request: RenderRequest
    flow: bool = False
    edges: bool = False
    burn_in: BurnIn | None = None
    closed: bool = False

    def picture(
        self,
        number: int,
        arrays: Mapping[str, AnyArray],
        framing: Framing,
        size: tuple[int, int],
        display: str,
    ) -> NDArray[Any]:
        """Draw a frame as uint8 (H, W, 3). Raises FrameError where the flow fails."""
        picture = self.request.shot.picture
        around = StageSetup(picture.lights, picture.stage, framing.placement, picture.view)
        shape = shape_of(arrays, picture.look)._replace(closed=self.closed)
        shown = preview(shape, around, framing.camera, size, display, Edges() if self.edges else None)
        light = shown.picture
        if self.flow:
            lines = streamlines(self.request.shot.motion, number, arrays["vertices"].astype(np.float64))
            width = max(1.0, LINE * size[0])
            light = with_lines(shown, lines.points, *line_colours(lines), framing.camera, width)
        flat: NDArray[Any] = quantise(light)
        return flat if self.burn_in is None else self.burn_in.over(flat, self._facts(number))

    def _facts(self, number: int) -> dict[str, str | int]:
        rate = self.request.shot.rate
        return {
            "shot": self.request.name,
            "frame": number,
            "timecode": timecode(number, rate.fps),
            "quality": "preview",
            "key": self.request.mesh_key(number)[:8],
        }


def shape_of(arrays: Mapping[str, AnyArray], look: Material) -> Shape:
    """Return the shape of a frame's arrays; of a cloud, a small ball for each point."""
    brought = {SPEED: arrays[SPEED]} if SPEED in arrays else {}
    vertices, none = arrays["vertices"], np.empty((0, 3), np.int32)
    normals, faces = arrays.get("normals", vertices), arrays.get("faces", none)
    shown = vertex_colours(Surface(vertices, normals, faces, brought, arrays["material"]), look)
    if "radii" not in arrays:
        return Shape(vertices, normals, faces, look, shown)
    every = -(-len(arrays["vertices"]) // MOST_BALLS)
    points, radii = arrays["vertices"][::every], arrays["radii"][::every] * every ** (1 / 3)
    ball = icosphere(2)
    around, many = ball.vertices, len(ball.vertices)
    vertices = (points[:, None] + radii[:, None, None] * around).reshape(-1, 3)
    faces = (ball.faces + many * np.arange(len(points), dtype=np.int32)[:, None, None]).reshape(-1, 3)
    shaded = None if shown is None else shown[::every].repeat(many, axis=0)
    return Shape(vertices, np.tile(around, (len(points), 1)), faces.astype(np.int32), look, shaded)


def is_closed(arrays: Mapping[str, AnyArray]) -> bool:
    """Tell whether every edge of a surface has two faces, which then holds for every frame of a shot."""
    if "faces" not in arrays:
        return True
    faces = arrays["source_vertex"][arrays["faces"]].astype(np.int64)
    begin, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    many = int(faces.max()) + 1
    return np.array_equal(np.sort(begin * many + end), np.sort(end * many + begin))


def line_colours(lines: StreamlineSet) -> tuple[Floats, Floats]:
    """Return colours (N, K, 3) by speed, and opacities (N, K) that fade at both ends."""
    fast = float(np.quantile(lines.speeds, 0.95)) if lines.speeds.size else 1.0
    share = np.clip(lines.speeds / max(fast, 1e-300), 0.0, 1.0)
    stops = np.array([SLOW, MIDDLE, FAST])
    colours = np.stack([np.interp(share, (0.0, 0.5, 1.0), stops[:, k]) for k in range(3)], axis=-1)
    along = np.linspace(0.0, np.pi, lines.speeds.shape[1])
    return colours, np.clip(np.sin(along), 0.0, 1.0)[None] ** 0.7 * (0.4 + 0.55 * share)
