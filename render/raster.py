"""The quick preview: surfaces by a depth buffer, lit by the shot's own rig and shown by the same view.

No light bounces: softboxes shine as points do, the first of them casts a shadow, and the sky lights what
looks up.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from render._kernels_raster import draw_lines, fill
from render.camera import Camera
from render.colour import to_display
from render.lights import LightRig, Softbox
from render.look import Look
from render.stage import Placement, Stage
from render.view import ACES, ColourView

Floats = NDArray[np.float64]

FINER = 2
"""Pixels are shaded so many times as fine along both sides, against jagged edges."""

SHADOW_SIDE = 768
SHADOW_REACH = 2.6
"""Pixels of the shadow's picture, and how wide it is in stage units, at the subject."""

SHADOW_LIFT = 0.04
"""Stage units above the surface at which its shadow is looked up: a surface must not shade itself."""


class Shape(NamedTuple):
    """A surface: vertices (V, 3), normals (V, 3), faces (F, 3), and what it is made of.

    colours (V, 3) take the place of the look's, where it has more than one (see `render.dyes`).
    """

    vertices: NDArray[np.floating]
    normals: NDArray[np.floating]
    faces: NDArray[np.int32]
    look: Look
    colours: Floats | None = None


@dataclass(frozen=True)
class Set:
    """What stands around the subject: the lights, the stage, and where both are; and how it is shown."""

    lights: LightRig
    stage: Stage
    placement: Placement
    view: ColourView = ACES


class Preview(NamedTuple):
    """picture: display values (H, W, 3), 0 … 1; depth (H, W) along the lens, infinite where nothing is."""

    picture: NDArray[np.float32]
    depth: Floats


class _Hits(NamedTuple):
    """What the pixels that show something show: which they are, and there."""

    mask: NDArray[np.bool_]
    points: Floats
    normals: Floats
    colours: Floats


def prepare() -> None:
    """Compile the kernels, so that the first preview need not wait for it."""
    corners, depth = np.eye(3), np.full((2, 2), np.inf)
    fill(corners, np.array([[0, 1, 2]], np.int32), depth, np.full((2, 2), -1, np.int32), np.zeros((2, 2, 2)))
    draw_lines(np.zeros((1, 2, 3)), np.zeros((1, 4)), 1.0, 0.0, depth, np.zeros((2, 2, 3)))


