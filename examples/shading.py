"""Shaded pictures by the project's own renderer, with the edges of the mesh drawn over them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from examples.drawing import INK
from flowsculpt.pipeline.arrays import AnyArray
from flowsculpt.pipeline.mesh import PolygonMesh, TriangleMesh, split_at_creases
from flowsculpt.pipeline.production.request.framing import Framer, Framing
from flowsculpt.pipeline.shot.camera_path import View
from flowsculpt.render.frame.render_frame import render_frame
from flowsculpt.render.mitsuba.engine import choose
from flowsculpt.render.post.colour import quantise, to_display
from flowsculpt.render.post.denoise import denoise
from flowsculpt.render.scene.materials import LOOKS, Material
from flowsculpt.render.scene.render_quality import Quality
from flowsculpt.render.scene.scene import Scene
from flowsculpt.render.scene.scene_lights import LIGHTS, LightRig
from flowsculpt.render.scene.scene_stage import Stage
from flowsculpt.render.scene.surface import Surface

if TYPE_CHECKING:
    from matplotlib.axes import Axes

BRIGHT = Stage(colour=(0.8, 0.8, 0.79))
"""A white cyclorama, for pictures on a white page."""

_STEPS = 12  # pieces of an edge, each of which is seen or hidden
_BEHIND = 0.004  # of the distance: what lies this much deeper than the picture shows is hidden


@dataclass(frozen=True)
class Rendering:
    """pixels (H, W, 3) of 8 bits; depth (H, W), the distance from the camera; and the framing."""

    pixels: AnyArray
    depth: AnyArray
    framing: Framing


def frame_mesh(
    mesh: TriangleMesh, azimuth: float, elevation: float, aspect: float, margin: float = 0.1
) -> Framing:
    """Return the framing of one mesh; angles in degrees, `aspect` is width over height."""
    view = View(math.radians(azimuth), math.radians(elevation), math.radians(26), margin)
    return Framer(([view]), lambda _: mesh.vertices, aspect).all()[0]


def render_mesh(
    mesh: TriangleMesh,
    framing: Framing,
    size: tuple[int, int],
    look: Material = LOOKS["clay"],
    lights: LightRig = LIGHTS["studio"],
    stage: Stage = BRIGHT,
    exposure: float = 0.4,
    samples: int = 16,
) -> Rendering:
    """Render a mesh, its normals averaged up to 40 degrees; `size` is width and height in pixels."""
    shaded = split_at_creases(mesh, math.radians(40))
    surface = Surface(shaded.vertices.astype(np.float32), shaded.normals.astype(np.float32), shaded.faces)
    quality = Quality(*size, samples=samples, depth=6, auxiliary_samples=16)
    scene = Scene(surface, look, lights, stage, framing.placement, framing.camera)
    layers = render_frame(scene, quality, seed=1, engine=choose())
    light = denoise(layers) * np.float32(2.0 ** (lights.exposure + exposure))
    return Rendering(quantise(to_display(light, display="srgb")), layers["depth"], framing)


def show(panel: Axes, picture: Rendering) -> None:
    """Draw the picture alone, pixel for pixel."""
    height, width = picture.pixels.shape[:2]
    panel.imshow(picture.pixels, extent=(0, width, height, 0))
    panel.set(xlim=(0, width), ylim=(height, 0), aspect="equal", anchor="NW")
    panel.set_axis_off()


def draw_edges(
    panel: Axes, picture: Rendering, mesh: TriangleMesh, width: float = 0.3, colour: str = INK
) -> None:
    """Draw the visible edges over the picture; its depth tells which are hidden."""
    from matplotlib.collections import LineCollection

    high, wide = picture.depth.shape
    ends = mesh.vertices[PolygonMesh.from_triangles(mesh).edges]
    share = np.linspace(0.0, 1.0, _STEPS + 1)[:, None, None]
    points = (1 - share) * ends[:, 0] + share * ends[:, 1]
    camera = picture.framing.camera
    x, y, _ = camera.project(points.reshape(-1, 3), wide / high).T
    at = np.stack([(x + 1) / 2 * wide, (1 - y) / 2 * high], axis=-1).reshape(_STEPS + 1, -1, 2)
    middle = (at[1:] + at[:-1]) / 2
    distance = np.linalg.norm((points[1:] + points[:-1]) / 2 - camera.origin, axis=2)
    column, row = (np.clip(middle[..., k].astype(int), 0, (wide, high)[k] - 1) for k in (0, 1))
    seen = distance < picture.depth[row, column] * (1 + _BEHIND)
    pieces = np.stack([at[:-1], at[1:]], axis=2)[seen]
    panel.add_collection(
        LineCollection(pieces, colors=colour, linewidths=width, alpha=0.75, capstyle="round")
    )
