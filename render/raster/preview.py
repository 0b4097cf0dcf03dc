"""Render a quick preview of a surface on its stage. Takes one thread, without the interpreter's lock."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from render.base.serialise import Triple
from render.raster.canvas import Canvas, displayed
from render.raster.contact import ContactShadow
from render.raster.key_light import ShadowMap
from render.raster.large_triangles import SUPERSAMPLING
from render.raster.reflectance import contact_opacity
from render.raster.see_through import VisiblePoints, lay_over, seen_through, unpack_light
from render.raster.shapes import Floats, Shape, StageSetup, VisibleFaces, stage_shape
from render.raster.thickness import add_thickness
from render.raster.triangles import draw_edges, draw_lines
from render.scene.camera import Camera
from render.scene.lights import LIGHTS
from render.scene.materials import LOOKS
from render.scene.stage import STAGES, StagePlacement

HIDDEN_OPACITY = 0.1
"""Factor on the opacity of lines behind the surface."""


class Edges(NamedTuple):
    """Display colour, opacity and width in pixels of the edges of faces."""

    colour: Triple = (0.06, 0.07, 0.08)
    opacity: float = 0.55
    width: float = 0.6


class Preview(NamedTuple):
    """picture: display values (H, W, 3), 0 … 1; nearness (H, W): one over the depth, 0 for no surface."""

    picture: NDArray[np.float32]
    nearness: NDArray[np.float32]

    @property
    def depth(self) -> Floats:
        """Depth (H, W) next to the middle of pixels; infinite for no surface."""
        with np.errstate(divide="ignore"):
            return 1.0 / self.nearness.astype(np.float64)


def preview(
    subject: Shape,
    setup: StageSetup,
    camera: Camera,
    size: tuple[int, int],
    display: str,
    edges: Edges | None = None,
) -> Preview:
    """Render a surface on its stage. size: width and height in pixels"""
    setup = replace(setup, lights=setup.lights.without_maps())
    subject = subject.for_kernels()
    has_floor, opacity = setup.stage.kind != "none", contact_opacity(subject.material)
    contact = ContactShadow.of(subject.vertices, setup.placement, has_floor, opacity)
    is_clear = subject.material.is_clear
    canvas = Canvas.of(camera, setup, contact, size, "" if is_clear else display, edges is not None)
    faces = VisibleFaces.of(subject, canvas.projection, canvas.nearness.shape)
    shadow = ShadowMap.of(faces.shape, setup, faces.outwards)
    if not is_clear:
        canvas.draw(faces, shadow)
    if setup.stage.kind != "none":
        stage = stage_shape(setup.stage, setup.placement)
        stage_faces = VisibleFaces.of(stage, canvas.projection, canvas.nearness.shape)
        canvas.draw(stage_faces, shadow, len(subject.faces), is_stage=True)
    picture = _through(canvas, faces, shadow, display) if is_clear else canvas.picture()
    if edges is not None:
        ink = np.array([*edges.colour, edges.opacity, edges.width])
        draw_edges(faces.screen, faces.shape.faces, canvas.face_ids, ink, picture)
    middle = SUPERSAMPLING // 2
    return Preview(picture, canvas.nearness[middle::SUPERSAMPLING, middle::SUPERSAMPLING])


def with_lines(
    shown: Preview, lines: Floats, colours: Floats, opacity: Floats, camera: Camera, width: float
) -> NDArray[np.float32]:
    """Return the picture with lines (N, K, 3) over it, of colours (N, K, 3) and opacity (N, K) at their
    points.

    Parts behind the surface are faint. Far lines are drawn first.
    """
    depth = shown.depth
    height, columns = depth.shape
    points = camera.project(lines.reshape(-1, 3), columns / height).reshape(lines.shape)
    points[..., 0] = (points[..., 0] + 1.0) / 2.0 * columns
    points[..., 1] = (1.0 - points[..., 1]) / 2.0 * height
    order = np.argsort(-points[..., 2].mean(axis=1))
    points, inks = points[order], np.concatenate([colours, opacity[..., None]], axis=2)[order]
    ends = np.stack([points[:, :-1], points[:, 1:]], axis=2).reshape(-1, 2, 3)
    segment_inks = ((inks[:, :-1] + inks[:, 1:]) / 2.0).reshape(-1, 4)
    picture = shown.picture.astype(np.float64)
    ends, segment_inks = np.ascontiguousarray(ends), np.ascontiguousarray(segment_inks)
    draw_lines(ends, segment_inks, width, HIDDEN_OPACITY, depth, picture)
    return picture.astype(np.float32)


def prepare() -> None:
    """Compile the kernels, so that the first preview does not wait for it."""
    corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    setup = StageSetup(LIGHTS["studio"], STAGES["cyclorama"], StagePlacement())
    camera = Camera((0.0, 0.0, 6.0), (0.0, 0.0, 0.0))
    shape = Shape(corners, corners, np.array([[0, 1, 2]], np.int32), LOOKS["clay"])
    shown = preview(shape, setup, camera, (8, 4), "rec709", Edges())
    preview(shape._replace(material=LOOKS["glass"]), setup, camera, (8, 4), "rec709")
    with_lines(shown, np.zeros((1, 2, 3)), np.zeros((1, 2, 3)), np.ones((1, 2)), camera, 1.0)


def _through(canvas: Canvas, faces: VisibleFaces, shadow: ShadowMap, display: str) -> NDArray[np.float32]:
    """Draw a clear subject over its stage, and return the picture (H, W, 3)."""
    packed, behind = canvas.picture(), canvas.nearness.copy()
    background = np.empty_like(packed)
    unpack_light(packed, background)
    canvas.draw_normals(faces, shadow)
    points = VisiblePoints.of(canvas.nearness, behind, canvas.colour, canvas.projection)
    thickness, layers = np.zeros(packed.shape[:2], np.float32), np.zeros((*packed.shape[:2], 2), np.int32)
    add_thickness(faces.shape.faces, faces.screen, faces.outwards or 1, thickness, layers)
    light = seen_through(
        points, faces.shape, canvas.lighting, canvas.projection, thickness, layers, background
    )
    whole = points.coverage == 1.0
    background[tuple(points.pixels[whole].T)] = light[whole]
    picture = displayed(background, canvas.setup, display)
    edge = displayed(light[~whole], canvas.setup, display)
    lay_over(points.pixels[~whole], points.coverage[~whole], edge, picture)
    return picture