def preview(subject: Shape, around: Set, camera: Camera, size: tuple[int, int], display: str) -> Preview:
    """A picture of a surface on its stage, `size` (width, height) pixels."""
    around = replace(around, lights=around.lights.plainly())
    width, height = FINER * size[0], FINER * size[1]
    shapes = [subject]
    if around.stage.kind != "none":
        shapes.append(_stage(around))
    depth = np.full((height, width), np.inf)
    light = np.empty((height, width, 3))
    light[:] = around.lights.sky.horizon
    shadow = _Shadow.of(subject, around)
    for shape in shapes:
        hits = _visible(shape, camera, depth)
        light[hits.mask] = _lit(shape.look, hits, around, camera, shadow)
    shown = to_display(light.astype(np.float32), around.lights.exposure, display, around.view)
    blocks = shown.reshape(size[1], FINER, size[0], FINER, 3).mean(axis=(1, 3))
    return Preview(blocks.astype(np.float32), depth[FINER // 2 :: FINER, FINER // 2 :: FINER].copy())


def with_lines(
    shown: Preview, lines: Floats, colours: Floats, opacity: Floats, camera: Camera, width: float
) -> NDArray[np.float32]:
    """The picture with lines (N, K, 3) over it; colours (N, K, 3) and opacity (N, K) at their points.

    What is behind the surface shines through faintly. Far lines are drawn first.
    """
    height, columns = shown.depth.shape
    seen = camera.project(lines.reshape(-1, 3), columns / height).reshape(lines.shape)
    seen[..., 0] = (seen[..., 0] + 1.0) / 2.0 * columns
    seen[..., 1] = (1.0 - seen[..., 1]) / 2.0 * height
    order = np.argsort(-seen[..., 2].mean(axis=1))
    seen, inks = seen[order], np.concatenate([colours, opacity[..., None]], axis=2)[order]
    ends = np.stack([seen[:, :-1], seen[:, 1:]], axis=2).reshape(-1, 2, 3)
    inked = ((inks[:, :-1] + inks[:, 1:]) / 2.0).reshape(-1, 4)
    picture = shown.picture.astype(np.float64)
    draw_lines(np.ascontiguousarray(ends), np.ascontiguousarray(inked), width, 0.1, shown.depth, picture)
    return picture.astype(np.float32)


def _stage(around: Set) -> Shape:
    vertices, normals, faces = around.stage.mesh()
    matrix = around.placement.matrix()
    turned = normals @ matrix[:3, :3].T / around.placement.size
    return Shape(
        vertices @ matrix[:3, :3].T + matrix[:3, 3], turned, faces, Look("diffuse", around.stage.colour)
    )


def _corners(vertices: NDArray[np.floating], camera: Camera, aspect: float) -> Floats:
    """(V, 3): as `fill` takes them."""
    local = (np.asarray(vertices, np.float64) - camera.origin) @ camera.axes().T
    half = math.tan(camera.field_of_view / 2.0)
    return np.ascontiguousarray(local / [half, half / aspect, 1.0])


def _visible(shape: Shape, camera: Camera, depth: Floats) -> _Hits:
    """Put a shape into the depth buffer; what of it is seen."""
    face = np.full(depth.shape, -1, np.int32)
    weight = np.zeros((*depth.shape, 2))
    faces = np.ascontiguousarray(shape.faces, np.int32)
    fill(_corners(shape.vertices, camera, depth.shape[1] / depth.shape[0]), faces, depth, face, weight)
    mask = face >= 0
    u, v = weight[mask].T
    mixed = np.stack([u, v, 1.0 - u - v], axis=1)[:, :, None]
    corners = faces[face[mask]]
    points = (np.asarray(shape.vertices, np.float64)[corners] * mixed).sum(axis=1)
    normals = _unit((np.asarray(shape.normals, np.float64)[corners] * mixed).sum(axis=1))
    facing = np.einsum("ij,ij->i", normals, camera.origin - points)
    if shape.colours is None:
        colours = np.broadcast_to(np.array(shape.look.colour), points.shape)
    else:
        colours = (shape.colours[corners] * mixed).sum(axis=1)
    return _Hits(mask, points, np.where(facing[:, None] < 0.0, -normals, normals), colours)


def _lit(look: Look, hits: _Hits, around: Set, camera: Camera, shadow: _Shadow) -> Floats:
    """(N, 3): the light that comes from the points that are seen."""
    colour, n = hits.colours, hits.normals
    eye = _unit(camera.origin - hits.points)
    body = np.zeros_like(colour) if look.model == "metal" else colour
    coat = np.full_like(colour, {"diffuse": 0.0, "smoke": 0.0}.get(look.model, 0.05))
    if look.model == "metal":
        coat = colour
    sky = around.lights.sky
    light = body * (np.array(sky.horizon) * (0.6 + 0.4 * n[:, 1:2]))
    mirrored = 2.0 * np.einsum("ij,ij->i", n, eye)[:, None] * n - eye
    rising = 0.5 + 0.5 * mirrored[:, 1:2]
    light += coat * (np.array(sky.zenith) * rising + np.array(sky.horizon) * (1.2 - rising))
    sharp = float(np.clip(2.0 / max(look.roughness, 0.02) ** 2 - 2.0, 6.0, 500.0))
    for i, softbox in enumerate(around.lights.softboxes):
        towards, strength = _from_softbox(softbox, hits.points, around.placement)
        facing = np.clip(np.einsum("ij,ij->i", n, towards), 0.0, None) * strength
        if i == 0:
            lit = facing > 0.0
            off = hits.points[lit] + SHADOW_LIFT * around.placement.size * n[lit]
            facing[lit] *= shadow.light(off)
        half = np.clip(np.einsum("ij,ij->i", n, _unit(towards + eye)), 0.0, 1.0)
        glint = (sharp + 8.0) / (8.0 * math.pi) * half**sharp
        light += (facing[:, None] * softbox.radiance) * (body / math.pi + coat * glint[:, None])
    for sun in around.lights.suns:
        facing = np.clip(n @ -_unit(np.array([sun.direction], np.float64))[0], 0.0, None)
        light += facing[:, None] * np.array(sun.irradiance) * body / math.pi
    return np.asarray(light)


def _from_softbox(softbox: Softbox, points: Floats, placement: Placement) -> tuple[Floats, Floats]:
    """Where it is, as unit vectors (N, 3), and how much of the view from there it fills (N,)."""
    place, target = _placed(softbox, placement)
    away = place - points
    distance = np.linalg.norm(away, axis=1)
    towards = away / distance[:, None]
    facing = np.clip(-towards @ _unit((target - place)[None])[0], 0.0, None)
    area = softbox.width * softbox.height * placement.size**2
    return towards, facing * area / distance**2


def _placed(softbox: Softbox, placement: Placement) -> tuple[Floats, Floats]:
    matrix = placement.matrix()
    place, target = (
        matrix[:3, :3] @ np.array(at) + matrix[:3, 3] for at in (softbox.position, softbox.target)
    )
    return place, target


@dataclass(frozen=True)
class _Shadow:
    """What the first softbox sees of the subject."""

    camera: Camera | None
    depth: Floats

    @classmethod
    def of(cls, subject: Shape, around: Set) -> _Shadow:
        depth = np.full((SHADOW_SIDE, SHADOW_SIDE), np.inf)
        if not around.lights.softboxes:
            return cls(None, depth)
        place, target = _placed(around.lights.softboxes[0], around.placement)
        reach = SHADOW_REACH * around.placement.size / float(np.linalg.norm(target - place))
        ox, oy, oz = place.tolist()
        tx, ty, tz = target.tolist()
        camera = Camera((ox, oy, oz), (tx, ty, tz), field_of_view=2.0 * math.atan(reach))
        _visible(subject, camera, depth)
        return cls(camera, depth)

    def light(self, points: Floats) -> Floats:
        """(N,): how much of the softbox points see, from 0 to 1, by those around them in its picture."""
        if self.camera is None:
            return np.ones(len(points))
        seen = self.camera.project(points, 1.0)
        column = (seen[:, 0] + 1.0) / 2.0 * SHADOW_SIDE
        row = (1.0 - seen[:, 1]) / 2.0 * SHADOW_SIDE
        lit = np.zeros(len(points))
        offsets = [(dx, dy) for dx in (-4, -2, 0, 2, 4) for dy in (-4, -2, 0, 2, 4)]
        for dx, dy in offsets:
            i, j = (row + dy).astype(np.int64), (column + dx).astype(np.int64)
            inside = (i >= 0) & (i < SHADOW_SIDE) & (j >= 0) & (j < SHADOW_SIDE)
            nearest = np.full(len(points), np.inf)
            nearest[inside] = self.depth[i[inside], j[inside]]
            lit += seen[:, 2] < nearest
        return np.asarray(lit / len(offsets))


def _unit(vectors: Floats) -> Floats:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-300))
