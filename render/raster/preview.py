"""Render a quick preview of a surface on its stage. Takes one thread, without the interpreter's lock."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from render.base.serialise import Triple
from render.raster.canvas import Canvas, displayed
from render.raster.contact import ContactShadow
from render.raster.key_light import ShadowMap
from render.raster.large_triangles import SUPERSAMPLING
from render.raster.raster_shapes import Floats, Shape, StageSetup, VisibleFaces, stage_shape
from render.raster.reflectance import contact_opacity
from render.raster.see_through import lay_over, seen_through, unpack_light
from render.raster.triangles import draw_edges, draw_lines
from render.raster.visible_points import VisiblePoints, add_thickness
from render.scene.materials import LOOKS
from render.scene.render_camera import Camera
from render.scene.scene_lights import LIGHTS
from render.scene.scene_stage import STAGES, StagePlacement

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
    others: Sequence[Shape] = (),
) -> Preview:
    """Render a surface on its stage.

    size    width and height in pixels
    others  further subjects. Those that light passes through look as if they were of one material, the first
            one's
    """
    setup = replace(setup, lights=setup.lights.without_maps())
    shapes = [shape.for_kernels() for shape in (subject, *others)]
    opaque = [shape for shape in shapes if not shape.material.is_clear]
    clear = [shape for shape in shapes if shape.material.is_clear]
    whole = _joined([*opaque, *clear])
    has_floor, opacity = setup.stage.kind != "none", contact_opacity(whole.material)
    contact = ContactShadow.of(whole.vertices, setup.placement, has_floor, opacity)
    canvas = Canvas.of(camera, setup, contact, size, "" if clear else display, edges is not None)
    faces = VisibleFaces.of(whole, canvas.projection, canvas.nearness.shape)
    shadow = ShadowMap.of(faces.shape, setup, faces.outwards)
    drawn = 0
    for shape in opaque:
        canvas.draw(_faces_of(shape, faces, canvas), shadow, drawn)
        drawn += len(shape.faces)
    if setup.stage.kind != "none":
        stage = stage_shape(setup.stage, setup.placement, setup.fades)
        stage_faces = VisibleFaces.of(stage, canvas.projection, canvas.nearness.shape)
        canvas.draw(stage_faces, shadow, len(whole.faces), is_stage=True)
    if clear:
        picture = _through(canvas, _faces_of(_joined(clear), faces, canvas), shadow, display)
    else:
        picture = canvas.picture()
    if edges is not None:
        ink = np.array([*edges.colour, edges.opacity, edges.width])
        draw_edges(faces.screen, faces.shape.faces, canvas.face_ids, ink, picture)
    middle = SUPERSAMPLING // 2
    return Preview(picture, canvas.nearness[middle::SUPERSAMPLING, middle::SUPERSAMPLING])


def _faces_of(shape: Shape, whole: VisibleFaces, canvas: Canvas) -> VisibleFaces:
    """Return the faces of a shape that may be visible; those of the whole where that is the shape."""
    if len(shape.faces) == len(whole.shape.faces):
        return whole
    return VisibleFaces.of(shape, canvas.projection, canvas.nearness.shape)


def _joined(shapes: Sequence[Shape]) -> Shape:
    """Return one shape of all, with the material of the first; each keeps its colours."""
    first = shapes[0]
    if len(shapes) == 1:
        return first
    starts = np.cumsum([0, *(len(shape.vertices) for shape in shapes[:-1])])
    colours = [
        np.broadcast_to(
            shape.material.colour if shape.colours is None else shape.colours, shape.vertices.shape
        )
        for shape in shapes
    ]
    return Shape(
        np.concatenate([shape.vertices for shape in shapes]),
        np.concatenate([shape.normals for shape in shapes]),
        np.concatenate([shape.faces + start for shape, start in zip(shapes, starts, strict=True)]),
        first.material,
        np.concatenate(colours),
        all(shape.closed for shape in shapes),
    ).for_kernels()


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
