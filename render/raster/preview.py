"""Render a quick preview of a surface on its stage. Takes one thread, without the interpreter's lock.

Triangles are drawn with straight edges, which a wide projection bends: a wide picture is resampled from those
of the faces of a cube around the camera.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.base.serialise import Triple
from flowsculpt.render.post.colour import to_display
from flowsculpt.render.post.view import ColourView
from flowsculpt.render.raster.lighting import Lighting, apply_shadow, floor_light
from flowsculpt.render.raster.preview_air import SeenAir
from flowsculpt.render.raster.preview_sky import seen_radiance, with_suns
from flowsculpt.render.raster.raster_shapes import (
    LARGE,
    SMALL,
    Floats,
    ScreenProjection,
    Shape,
    StageSetup,
    VisibleFaces,
    body_colours,
    contact_opacity,
    stage_shapes,
)
from flowsculpt.render.raster.see_through import (
    VisiblePoints,
    add_thickness,
    lay_over,
    pack_light,
    pack_normals,
    seen_through,
    unpack_light,
)
from flowsculpt.render.raster.shadows import LOOKS_DARK, PACKED_DARK, ContactShadow, ShadowMap
from flowsculpt.render.raster.triangles import (
    SUPERSAMPLING,
    WHITE,
    LargeTriangles,
    Subsamples,
    average,
    draw_edges,
    draw_lines,
    draw_triangles,
    pack,
)
from flowsculpt.render.scene.materials import LOOKS
from flowsculpt.render.scene.render_camera import LEFT, RIGHT, Camera, WideCamera, pixel_places
from flowsculpt.render.scene.scene_lights import LIGHTS, LightRig
from flowsculpt.render.scene.scene_stage import STAGES, Stage, StagePlacement

Picture = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Canvas:
    """A picture to draw shapes into. display: of its values; empty for packed linear light"""

    projection: ScreenProjection
    lighting: Lighting
    display: str
    drawn: Subsamples

    @classmethod
    def of(
        cls, camera: Camera, lighting: Lighting, size: tuple[int, int], display: str, has_face_ids: bool
    ) -> Canvas:
        (width, height), setup = size, lighting.setup
        shape = SUPERSAMPLING * height, SUPERSAMPLING * width
        background = _values(np.zeros((1, 3), np.float32), setup, display)[0]
        drawn = Subsamples(
            np.zeros(shape, np.float32),
            np.full(shape, pack(*background), np.uint32),
            np.full(shape if has_face_ids else (0, 0), -1, np.int32),
        )
        return cls(ScreenProjection.of(camera, width / height), lighting, display, drawn)

    def visible(self, shape: Shape) -> VisibleFaces:
        """Return the faces of a shape that may be visible."""
        return VisibleFaces.of(shape, self.projection, self.drawn.nearness.shape)

    def draw(self, faces: VisibleFaces, shadow: ShadowMap, first_id: int = 0, is_stage: bool = False) -> None:
        """Draw triangles with hidden surfaces removed. first_id: id of the shape's first face"""
        colours = self._vertex_colours(faces, shadow, is_stage)
        self._draw(faces, colours, self._large_triangles(faces, shadow, is_stage), first_id)

    def draw_pigment(self, faces: VisibleFaces, shadow: ShadowMap, first_id: int) -> None:
        """Colour what is seen of a shape by its pigment, in every subsample.

        Light is linear in the colour of a body, so a black and a white body tell it for all colours.
        """
        ids = self.drawn.face_ids - first_id
        rows, columns = np.nonzero((ids >= 0) & (ids < len(faces.shape.faces)))
        seen, lit = ids[rows, columns], []
        for colour in (0.0, 1.0):
            nearness = np.zeros_like(self.drawn.nearness)
            drawn = Subsamples(nearness, np.zeros_like(self.drawn.colour), np.full((0, 0), -1, np.int32))
            shape = faces.shape._replace(colours=np.full((len(faces.shape.vertices), 3), colour))
            replace(self, display="", drawn=drawn).draw(replace(faces, shape=shape), shadow)
            lit.append(_unpack(drawn.colour[rows, columns]))
        colours = faces.shape.pigment_at(seen, faces.screen, np.stack([columns, rows], axis=1))
        material = faces.shape.material
        share = body_colours(material, colours) / body_colours(material, np.ones((1, 3)))
        light = (lit[0] + share * (lit[1] - lit[0])).astype(np.float32)
        self.drawn.colour[rows, columns] = _packed(_values(light, self.lighting.setup, self.display))

    def draw_normals(self, faces: VisibleFaces, shadow: ShadowMap) -> None:
        """Draw the normals of a shape, from 0 to 1 along each axis, in place of light."""
        values = np.empty_like(faces.shape.normals)
        pack_normals(faces.shape.normals, -1.0 if faces.outwards < 0 else 1.0, values)
        large = self._large_triangles(faces, shadow, False)
        if len(large.values):
            large.values[:, :6] = np.tile(values, 2)
        self._draw(faces, values, large._replace(opacity=0.0), 0)

    def draw_sky(self) -> None:
        """Draw what the lens sees of the sky where nothing has been drawn, a colour for each pixel."""
        setup, step = self.lighting.setup, SUPERSAMPLING
        if setup.fades or not setup.lights.shows_sky:
            return
        rows, columns = (side // step for side in self.drawn.nearness.shape)
        is_bare = (self.drawn.nearness == 0.0).reshape(rows, step, columns, step).any(axis=(1, 3))
        places = pixel_places(columns, rows)[is_bare]
        axes = self.projection.axes / np.sum(self.projection.axes**2, axis=1, keepdims=True)
        towards = places @ axes[:2] + axes[2]
        towards /= np.linalg.norm(towards, axis=1, keepdims=True)
        light = seen_radiance(setup.lights, towards).astype(np.float32)
        colours = np.zeros((rows, columns), np.uint32)
        colours[is_bare] = _packed(_values(light, setup, self.display))
        whole = np.repeat(np.repeat(colours, step, axis=0), step, axis=1)
        np.copyto(self.drawn.colour, whole, where=self.drawn.nearness == 0.0)

    def _draw(self, faces: VisibleFaces, colours: Picture, large: LargeTriangles, first_id: int) -> None:
        for order in faces.orders:
            draw_triangles(order, faces.shape.faces, first_id, faces.screen, colours, large, self.drawn)

    def _vertex_colours(self, faces: VisibleFaces, shadow: ShadowMap, is_stage: bool) -> Picture:
        """Return display values (V, 3) of the corners of small triangles."""
        shape, which = faces.shape, faces.corners_of(SMALL)
        light = np.empty((len(which), 3), np.float32)
        shaded = self.lighting.shade(shape, which, 1 if is_stage else faces.outwards, is_stage)
        apply_shadow(shaded, shadow.visibility(shadow.coordinates(shape, which, faces.outwards)), light)
        light = self._in_haze(light, shape.vertices[which], is_stage)
        colours = np.empty((len(shape.vertices), 3), np.float32)
        colours[which] = _values(light, self.lighting.setup, self.display)
        return colours

    def _in_haze(
        self, light: NDArray[np.float32], points: NDArray[np.float32], is_stage: bool
    ) -> NDArray[np.float32]:
        """Return the light (N, …, 3) of points (N, 3) of a stage whose horizon fades into that of the sky."""
        stage, placement = self.lighting.setup.stage, self.lighting.setup.placement
        if not (is_stage and stage.horizon_fade):
            return light
        there = stage.opacity_at((points - placement.origin) / placement.size)
        there = there.reshape(-1, *[1] * (light.ndim - 1))
        towards = points - self.projection.origin
        towards /= np.linalg.norm(towards, axis=1, keepdims=True)
        sky = seen_radiance(self.lighting.setup.lights, towards.astype(np.float64))
        sky = sky.reshape(-1, *[1] * (light.ndim - 2), 3)
        return np.asarray(there * light + (1.0 - there) * sky, np.float32)

    def _large_triangles(self, faces: VisibleFaces, shadow: ShadowMap, is_stage: bool) -> LargeTriangles:
        """Return the inputs of large triangles."""
        shape, which, setup = faces.shape, faces.corners_of(LARGE), self.lighting.setup
        values = np.empty((len(shape.vertices) if len(which) else 0, 12), np.float32)
        light = self.lighting.shade(shape, which, 1 if is_stage else faces.outwards, is_stage)
        light = light.reshape(-1, 2, 3)
        light = np.concatenate([light, light.mean(axis=1, keepdims=True)], axis=1)
        light = self._in_haze(light, shape.vertices[which], is_stage)
        shown = _values(light.reshape(-1, 3), setup, self.display).reshape(-1, 3, 3)
        values[which, :6], values[which, 9] = shown[:, :2].reshape(-1, 6), bulges(shown)
        values[which, 6:9] = shadow.coordinates(shape, which, faces.outwards).T
        contact = self.lighting.contact
        values[which, 10:] = contact.coordinates(shape.vertices[which]) if is_stage else -1.0
        pixels = self.drawn.nearness.size // SUPERSAMPLING**2
        return LargeTriangles(
            shape.vertices,
            *self.projection,
            values,
            shadow.nearness,
            shadow.blocks,
            contact.factors(LOOKS_DARK if self.display else PACKED_DARK),
            _ambient(setup.lights, setup.stage, setup.view, self.display),
            shadow.opacity,
            hits=np.empty((4, pixels), np.int32),
            at_hits=np.empty((15, pixels), np.float32),
        )

    def picture(self, is_rough: bool = False) -> Picture:
        """Return the picture (H, W, 3); if rough, of subsamples (SUPERSAMPLING H, SUPERSAMPLING W, 3)."""
        step = 1 if is_rough else SUPERSAMPLING
        rows, columns = (side // step for side in self.drawn.nearness.shape)
        picture = np.empty((rows, columns, 3), np.float32)
        average(self.drawn.colour, picture)
        return picture

    def nearness(self, is_rough: bool = False) -> NDArray[np.float32]:
        """Return one over the depth (H, W) next to the middle of pixels; if rough, of subsamples."""
        middle = SUPERSAMPLING // 2
        return (
            self.drawn.nearness
            if is_rough
            else self.drawn.nearness[middle::SUPERSAMPLING, middle::SUPERSAMPLING]
        )


@lru_cache(maxsize=16)
def _ambient(rig: LightRig, stage: Stage, view: ColourView, display: str) -> float:
    """Return the fraction of a value in the middle of the floor that all light but the key light makes."""
    lit, dark = floor_light(rig, stage)
    setup = StageSetup(rig, stage, StagePlacement(), view)
    whole, key = _values(np.stack([lit, lit - dark]), setup, display).mean(axis=1).tolist()
    return 1.0 - float(key) / max(float(whole), 1e-6)


def bulges(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return how far values (N,) fall in a penumbra from a straight line between light and shadow.

    values  (N, 3, 3): in the key light, in its shadow, and half way between, in any display

    In the fraction v of the key light, a value is v + bulge v (1 - v) of the way to that in the light.
    """
    lit, dark, half = values.mean(axis=2).T
    way = np.maximum(lit - dark, 1e-3)
    return np.clip(4.0 * (half - dark) / way - 2.0, 0.0, 1.0)


def _values(light: NDArray[np.float32], setup: StageSetup, display: str) -> NDArray[np.float32]:
    """Return the values (N, 3) of linear light (N, 3): display values, or packed light without a display."""
    if display:
        return displayed(light, setup, display)
    packed = np.empty_like(light)
    pack_light(light, packed)
    return packed


def _packed(values: NDArray[np.float32]) -> NDArray[np.uint32]:
    """Return values (N, 3), from 0 to 1, as subsamples (N,)."""
    red, green, blue = np.clip(WHITE * values + 0.5, 0.0, WHITE).astype(np.uint32).T
    return np.asarray(red << 20 | green << 10 | blue)


def _unpack(colour: NDArray[np.uint32]) -> NDArray[np.float32]:
    """Return the linear light (N, 3) of subsamples (N,) of packed light."""
    channels = np.stack([colour >> shift & 1023 for shift in (20, 10, 0)], axis=-1)
    light = np.empty((1, len(colour), 3), np.float32)
    unpack_light((channels[None] / WHITE).astype(np.float32), light)
    return light[0]


def displayed(light: NDArray[np.float32], setup: StageSetup, display: str) -> NDArray[np.float32]:
    """Return display values (N, 3) of linear light (N, 3)."""
    return to_display(light[None], setup.lights.exposure, display, setup.view).reshape(light.shape)


FACES = (
    ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0)),
    ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
    ((0.0, 0.0, -1.0), (0.0, 1.0, 0.0)),
    ((-1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
    ((0.0, 1.0, 0.0), (0.0, 0.0, -1.0)),
    ((0.0, -1.0, 0.0), (0.0, 0.0, 1.0)),
)
"""View direction and up direction of each face, along the axes of the wide camera: right, up and forward."""

_BORDER = 2  # pixels of a face beyond its edges, from which places at the edges are interpolated


def wide_picture(
    camera: WideCamera, size: tuple[int, int], draw: Callable[[Camera, tuple[int, int]], Picture]
) -> Picture:
    """Return the picture (H, W, 3) of a wide camera, black where its projection shows nothing.

    size  width and height in pixels
    draw  returns the picture (side, side, 3) of a perspective camera; it is called once for each face of the
          cube that is seen, and each eye
    """
    places = pixel_places(*size)
    directions, eyes = camera.wide.directions(places), camera.wide.eyes(places[..., 0])
    shown = np.isfinite(directions[..., 0])
    inner = max(8, math.ceil(2.0 / camera.pixel_size(size[0])))  # as fine as the middle of the picture
    face_of = np.argmax(np.where(shown[..., None], directions, 0.0) @ np.array(FACES)[:, 0].T, axis=-1)
    picture = np.zeros((*shown.shape, 3), dtype=np.float32)
    for eye in (LEFT, RIGHT) if camera.wide.is_stereo else (0,):
        for index, (forward, up) in enumerate(FACES):
            seen = shown & (face_of == index) & (eyes == eye)
            if seen.any():
                face = _face_camera(camera.eye(eye), forward, up, inner)
                drawn = draw(face, (inner + 2 * _BORDER,) * 2)
                picture[seen] = _sample(drawn, directions[seen], np.array(forward), np.array(up), inner)
    return picture


def _face_camera(camera: WideCamera, forward: Triple, up: Triple, inner: int) -> Camera:
    """Return the camera of a face of `inner` pixels along its side, and its border beyond them."""
    right_up_forward, origin = camera.axes(), camera.origin
    ahead, upwards = (np.array(each) @ right_up_forward for each in (forward, up))
    (x, y, z), (a, b, c) = (np.array(origin) + ahead).tolist(), upwards.tolist()
    angle = 2.0 * math.atan(1.0 + 2.0 * _BORDER / inner)
    return Camera(origin, (x, y, z), (a, b, c), angle, near=camera.near, far=camera.far)


def _sample(drawn: Picture, directions: Floats, forward: Floats, up: Floats, inner: int) -> Picture:
    """Return values (N, 3) of a face's picture in directions (N, 3), interpolated bilinearly."""
    depth, right = directions @ forward, np.cross(up, forward)
    column = 0.5 * inner * (1.0 + directions @ right / depth) - 0.5 + _BORDER
    row = 0.5 * inner * (1.0 - directions @ up / depth) - 0.5 + _BORDER
    left, top = np.floor(column).astype(np.intp), np.floor(row).astype(np.intp)
    u, v = (column - left)[:, None], (row - top)[:, None]
    upper = drawn[top, left] * (1.0 - u) + drawn[top, left + 1] * u
    lower = drawn[top + 1, left] * (1.0 - u) + drawn[top + 1, left + 1] * u
    return np.asarray(upper * (1.0 - v) + lower * v, dtype=np.float32)


HIDDEN_OPACITY = 0.1  # factor on the opacity of lines behind the surface


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
    is_rough: bool = False,
) -> Preview:
    """Render a surface on its stage.

    size      width and height in pixels
    others    further subjects. Those that light passes through look as if they were of one material, the
              first one's
    is_rough  return a pixel for each sample, unless light passes through a subject; pass no `edges` then
    """
    setup = replace(setup, lights=with_suns(setup.lights))
    shapes = [shape.for_kernels() for shape in (subject, *others)]
    opaque = [shape for shape in shapes if not shape.material.is_clear]
    clear = [shape for shape in shapes if shape.material.is_clear]
    whole = _join([*opaque, *clear])
    has_floor, opacity = setup.stage.kind != "none", contact_opacity(whole.material)
    contact = ContactShadow.of(whole.vertices, setup.placement, has_floor, opacity)
    lighting = Lighting.of(setup, contact, np.array(camera.origin))
    has_ids = edges is not None or any(shape.pigment for shape in opaque)
    fog = setup.stage.fog
    canvas = Canvas.of(camera, lighting, size, "" if clear or fog else display, has_ids)
    faces = canvas.visible(whole)
    shadow = ShadowMap.of(faces.shape, setup, faces.outwards)
    drawn, patterned = 0, []
    for shape in opaque:
        own = _faces_of(shape, faces, canvas)
        canvas.draw(own, shadow, drawn)
        patterned += [(own, drawn)] if shape.pigment else []
        drawn += len(shape.faces)
    if has_floor:
        for stage in stage_shapes(setup.stage, setup.placement, setup.fades):
            canvas.draw(canvas.visible(stage), shadow, len(whole.faces), is_stage=True)
    for own, first in patterned:
        canvas.draw_pigment(own, shadow, first)
    canvas.draw_sky()
    air = SeenAir.of(fog, lighting, canvas.projection, shadow) if fog else None
    if clear:
        picture = _through(canvas, _faces_of(_join(clear), faces, canvas), shadow, display, air)
    elif air:
        picture = canvas.picture(is_rough)
        light = np.empty_like(picture)
        unpack_light(picture, light)
        picture = displayed(air.over(light, canvas.nearness(is_rough)), setup, display)
    else:
        picture = canvas.picture(is_rough)
    if edges is not None:
        ink = np.array([*edges.colour, edges.opacity, edges.width])
        draw_edges(faces.screen, faces.shape.faces, canvas.drawn.face_ids, ink, picture)
    return Preview(picture, canvas.nearness())


def _faces_of(shape: Shape, whole: VisibleFaces, canvas: Canvas) -> VisibleFaces:
    """Return the faces of a shape that may be visible; those of the whole where that is the shape."""
    return whole if len(shape.faces) == len(whole.shape.faces) else canvas.visible(shape)


def _join(shapes: Sequence[Shape]) -> Shape:
    """Return one shape of all, with the material of the first; each keeps its colours."""
    first = shapes[0]
    if len(shapes) == 1:
        return first
    starts = np.cumsum([0, *(len(shape.vertices) for shape in shapes[:-1])])
    given = [shape.material.colour if shape.colours is None else shape.colours for shape in shapes]
    colours = [np.broadcast_to(each, shape.vertices.shape) for each, shape in zip(given, shapes, strict=True)]
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
    """Return the picture with lines (N, K, 3) over it, with colours (N, K, 3) and opacity (N, K).

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
    draw_lines(np.ascontiguousarray(ends), segment_inks, width, HIDDEN_OPACITY, depth, picture)
    return picture.astype(np.float32)


def prepare() -> None:
    """Compile the kernels, so that the first preview does not wait for it."""
    corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], np.int32)  # closed, as most subjects are
    setup = StageSetup(LIGHTS["studio"], STAGES["cyclorama"], StagePlacement())
    camera = Camera((0.0, 0.0, 6.0), (0.0, 0.0, 0.0))
    shape = Shape(corners, corners, faces, LOOKS["marble"], closed=True, rest=corners)
    shown = preview(shape, setup, camera, (8, 4), "rec709", Edges())
    preview(shape._replace(material=LOOKS["glass"], closed=False), setup, camera, (8, 4), "rec709")
    with_lines(shown, np.zeros((1, 2, 3)), np.zeros((1, 2, 3)), np.ones((1, 2)), camera, 1.0)


def _through(
    canvas: Canvas, faces: VisibleFaces, shadow: ShadowMap, display: str, air: SeenAir | None
) -> NDArray[np.float32]:
    """Draw a clear subject over its stage, and return the picture (H, W, 3)."""
    packed, behind = canvas.picture(), canvas.drawn.nearness.copy()
    background = np.empty_like(packed)
    unpack_light(packed, background)
    canvas.draw_normals(faces, shadow)
    points = VisiblePoints.of(canvas.drawn, behind, canvas.projection)
    thickness, layers = np.zeros(packed.shape[:2], np.float32), np.zeros((*packed.shape[:2], 2), np.int32)
    add_thickness(faces.shape.faces, faces.screen, faces.outwards or 1, thickness, layers)
    axes = canvas.projection.axes
    light = seen_through(points, faces.shape, canvas.lighting, axes, thickness, layers, background)
    whole = points.coverage == 1.0
    background[tuple(points.pixels[whole].T)] = light[whole]
    if air:
        edges = background.copy()
        edges[tuple(points.pixels[~whole].T)] = light[~whole]
        light[~whole] = air.over(edges, canvas.nearness())[tuple(points.pixels[~whole].T)]
        background = air.over(background, canvas.nearness())
    picture = displayed(background, canvas.lighting.setup, display)
    edge = displayed(light[~whole], canvas.lighting.setup, display)
    lay_over(points.pixels[~whole], points.coverage[~whole], edge, picture)
    return picture
