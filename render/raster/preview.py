"""Render a quick preview of a surface on its stage. Takes one thread, without the interpreter's lock."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from render.base.serialise import Triple
from render.post.colour import to_display
from render.raster.contact import ContactShadow
from render.raster.large_triangles import SUPERSAMPLING, LargeTriangles
from render.raster.lighting import Lighting, ShadowMap, apply_shadow
from render.raster.projection import LARGE, SMALL
from render.raster.shapes import Floats, ScreenProjection, Shape, StageSetup, VisibleFaces, stage_shape
from render.raster.triangles import average, draw_edges, draw_lines, draw_triangles, pack
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
    contact = ContactShadow.of(subject.vertices, setup.placement, setup.stage.kind != "none")
    canvas = _Canvas.of(camera, setup, contact, size, display, edges is not None)
    faces = VisibleFaces.of(subject, canvas.projection, canvas.nearness.shape)
    shadow = ShadowMap.of(faces.shape, setup, faces.outwards)
    canvas.draw(faces, shadow)
    if setup.stage.kind != "none":
        stage = stage_shape(setup.stage, setup.placement)
        stage_faces = VisibleFaces.of(stage, canvas.projection, canvas.nearness.shape)
        canvas.draw(stage_faces, shadow, len(subject.faces), is_stage=True)
    picture = canvas.picture()
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
    with_lines(shown, np.zeros((1, 2, 3)), np.zeros((1, 2, 3)), np.ones((1, 2)), camera, 1.0)


@dataclass(frozen=True, eq=False)
class _Canvas:
    """A picture to draw shapes into, SUPERSAMPLING times as fine as the result.

    nearness, colour and face_ids as the kernel `draw_triangles` takes them
    """

    projection: ScreenProjection
    lighting: Lighting
    setup: StageSetup
    display: str
    nearness: NDArray[np.float32]
    colour: NDArray[np.uint32]
    face_ids: NDArray[np.int32]

    @classmethod
    def of(
        cls,
        camera: Camera,
        setup: StageSetup,
        contact: ContactShadow,
        size: tuple[int, int],
        display: str,
        has_face_ids: bool,
    ) -> _Canvas:
        width, height = size
        shape = SUPERSAMPLING * height, SUPERSAMPLING * width
        background = _displayed(np.array([setup.lights.sky.horizon], np.float32), setup, display)[0]
        return cls(
            ScreenProjection.of(camera, width / height),
            Lighting.of(setup, contact, camera),
            setup,
            display,
            np.zeros(shape, np.float32),
            np.full(shape, pack(*background), np.uint32),
            np.full(shape if has_face_ids else (0, 0), -1, np.int32),
        )

    def draw(self, faces: VisibleFaces, shadow: ShadowMap, first_id: int = 0, is_stage: bool = False) -> None:
        """Draw triangles with hidden surfaces removed. first_id: id of the shape's first face"""
        colours = self._vertex_colours(faces, shadow, is_stage)
        large = self._large_triangles(faces, shadow, is_stage)
        for order in faces.orders:
            draw_triangles(
                order,
                faces.shape.faces,
                first_id,
                faces.screen,
                colours,
                large,
                self.nearness,
                self.colour,
                self.face_ids,
            )

    def _vertex_colours(self, faces: VisibleFaces, shadow: ShadowMap, is_stage: bool) -> NDArray[np.float32]:
        """Return display values (V, 3) of the corners of small triangles."""
        shape, which = faces.shape, faces.corners_of(SMALL)
        light = np.empty((len(which), 3), np.float32)
        apply_shadow(
            self.lighting.shade(shape, which, faces.outwards, is_stage),
            shadow.visibility(shadow.coordinates(shape, which, faces.outwards)),
            light,
        )
        colours = np.empty((len(shape.vertices), 3), np.float32)
        colours[which] = _displayed(light, self.setup, self.display)
        return colours

    def _large_triangles(self, faces: VisibleFaces, shadow: ShadowMap, is_stage: bool) -> LargeTriangles:
        """Return the inputs of large triangles."""
        shape, which = faces.shape, faces.corners_of(LARGE)
        values = np.empty((len(shape.vertices) if len(which) else 0, 11), np.float32)
        light = self.lighting.shade(shape, which, faces.outwards, is_stage).reshape(-1, 3)
        values[which, :6] = _displayed(light, self.setup, self.display).reshape(-1, 6)
        values[which, 6:9] = shadow.coordinates(shape, which, faces.outwards).T
        contact = self.lighting.contact
        values[which, 9:] = contact.coordinates(shape.vertices[which]) if is_stage else -1.0
        pixels = self.nearness.size // SUPERSAMPLING**2
        hits, values_at_hits = np.empty((4, pixels), np.int32), np.empty((14, pixels), np.float32)
        return LargeTriangles(
            shape.vertices,
            *self.projection,
            values,
            shadow.nearness,
            shadow.blocks,
            contact.open,
            hits,
            values_at_hits,
        )

    def picture(self) -> NDArray[np.float32]:
        """Return the picture (H, W, 3)."""
        rows, columns = self.nearness.shape
        picture = np.empty((rows // SUPERSAMPLING, columns // SUPERSAMPLING, 3), np.float32)
        average(self.colour, picture)
        return picture


def _displayed(light: NDArray[np.float32], setup: StageSetup, display: str) -> NDArray[np.float32]:
    """Return display values (N, 3) of linear light (N, 3)."""
    return to_display(light[None], setup.lights.exposure, display, setup.view).reshape(light.shape)
